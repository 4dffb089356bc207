# SPDX-License-Identifier: Apache-2.0
"""The health of the motor bridge, for /diagnostics."""
from typing import Mapping, Optional, Tuple

from ballbot_ros.bridge.loop import Loop
from ballbot_ros.bridge.sensing import IMU_RECOVERY_TIME
from ballbot_ros.bridge.session import Session
from ballbot_ros.bridge.supervisor import StopReason
from ballbot_ros.control import Authority
from ballbot_ros.ros import diagnostics

# Published values: the table of docs/nodes.md.  A word in capitals is a placeholder.
VALUES: Mapping[str, str] = {
    'port': 'serial device, URL or CAN interface',
    'protocol': 'protocol that the drive speaks',
    'firmware': 'firmware of the drive; empty before the drive is found',
    'serial_number': 'serial number of the drive; empty where it reports none',
    'e_stop': 'reason for the engaged e-stop; empty while it is released',
    'e_stop_reason': 'code of that reason: ' + ', '.join(
        f'`{reason.value}`' for reason in StopReason),
    'faults': 'faults that the drive reports; empty without faults or without a connection',
    'torque': 'torque applied at the pendulum [N m]',
    'warnings': 'warnings about drive, battery and motor heating, before they reduce the torque',
    'derating': 'fraction of torque_limit that battery and motor heating permit',
    'battery_voltage': 'open-circuit voltage of the battery, estimated and smoothed [V]; nan '
                       'before the first reading',
    'motor_warmth': 'heating of the winding, computed from the torque; 1 is the value permitted '
                    'continuously',
    'imu': '`received`, `silent` (no readings), or `returning` (readings arrive, but for '
           'less than the recovery time)',
    'commander': 'node whose joint_commands (on board: set-points) are followed; empty before '
                 'the first command',
    'commands_accepted': 'joint_commands that were accepted: fresh and in order',
    'commands_refused': 'joint_commands that were refused',
    'refused_REASON': 'joint_commands refused for one reason: `stale`, `not_finite`, '
                      '`out_of_order`, `from_the_future`, `unknown_joint`, `duplicate_joint`, '
                      '`wrong_length`, `unsupported`, `onboard`, `other_sender`, '
                      '`several_publishers`',
    'imu_silences': 'number of IMU dropouts',
    'imu_refused': 'IMU readings that were refused',
    'control': '`onboard` or `direct`',
    'law': 'law that is active on board; empty in direct control',
    'set_value': 'set value of that law [rad], [rad/s] or [m/s]',
    'set_points_refused': 'messages on set_point and cmd_vel that were refused',
    'set_points_REASON': 'set-points refused for one reason: `stale`, `from_the_future`, '
                         '`not_finite`, `out_of_range`, `e_stop`, `direct`, `contradictory`, '
                         '`unknown_joint`, `duplicate_joint`, `wrong_length`, `other_sender`, '
                         '`several_publishers`, `other_axes`',
    'timeouts': 'number of command timeouts',
    'e_stops': 'number of e-stops since the start',
    'limited_torque': 'number of times that torque_limit reduced the torque',
    'limited_rate': 'number of times that torque_rate_limit reduced the torque',
    'limited_angle': 'number of times that angle_limit reduced the torque',
    'limited_speed': 'number of times that speed_limit reduced the torque',
    'armed': 'number of times that the motor was armed',
    'disarmed_by_drive': 'number of times that the drive itself disarmed the motor',
    'links_lost': 'number of interrupted connections to the drive',
    'reconnects': 'number of reconnections to the drive',
    'encoder_jumps': 'encoder readings that were rejected as jumps',
    'encoder_rezeroed': 'number of changes of the encoder zero',
    'late_periods': 'loop periods that were missed since configure',
    'wire_COUNT': 'counters of the line since it was last opened, if the protocol has them: '
                  '`sent` (writes), `bytes` (received), `replies`, `lost` (not '
                  'answered in time), `unexpected`, `refused` (checksum or format), `skipped` '
                  '(bytes that belong to no message), `unchecked` (lines without a checksum)'}
SUPERVISED = ('timeouts', 'e_stops', 'limited_torque', 'limited_rate', 'limited_angle',
              'limited_speed')
EVENTS = ('armed', 'disarmed_by_drive', 'links_lost')


