# SPDX-License-Identifier: Apache-2.0
"""
What an emulated ODrive has of each generation of the firmware.

Written out once more, and not shared with the driver: a name that is wrong there is to be found.
"""
from dataclasses import dataclass
from typing import Mapping

from ballbot_ros.drives.emulated_device import DriveSettings
from ballbot_ros.drives.odrive.codec import IDLE, PASSTHROUGH

NOT_CALIBRATED, INVALID_STATE = 14, 13  # ODrive.ProcedureResult
SERIAL_NUMBER = 0x208F3387304B
POSITION_CONTROL = 3  # the control mode after the factory


@dataclass(frozen=True)
class Names:
    """Names of properties, and bits of errors, of one generation."""

    version: tuple[int, int, int]
    board: tuple[int, int, int]
    axes: int
    one_reply_at_a_time: bool
    torque_command_sets_mode: bool
    errors: str
    current: str
    torque_max: str
    torque_min: str  # empty where the largest torque is the least one, too
    current_limit: str
    torque_constant: str
    watchdog_expired: int
    too_hot: int
    too_much_current: int
    more: Mapping[str, float]  # further properties as they come from the factory
    read_only: tuple[str, ...]

    def properties(self, settings: DriveSettings) -> dict[str, float]:
        """Return all properties but what is measured, as they are after a boot."""
        limit = settings.torque_limit
        found: dict[str, float] = {
            **dict(zip(('fw_version_major', 'fw_version_minor', 'fw_version_revision'),
                       self.version)),
            **dict(zip(('hw_version_major', 'hw_version_minor', 'hw_version_variant'),
                       self.board)),
            'serial_number': SERIAL_NUMBER, 'test_property': 0, self.errors: 0,
            'axis0.current_state': IDLE, 'axis0.requested_state': 0,
            'axis0.config.enable_watchdog': int(settings.watchdog > 0.0),
            'axis0.config.watchdog_timeout': settings.watchdog,
            'axis0.controller.config.control_mode': POSITION_CONTROL,
            'axis0.controller.config.input_mode': PASSTHROUGH,
            self.torque_max: limit, self.current_limit: settings.current_limit,
            self.torque_constant: settings.torque_constant, **self.more}
        if self.torque_min:
            found[self.torque_min] = -limit
        return found

    def info(self, here: Mapping[str, float]) -> list[str]:
        """Return the answer to ``i``."""
        return ['Hardware version: {}.{}-{}V'.format(*self.board),
                'Firmware version: {fw_version_major}.{fw_version_minor}.{fw_version_revision}'
                .format_map(here), f'Serial number: {SERIAL_NUMBER:X}']

    def ready(self, here: Mapping[str, float]) -> bool:
        """Return whether the encoder allows closed loop control."""
        return here.get('axis0.encoder.is_ready', 1) == 1 \
            and here.get('axis0.commutation_mapper.status', 0) == 0

    def refuse(self, here: dict[str, float], state: float) -> None:
        """Note that a state is not entered."""
        if 'axis0.procedure_result' in here:
            here['axis0.procedure_result'] = \
                NOT_CALIBRATED if not self.ready(here) else INVALID_STATE
        else:
            here[self.errors] = int(here[self.errors]) | 0x1  # INVALID_STATE


FIXED = ('fw_version_major', 'fw_version_minor', 'fw_version_revision', 'hw_version_major',
         'hw_version_minor', 'hw_version_variant', 'serial_number', 'axis0.current_state')

NAMES = {
    '0.5': Names(
        version=(0, 5, 6), board=(3, 6, 56), axes=2, one_reply_at_a_time=False,
        torque_command_sets_mode=True, errors='axis0.error',
        current='axis0.motor.current_control.Iq_measured',
        torque_max='axis0.motor.config.torque_lim', torque_min='',
        current_limit='axis0.motor.config.current_lim',
        torque_constant='axis0.motor.config.torque_constant', watchdog_expired=0x800,
        too_hot=0x40, too_much_current=0x40,
        more={'axis0.motor.config.motor_type': 0, 'axis0.encoder.is_ready': 1},
        read_only=(*FIXED, 'axis0.encoder.is_ready')),
    '0.6': Names(
        version=(0, 6, 11), board=(5, 2, 0), axes=1, one_reply_at_a_time=True,
        torque_command_sets_mode=False, errors='axis0.active_errors',
        current='axis0.motor.foc.Iq_measured',
        torque_max='axis0.config.torque_soft_max', torque_min='axis0.config.torque_soft_min',
        current_limit='axis0.config.motor.current_soft_max',
        torque_constant='axis0.config.motor.torque_constant', watchdog_expired=0x1000000,
        too_hot=0x4000, too_much_current=0x1000,
        more={'axis0.disarm_reason': 0, 'axis0.procedure_result': 0,
              'axis0.config.motor.motor_type': 0, 'axis0.config.init_torque': 0.0,
              'axis0.pos_vel_mapper.status': 9, 'axis0.pos_vel_mapper.config.circular': 0,
              'axis0.commutation_mapper.status': 0},
        read_only=(*FIXED, 'axis0.active_errors', 'axis0.disarm_reason',
                   'axis0.procedure_result', 'axis0.pos_vel_mapper.status',
                   'axis0.commutation_mapper.status'))}
