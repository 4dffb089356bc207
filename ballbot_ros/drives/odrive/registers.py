# SPDX-License-Identifier: Apache-2.0
"""
The registers of errors of an ODrive, with the names that the maker gives their bits.

Sources: for 0.5 tools/odrive/enums.py in odriverobotics/ODrive, at fw-v0.5.6, for 0.6 enums.py of
the maker's Python package `odrive`, 0.6.11.  The registers of the axis have the bare names there;
those of its parts carry their prefix here, as several share names.
"""
from itertools import combinations
from types import MappingProxyType
from typing import Mapping, NamedTuple

from ballbot_ros.drives.contract import bit_names

# A value is cut to nine characters on its way; so many digits may be all or not.
CUT = 9


class Register(NamedTuple):
    """A property whose bits, or where `counts` whose value, name what is wrong."""

    path: str
    prefix: str  # of each name
    names: Mapping[int, str]
    counts: bool = False

    def names_of(self, value: float) -> tuple[str, ...]:
        """
        Return the names of what is set; unknown bits in hexadecimal.

        Where a number lost digits on its way, the bit is named whose number begins with those
        that came, or the two bits; the digits themselves where that could be several.
        """
        number = int(value)
        if self.counts:
            return (self.names.get(number, str(number)),) if number else ()
        known = sum(self.names)
        if len(str(number)) < CUT or not number & ~known:
            return tuple(self.prefix + name for name in bit_names(number, self.names))
        for count in (1, 2):
            found = [bits for bits in map(sum, combinations(self.names, count))
                     if str(bits).startswith(str(number))]
            if len(found) == 1:
                return tuple(self.prefix + name for name in bit_names(found[0], self.names))
            if found:
                return (f'{self.prefix}{number}... (cut by the drive, see dump_errors(odrv0))',)
        return tuple(self.prefix + name for name in bit_names(number, self.names))


def _table(path: str, prefix: str, names: dict[int, str], counts: bool = False) -> Register:
    return Register(path, prefix, MappingProxyType(names), counts)


AXIS_5 = _table('axis0.error', '', {
    0x1: 'INVALID_STATE', 0x40: 'MOTOR_FAILED', 0x80: 'SENSORLESS_ESTIMATOR_FAILED',
    0x100: 'ENCODER_FAILED', 0x200: 'CONTROLLER_FAILED', 0x800: 'WATCHDOG_TIMER_EXPIRED',
    0x1000: 'MIN_ENDSTOP_PRESSED', 0x2000: 'MAX_ENDSTOP_PRESSED', 0x4000: 'ESTOP_REQUESTED',
    0x20000: 'HOMING_WITHOUT_ENDSTOP', 0x40000: 'OVER_TEMP', 0x80000: 'UNKNOWN_POSITION'})
MOTOR_5 = _table('axis0.motor.error', 'MOTOR_ERROR_', {
    0x1: 'PHASE_RESISTANCE_OUT_OF_RANGE', 0x2: 'PHASE_INDUCTANCE_OUT_OF_RANGE', 0x8: 'DRV_FAULT',
    0x10: 'CONTROL_DEADLINE_MISSED', 0x80: 'MODULATION_MAGNITUDE',
    0x400: 'CURRENT_SENSE_SATURATION', 0x1000: 'CURRENT_LIMIT_VIOLATION',
    0x10000: 'MODULATION_IS_NAN', 0x20000: 'MOTOR_THERMISTOR_OVER_TEMP',
    0x40000: 'FET_THERMISTOR_OVER_TEMP', 0x80000: 'TIMER_UPDATE_MISSED',
    0x100000: 'CURRENT_MEASUREMENT_UNAVAILABLE', 0x200000: 'CONTROLLER_FAILED',
    0x400000: 'I_BUS_OUT_OF_RANGE', 0x800000: 'BRAKE_RESISTOR_DISARMED',
    0x1000000: 'SYSTEM_LEVEL', 0x2000000: 'BAD_TIMING', 0x4000000: 'UNKNOWN_PHASE_ESTIMATE',
    0x8000000: 'UNKNOWN_PHASE_VEL', 0x10000000: 'UNKNOWN_TORQUE',
    0x20000000: 'UNKNOWN_CURRENT_COMMAND', 0x40000000: 'UNKNOWN_CURRENT_MEASUREMENT',
    0x80000000: 'UNKNOWN_VBUS_VOLTAGE', 0x100000000: 'UNKNOWN_VOLTAGE_COMMAND',
    0x200000000: 'UNKNOWN_GAINS', 0x400000000: 'CONTROLLER_INITIALIZING',
    0x800000000: 'UNBALANCED_PHASES'})