def summary(session: Session, loop: Optional[Loop]) -> Tuple[bytes, str]:
    """Return the diagnostic level and text for connection, e-stop and command timeout."""
    if loop is None:
        return diagnostics.WARN, ': '.join(filter(None, ('not configured', session.line.trouble)))
    if session.line.driver is None:
        return diagnostics.ERROR, f'looking for the drive: {session.line.trouble}'
    e_stop = session.supervisor.e_stop
    if e_stop:
        return diagnostics.WARN, f'e-stop: {e_stop.text}'
    if session.supervisor.timed_out:
        return diagnostics.WARN, 'commands timed out'
    return diagnostics.OK, 'running'


def health(session: Session, loop: Optional[Loop], imu_refused: int,
           authority: Authority) -> diagnostics.Health:
    """
    Return level, message and the values of `VALUES`.

    May be called while the loop runs in another thread.
    """
    supervisor, fusion = session.supervisor, session.fusion
    driver, identity = session.line.driver, session.line.identity
    connection = session.hardware.connection
    sensing, now, e_stop = session.sensing, session.clock(), supervisor.e_stop
    imu, has_imu = sensing.imu_watch, sensing.imu_watch.has(now)
    # Most drives report a watchdog fault while unpowered; arming clears it.
    faults = ', '.join(driver.telemetry.faults) if driver else ''
    condition = session.control.monitor.condition
    warnings = ', '.join((*(driver.telemetry.warnings if driver else ()), *condition.warnings))
    # Each dict is copied in one operation, as the loop may add a counter concurrently.
    refused, wire = dict(supervisor.gate.refused), dict(driver.counts) if driver else {}
    law = None if session.law is None else session.law.set_point
    unfollowed = dict(session.set_points_refused)
    values = {
        'port': connection.port, 'protocol': connection.protocol,
        'firmware': identity.firmware if identity else '',
        'serial_number': identity.serial_number if identity else '',
        'e_stop': e_stop.text if e_stop else '',
        'e_stop_reason': e_stop.reason.value if e_stop else '', 'faults': faults,
        'torque': f'{supervisor.torque:.4f}',
        'warnings': warnings, 'derating': f'{condition.part:.3f}',
        'battery_voltage': f'{condition.voltage:.2f}', 'motor_warmth': f'{condition.warmth:.3f}',
        'imu': ('silent' if not has_imu else
                'returning' if imu.silent else 'received'),
        'imu_silences': imu.silences,
        'commander': authority.holder or '',
        'commands_accepted': supervisor.gate.accepted, 'commands_refused': sum(refused.values()),
        **{f'refused_{reason}': number for reason, number in refused.items()},
        'imu_refused': imu_refused,
        'control': 'direct' if law is None else 'onboard',
        'law': '' if law is None else law.mode.value,
        'set_value': '' if law is None else f'{law.value:.4f}',
        'set_points_refused': sum(unfollowed.values()),
        **{f'set_points_{reason}': number for reason, number in unfollowed.items()},
        **{name: supervisor.counts[name] for name in SUPERVISED},
        **{name: session.control.counts[name] for name in EVENTS},
        'reconnects': session.line.reconnects,
        'encoder_jumps': fusion.jumps, 'encoder_rezeroed': fusion.rezeroed,
        'late_periods': loop.late if loop else 0,
        **{f'wire_{what}': number for what, number in wire.items()}}
    level, text = summary(session, loop)
    if loop is None:
        return level, text, values
    delayed = loop.delayed()
    if driver is None:
        return level, text, values
    if e_stop:
        return level, '; '.join(filter(None, (text, delayed))), values
    if faults:
        return diagnostics.ERROR, f'the drive reports {faults}', values
    if session.control.refusal:
        return diagnostics.ERROR, session.control.refusal, values
    if authority.contested(now):
        return diagnostics.WARN, authority.contest, values
    if sensing.needs_imu(now):
        return diagnostics.ERROR, (
            'no IMU, and no torque until readings arrive for '
            f'{IMU_RECOVERY_TIME:g} s without a gap'), values
    if delayed:
        return diagnostics.WARN, delayed, values
    if session.law is not None and session.law.too_slow:
        return diagnostics.ERROR, (
            f'the drive answers at {session.law.rate or 0.0:.0f} Hz, and these gains need '
            f'{session.law.expected.lowest_rate:.0f} Hz: torque is 0; check the latency timer of '
            'the serial adapter and the line'), values
    if supervisor.timed_out:
        return level, text, values
    if session.law is not None and session.law.let_down:
        return diagnostics.WARN, 'set-points timed out', values
    if session.law is not None and session.law.overcome:
        return diagnostics.WARN, 'resistance exceeds the torque at the largest lean', values
    if not has_imu:
        return diagnostics.WARN, 'no IMU: pendulum angle unreliable off level floor', values
    if warnings:
        return diagnostics.WARN, f'warning before a limit applies: {warnings}', values
    return level, text, values
