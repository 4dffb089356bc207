# SPDX-License-Identifier: Apache-2.0
"""
Names of the properties and errors of an ODrive, and required settings: a table per generation.

Sources.  For 0.5: Firmware/odrive-interface.yaml in odriverobotics/ODrive, at fw-v0.5.  For 0.6,
which runs on Pro, S1 and Micro: names of properties from a list of all endpoints of a 0.6 board,
as the maker generates it (flat_endpoints.json); names of errors, states and boards from the
maker's Python package `odrive`, 0.6.11 (enums.py, hw_version.py).  The maker's descriptions of the
properties were not available.  Their meaning follows from their names, and from measurements of
users of 0.6.11: `init_torque` becomes the torque at arming, a position that is not `circular`
counts full turns, and an error may clear without a command.

Guessed for 0.6: that `torque_soft_min`, `torque_soft_max` and `current_soft_max` bound the torque
command as `torque_lim` and `current_lim` did; that an encoder in RELATIVE_MODE is sufficient,
because its zero is not used; that feedback is not valid while an estimate is
missing; that `disarm_reason` remains after the error has cleared.
"""
from dataclasses import dataclass
from itertools import combinations
import math
from typing import Mapping, NamedTuple, Sequence

from ballbot_ros.drives.contract import bit_names
from ballbot_ros.errors import DriveError

IDLE, CLOSED_LOOP_CONTROL = 1, 8  # axis states
TORQUE_CONTROL = 1  # control mode
PASSTHROUGH = 1  # input mode

# Results of a procedure that do not explain a loss of power: success, busy, disarmed.
NO_REASON = (0, 1, 3)

# The drive truncates a value to nine characters; a value of nine digits may be incomplete.
VALUE_LENGTH_MAX = 9


class Register(NamedTuple):
    """A property whose bits, or with `counts` whose value, identify an error."""

    path: str
    prefix: str  # of each name
    names: Mapping[int, str]
    counts: bool = False

    def names_of(self, value: float) -> tuple[str, ...]:
        """
        Return the names of the bits set; unknown bits in hexadecimal.

        For a truncated number, return the bit, or the two bits, whose number starts with the
        received digits; the digits themselves if that is ambiguous.
        """
        number = int(value)
        if self.counts:
            return (self.names.get(number, str(number)),) if number else ()
        if len(str(number)) >= VALUE_LENGTH_MAX and number & ~sum(self.names):
            for count in (1, 2):
                found = [bits for bits in map(sum, combinations(self.names, count))
                         if str(bits).startswith(str(number))]
                if len(found) > 1:
                    return (
                        f'{self.prefix}{number}... (cut by the drive, see dump_errors(odrv0))',)
                if found:
                    number = found[0]
                    break
        return tuple(self.prefix + name for name in bit_names(number, self.names))


AXIS_5 = Register('axis0.error', '', {
    0x1: 'INVALID_STATE', 0x40: 'MOTOR_FAILED', 0x80: 'SENSORLESS_ESTIMATOR_FAILED',
    0x100: 'ENCODER_FAILED', 0x200: 'CONTROLLER_FAILED', 0x800: 'WATCHDOG_TIMER_EXPIRED',
    0x1000: 'MIN_ENDSTOP_PRESSED', 0x2000: 'MAX_ENDSTOP_PRESSED', 0x4000: 'ESTOP_REQUESTED',
    0x20000: 'HOMING_WITHOUT_ENDSTOP', 0x40000: 'OVER_TEMP', 0x80000: 'UNKNOWN_POSITION'})