ENCODER_5 = _table('axis0.encoder.error', 'ENCODER_ERROR_', {
    0x1: 'UNSTABLE_GAIN', 0x2: 'CPR_POLEPAIRS_MISMATCH', 0x4: 'NO_RESPONSE',
    0x8: 'UNSUPPORTED_ENCODER_MODE', 0x10: 'ILLEGAL_HALL_STATE', 0x20: 'INDEX_NOT_FOUND_YET',
    0x40: 'ABS_SPI_TIMEOUT', 0x80: 'ABS_SPI_COM_FAIL', 0x100: 'ABS_SPI_NOT_READY',
    0x200: 'HALL_NOT_CALIBRATED_YET'})
CONTROLLER_5 = _table('axis0.controller.error', 'CONTROLLER_ERROR_', {
    0x1: 'OVERSPEED', 0x2: 'INVALID_INPUT_MODE', 0x4: 'UNSTABLE_GAIN',
    0x8: 'INVALID_MIRROR_AXIS', 0x10: 'INVALID_LOAD_ENCODER', 0x20: 'INVALID_ESTIMATE',
    0x40: 'INVALID_CIRCULAR_RANGE', 0x80: 'SPINOUT_DETECTED'})
SENSORLESS_5 = _table('axis0.sensorless_estimator.error', 'SENSORLESS_ESTIMATOR_ERROR_', {
    0x1: 'UNSTABLE_GAIN', 0x2: 'UNKNOWN_CURRENT_MEASUREMENT'})
SYSTEM_5 = _table('error', 'ODRIVE_ERROR_', {
    0x1: 'CONTROL_ITERATION_MISSED', 0x2: 'DC_BUS_UNDER_VOLTAGE', 0x4: 'DC_BUS_OVER_VOLTAGE',
    0x8: 'DC_BUS_OVER_REGEN_CURRENT', 0x10: 'DC_BUS_OVER_CURRENT',
    0x20: 'BRAKE_DEADTIME_VIOLATION', 0x40: 'BRAKE_DUTY_CYCLE_NAN',
    0x80: 'INVALID_BRAKE_RESISTANCE'})

AXIS_6 = _table('axis0.active_errors', '', {
    0x1: 'INITIALIZING', 0x2: 'SYSTEM_LEVEL', 0x4: 'TIMING_ERROR', 0x8: 'MISSING_ESTIMATE',
    0x10: 'BAD_CONFIG', 0x20: 'DRV_FAULT', 0x40: 'MISSING_INPUT', 0x100: 'DC_BUS_OVER_VOLTAGE',
    0x200: 'DC_BUS_UNDER_VOLTAGE', 0x400: 'DC_BUS_OVER_CURRENT',
    0x800: 'DC_BUS_OVER_REGEN_CURRENT', 0x1000: 'CURRENT_LIMIT_VIOLATION',
    0x2000: 'MOTOR_OVER_TEMP', 0x4000: 'INVERTER_OVER_TEMP', 0x8000: 'VELOCITY_LIMIT_VIOLATION',
    0x10000: 'POSITION_LIMIT_VIOLATION', 0x20000: 'REQUESTED_CURRENT_TOO_HIGH',
    0x1000000: 'WATCHDOG_TIMER_EXPIRED', 0x2000000: 'ESTOP_REQUESTED',
    0x4000000: 'SPINOUT_DETECTED', 0x8000000: 'BRAKE_RESISTOR_DISARMED',
    0x10000000: 'THERMISTOR_DISCONNECTED', 0x40000000: 'CALIBRATION_ERROR'})
REASON_6 = AXIS_6._replace(path='axis0.disarm_reason')
RESULT_6 = _table('axis0.procedure_result', '', dict(enumerate((
    'SUCCESS', 'BUSY', 'CANCELLED', 'DISARMED', 'NO_RESPONSE', 'POLE_PAIR_CPR_MISMATCH',
    'PHASE_RESISTANCE_OUT_OF_RANGE', 'PHASE_INDUCTANCE_OUT_OF_RANGE', 'UNBALANCED_PHASES',
    'INVALID_MOTOR_TYPE', 'ILLEGAL_HALL_STATE', 'TIMEOUT', 'HOMING_WITHOUT_ENDSTOP',
    'INVALID_STATE', 'NOT_CALIBRATED', 'NOT_CONVERGING', 'REQUESTED_CURRENT_TOO_HIGH'))),
    counts=True)
