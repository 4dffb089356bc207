# SPDX-License-Identifier: Apache-2.0
"""The health of the motor bridge, for /diagnostics."""
from typing import Optional

from ballbot_ros.bridge.hardware_file import Hardware
from ballbot_ros.bridge.loop import Loop
from ballbot_ros.bridge.session import Session
from ballbot_ros.ros import diagnostics


def health(session: Session, loop: Optional[Loop], hardware: Hardware,
           imu_refused: int) -> diagnostics.Health:
    """Return level, message and numbers."""
    supervisor, driver, fusion = session.supervisor, session.driver, session.fusion
    identity = session.identity
    values = {
        'port': hardware.connection.port, 'protocol': hardware.connection.protocol,
        'firmware': identity.firmware if identity else '',
        'serial_number': identity.serial_number if identity else '',
        'e_stop': supervisor.e_stop, 'torque': f'{supervisor.torque:.4f}',
        'commands_accepted': supervisor.accepted,
        'commands_refused': sum(supervisor.refused.values()),
        **{f'refused_{reason}': number for reason, number in supervisor.refused.items()},
        **supervisor.counts, **session.counts,
        **{f'wire_{what}': number for what, number in (driver.counts if driver else {}).items()},
        'encoder_jumps': fusion.jumps, 'encoder_rezeroed': fusion.rezeroed,
        'imu': 'heard' if fusion.has_imu(session.clock()) else 'silent',
        'imu_refused': imu_refused, 'late_periods': loop.late if loop else 0}
    if loop is None:
        return diagnostics.WARN, 'not configured', values
    if not session.link_up:
        return diagnostics.ERROR, f'looking for the drive: {session.trouble}', values
    # Without power most drives tell of their watchdog; arming clears that.
    faults = ', '.join(driver.telemetry.faults) if driver else ''
    values['faults'] = faults
    if supervisor.e_stop:
        return diagnostics.WARN, f'e-stop: {supervisor.e_stop}', values
    if faults:
        return diagnostics.ERROR, f'the drive tells of {faults}', values
    if supervisor.timed_out:
        return diagnostics.WARN, 'commands stay away', values
    if not fusion.has_imu(session.clock()):
        return diagnostics.WARN, 'no IMU: the pendulum angle is a guess off level floor', values
    return diagnostics.OK, 'running', values