MOTOR_5 = Register('axis0.motor.error', 'MOTOR_ERROR_', {
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
ENCODER_5 = Register('axis0.encoder.error', 'ENCODER_ERROR_', {
    0x1: 'UNSTABLE_GAIN', 0x2: 'CPR_POLEPAIRS_MISMATCH', 0x4: 'NO_RESPONSE',
    0x8: 'UNSUPPORTED_ENCODER_MODE', 0x10: 'ILLEGAL_HALL_STATE', 0x20: 'INDEX_NOT_FOUND_YET',
    0x40: 'ABS_SPI_TIMEOUT', 0x80: 'ABS_SPI_COM_FAIL', 0x100: 'ABS_SPI_NOT_READY',
    0x200: 'HALL_NOT_CALIBRATED_YET'})
CONTROLLER_5 = Register('axis0.controller.error', 'CONTROLLER_ERROR_', {
    0x1: 'OVERSPEED', 0x2: 'INVALID_INPUT_MODE', 0x4: 'UNSTABLE_GAIN',
    0x8: 'INVALID_MIRROR_AXIS', 0x10: 'INVALID_LOAD_ENCODER', 0x20: 'INVALID_ESTIMATE',
    0x40: 'INVALID_CIRCULAR_RANGE', 0x80: 'SPINOUT_DETECTED'})
SENSORLESS_5 = Register('axis0.sensorless_estimator.error', 'SENSORLESS_ESTIMATOR_ERROR_', {
    0x1: 'UNSTABLE_GAIN', 0x2: 'UNKNOWN_CURRENT_MEASUREMENT'})
SYSTEM_5 = Register('error', 'ODRIVE_ERROR_', {
    0x1: 'CONTROL_ITERATION_MISSED', 0x2: 'DC_BUS_UNDER_VOLTAGE', 0x4: 'DC_BUS_OVER_VOLTAGE',
    0x8: 'DC_BUS_OVER_REGEN_CURRENT', 0x10: 'DC_BUS_OVER_CURRENT',
    0x20: 'BRAKE_DEADTIME_VIOLATION', 0x40: 'BRAKE_DUTY_CYCLE_NAN',
    0x80: 'INVALID_BRAKE_RESISTANCE'})

AXIS_6 = Register('axis0.active_errors', '', {
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
RESULT_6 = Register('axis0.procedure_result', '', dict(enumerate((
    'SUCCESS', 'BUSY', 'CANCELLED', 'DISARMED', 'NO_RESPONSE', 'POLE_PAIR_CPR_MISMATCH',
    'PHASE_RESISTANCE_OUT_OF_RANGE', 'PHASE_INDUCTANCE_OUT_OF_RANGE', 'UNBALANCED_PHASES',
    'INVALID_MOTOR_TYPE', 'ILLEGAL_HALL_STATE', 'TIMEOUT', 'HOMING_WITHOUT_ENDSTOP',
    'INVALID_STATE', 'NOT_CALIBRATED', 'NOT_CONVERGING', 'REQUESTED_CURRENT_TOO_HIGH'))),
    counts=True)


# The same in both generations.  `axis0` stands for the motor output in use.
STATE, REQUESTED_STATE = 'axis0.current_state', 'axis0.requested_state'
CONTROL_MODE = 'axis0.controller.config.control_mode'
WATCHDOG, WATCHDOG_TIMEOUT = 'axis0.config.enable_watchdog', 'axis0.config.watchdog_timeout'
BUS_VOLTAGE, BUS_CURRENT = 'vbus_voltage', 'ibus'
EFFECTIVE_CURRENT = 'axis0.motor.effective_current_lim'
SATURATED = 'brake_resistor_saturated'
TEMPERATURE = 'axis0.motor.fet_thermistor.temperature'
MOTOR_TEMPERATURE = 'axis0.motor.motor_thermistor.temperature'
VERSION = ('fw_version_major', 'fw_version_minor', 'fw_version_revision')
HARDWARE = ('hw_version_major', 'hw_version_minor', 'hw_version_variant')
SERIAL_NUMBER = 'serial_number'
VELOCITY_LIMIT = 'axis0.controller.config.vel_limit'
VELOCITY_TOLERANCE = 'axis0.controller.config.vel_limit_tolerance'
VELOCITY_GAIN = 'axis0.controller.config.vel_gain'
LIMITS_TORQUE_MODE = 'axis0.controller.config.enable_torque_mode_vel_limit'
OVERSPEED = 'axis0.controller.config.enable_overspeed_error'
MAX_BACK = 'config.dc_max_negative_current'  # current into the supply [A], negative
BACK_ALLOWED = 'config.max_regen_current'  # into the supply before the brake resistor acts [A]

FACTORY_VELOCITY_TOLERANCE = 1.2  # of the velocity limit
BRAKE_DUTY_MAX = 0.95  # of the brake resistor; low_level.cpp

# A watchdog that is not fed also disarms a motor during calibration.
CALIBRATE = (f'w {WATCHDOG} 0, sc, w {REQUESTED_STATE} 3 (calibrates: the motor turns. Then '
             'enable the watchdog again)')


# Texts of errors that the drivers of both protocols raise.
UNDER_POWER = 'the motor is under power; disable it first'


def not_armed(names: Sequence[str]) -> str:
    """Return the text of the error at arming, with the names of the errors of the drive."""
    return ('the ODrive does not enter closed-loop control and reports '
            f'{", ".join(names) or "no reason"}; remove the cause, dump_errors(odrv0) in '
            'odrivetool shows details')


class Rule(NamedTuple):
    """A property and its permitted values."""

    setting: str
    name: str
    wanted: tuple[int, ...]
    words: Mapping[int, str]  # meaning of the values
    remedy: str = ''  # empty: write the first wanted value


@dataclass(frozen=True)
class Generation:
    """Names of one generation of the firmware, as in the maker's reference."""

    version: tuple[int, int]  # major and minor
    axes: int  # motor outputs of a board
    one_reply_at_a_time: bool  # a reply is lost while the previous one is being sent
    axis: Register  # with the errors that prevent motor power
    reason: str  # property with the errors that last disabled motor power; empty if there is none
    details: tuple[Register, ...]  # registers that detail an error
    # Bits of the errors with which position and velocity are not valid, and of the watchdog.
    no_estimate: int
    watchdog_expired: int
    current: str  # property with the torque-producing motor current
    torque_limits: tuple[str, ...]  # properties whose magnitude bounds the torque
    current_limit: str  # properties whose product bounds it, too
    torque_constant: str
    brake_enabled: str  # properties of the brake resistor
    brake_resistance: str
    warnings: tuple[str, ...]  # properties that warn before an error
    rules: tuple[Rule, ...]

    @property
    def errors(self) -> str:
        """Return the property with the errors that prevent motor power."""
        return self.axis.path

    @property
    def name(self) -> str:
        """Return major and minor version as text."""
        return '.'.join(map(str, self.version))

    @property
    def telemetry(self) -> Mapping[str, str]:
        """Return the field of `Telemetry` for each property copied unchanged."""
        return {self.current: 'current', TEMPERATURE: 'temperature',
                MOTOR_TEMPERATURE: 'motor_temperature', BUS_VOLTAGE: 'bus_voltage',
                BUS_CURRENT: 'bus_current'}

    @property
    def fault_properties(self) -> tuple[str, ...]:
        """Return the properties to read before a loss of power is reported."""
        reason = (self.reason,) if self.reason else ()
        return (self.errors, STATE, *reason, *(item.path for item in self.details))

    @property
    def safety_settings(self) -> tuple[str, ...]:
        """Return the settings that bound the torque; they must not change under power."""
        return (WATCHDOG, WATCHDOG_TIMEOUT, *self.torque_limits, self.current_limit,
                self.torque_constant, CONTROL_MODE, INPUT_MODE.name)

    @property
    def polled(self) -> tuple[str, ...]:
        """Return the properties polled in turn: errors and state often, the others once each."""
        reason = (self.reason,) if self.reason else ()
        others = (*self.telemetry, *self.warnings, *reason)
        return tuple(name for other in others for name in (self.errors, STATE, other))

    def faults(self, values: Mapping[str, float], ours: bool) -> tuple[str, ...]:
        """
        Return the names of all faults from the values of the properties.

        A watchdog that expires without power is not a fault: `ours` is whether the driver has
        armed the motor and not stopped it since.  An infinite value is that of a register that
        has an error but was not read yet.
        """
        known = {name: value for name, value in values.items() if not math.isnan(value)}
        armed = known.get(STATE) == CLOSED_LOOP_CONTROL
        bits = int(known.get(self.errors, 0))
        if not (ours or armed):
            bits &= ~self.watchdog_expired
        # The reason of an earlier loss of power is not a fault of an armed motor.
        reason = 0 if armed else int(known.get(self.reason, 0))
        names = self.axis.names_of(bits | reason)
        for register in self.details:
            value = known.get(register.path, 0)
            if math.isinf(value):
                names += (register.path,)
            elif not (register.counts and value in NO_REASON):
                names += register.names_of(value)
        return names


def hardware_name(major: float, minor: float, variant: float) -> str:
    """Return the name of a board; NaN is a number that the board does not report."""
    if major == 3:
        return f'v3.{minor:g}-{variant:g}V'
    name = {4.0: 'Pro', 5.0: 'S1', 6.0: 'Micro'}.get(major, 'board')
    return f'{name} ({in_words((major, minor, variant))})'


INPUT_MODE = Rule('input mode', 'axis0.controller.config.input_mode', (PASSTHROUGH,), {
    0: 'inactive', 1: 'pass through', 2: 'velocity ramp', 3: 'position filter',
    4: 'mix channels', 5: 'trapezoidal trajectory', 6: 'torque ramp', 7: 'mirror', 8: 'tuning'})
MOTOR_TYPES = {0: 'by current', 2: 'by voltage', 3: 'induction'}

# ODrive.ComponentStatus
NOMINAL, RELATIVE_MODE = 0, 9
STATUS = dict(enumerate((
    'NOMINAL', 'NO_RESPONSE', 'INVALID_RESPONSE_LENGTH', 'PARITY_MISMATCH', 'ILLEGAL_HALL_STATE',
    'POLARITY_NOT_CALIBRATED', 'PHASES_NOT_CALIBRATED', 'NUMERICAL_ERROR', 'MISSING_INPUT',
    'RELATIVE_MODE', 'UNCONFIGURED', 'OVERSPEED', 'INDEX_NOT_FOUND', 'BAD_CONFIG', 'NOT_ENABLED',
    'SPINOUT_DETECTED', 'ENCODER_FIELD_TOO_LOW', 'ENCODER_FIELD_TOO_HIGH')))

GENERATION_5 = Generation(
    version=(0, 5), axes=2, one_reply_at_a_time=False, axis=AXIS_5, reason='',
    details=(MOTOR_5, ENCODER_5, CONTROLLER_5, SENSORLESS_5, SYSTEM_5), no_estimate=0x100,
    watchdog_expired=0x800,
    current='axis0.motor.current_control.Iq_measured',
    torque_limits=('axis0.motor.config.torque_lim',),
    current_limit='axis0.motor.config.current_lim',
    torque_constant='axis0.motor.config.torque_constant',
    brake_enabled='config.enable_brake_resistor', brake_resistance='config.brake_resistance',
    warnings=(EFFECTIVE_CURRENT, SATURATED),
    rules=(
        INPUT_MODE, Rule('motor', 'axis0.motor.config.motor_type', (0,), MOTOR_TYPES),
        Rule('encoder', 'axis0.encoder.is_ready', (1,), {0: 'not ready', 1: 'ready'}, CALIBRATE)))

GENERATION_6 = Generation(
    version=(0, 6), axes=1, one_reply_at_a_time=True, axis=AXIS_6, reason=REASON_6.path,
    details=(RESULT_6,), no_estimate=0x8, watchdog_expired=0x1000000,
    current='axis0.motor.foc.Iq_measured',
    torque_limits=('axis0.config.torque_soft_max', 'axis0.config.torque_soft_min'),
    current_limit='axis0.config.motor.current_soft_max',
    torque_constant='axis0.config.motor.torque_constant',
    brake_enabled='config.brake_resistor0.enable',
    brake_resistance='config.brake_resistor0.resistance', warnings=(EFFECTIVE_CURRENT,),
    rules=(
        INPUT_MODE, Rule('motor', 'axis0.config.motor.motor_type', (0,), MOTOR_TYPES),
        Rule('encoder', 'axis0.pos_vel_mapper.status', (NOMINAL, RELATIVE_MODE), STATUS,
             CALIBRATE),
        Rule('commutation', 'axis0.commutation_mapper.status', (NOMINAL,), STATUS, CALIBRATE),
        Rule('position', 'axis0.pos_vel_mapper.config.circular', (0,), {
            0: 'continues over full turns', 1: 'wraps at each turn'}),
        Rule('torque at arming', 'axis0.config.init_torque', (0,), {0: 'none'})))

GENERATIONS = (GENERATION_5, GENERATION_6)
OLDEST = (0, 5, 4)  # CHANGELOG.md of odriverobotics/ODrive


def in_words(version: Sequence[float]) -> str:
    """Return a version as text."""
    return '.'.join(f'{part:g}' for part in version)


def generation_of(version: Sequence[float], axis: int, port: str) -> Generation:
    """
    Return the generation of a firmware, for a motor output of the board on a port.

    Raises `DriveError` with reason ``firmware`` if the version, or such an output in it, is
    unknown or not supported.
    """
    name = in_words(version)
    if tuple(version[:2]) == OLDEST[:2] and not version[2] >= OLDEST[2]:
        raise DriveError(
            f'{port}: ODrive firmware 0.5 must be 0.5.4 or later, got {name}: before 0.5.4 states '
            'and errors are answered as "1d" instead of 1 and cannot be written, and 0.5.1 has '
            'no command "sc", which clears errors; update it with: odrivetool dfu',
            'firmware', 'firmware')
    found = [item for item in GENERATIONS if item.version == tuple(version[:2])]
    if not found:
        names = ' or '.join(item.name for item in GENERATIONS)
        raise DriveError(
            f'{port}: ODrive firmware must be {names}, got {name}: older ones interpret a '
            'torque command as amperes; names and meanings in newer ones are unknown',
            'firmware', 'firmware')
    if axis >= found[0].axes:
        raise DriveError(
            f'{port}: an ODrive with firmware {name} has one motor output, so axis must be 0, '
            f'got {axis}', 'firmware', 'axis')
    return found[0]
