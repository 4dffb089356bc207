# SPDX-License-Identifier: Apache-2.0
"""
What an ODrive calls its properties and errors, and how it must be set: a table per generation.

Sources.  For 0.5: Firmware/odrive-interface.yaml in odriverobotics/ODrive, at fw-v0.5.  For 0.6,
which runs on Pro, S1 and Micro: names of properties from a list of all endpoints of a 0.6 board,
as the maker generates it (flat_endpoints.json); names of errors, states and boards from the
maker's Python package `odrive`, 0.6.11 (enums.py, hw_version.py).  The maker's sentences about the
properties were not at hand.  So what they mean follows from their names, and from what users of
0.6.11 measured: that `init_torque` becomes the torque at arming, that a position which is not
`circular` goes on over full turns, and that an error may go by itself.

Guessed for 0.6: that `torque_soft_min`, `torque_soft_max` and `current_soft_max` bound the torque
command as `torque_lim` and `current_lim` did; that an encoder in RELATIVE_MODE will do, because
nothing here rests on where zero is; that feedback is not valid while an estimate is
missing; that `disarm_reason` stays after the error has gone.
"""
from dataclasses import dataclass
import math
from types import MappingProxyType
from typing import Any, Callable, Mapping, NamedTuple, Sequence

from ballbot_ros.drives.contract import bit_names, DriveOptions, Setting, Telemetry
from ballbot_ros.drives.odrive import codec
from ballbot_ros.errors import DriveError

# The same in both generations.  `axis0` stands for the motor output in use.
STATE, REQUESTED_STATE = 'axis0.current_state', 'axis0.requested_state'
CONTROL_MODE = 'axis0.controller.config.control_mode'
WATCHDOG, WATCHDOG_TIMEOUT = 'axis0.config.enable_watchdog', 'axis0.config.watchdog_timeout'
BUS_VOLTAGE = 'vbus_voltage'
TEMPERATURE = 'axis0.motor.fet_thermistor.temperature'
MOTOR_TEMPERATURE = 'axis0.motor.motor_thermistor.temperature'
VERSION = ('fw_version_major', 'fw_version_minor', 'fw_version_revision')
HARDWARE = ('hw_version_major', 'hw_version_minor', 'hw_version_variant')
SERIAL_NUMBER = 'serial_number'

CALIBRATE = f'w {REQUESTED_STATE} 3 (calibrates: the motor turns)'


class Rule(NamedTuple):
    """A property that must have one of some values."""

    setting: str
    name: str
    wanted: tuple[int, ...]
    words: Mapping[int, str]  # what values mean
    remedy: str = ''  # to write the first wanted value if not given


@dataclass(frozen=True)
class Generation:
    """
    What one generation of the firmware calls things; names as in the maker's reference.

    Attributes
    ----------
    version : tuple of int
        Major and minor.
    axes : int
        Motor outputs of a board.
    one_reply_at_a_time : bool
        A reply is lost if the one before it is still being sent.
    errors, error_names
        Property with the errors that keep the motor from power, and the names of its bits.
    reason : str
        Property with the errors that last took the power away; empty if there is none.
    no_estimate : int
        Bit of the error with which position and velocity are not valid.
    result, result_names
        Property that says why a wanted state was not reached; empty if there is none.
    current : str
        Property with the motor current that makes torque.
    torque_limits : tuple of str
        Properties whose size bounds the torque.
    current_limit, torque_constant : str
        Properties whose product bounds it, too.
    rules : tuple of Rule

    """

    version: tuple[int, int]
    axes: int
    one_reply_at_a_time: bool
    errors: str
    error_names: Mapping[int, str]
    reason: str
    no_estimate: int
    result: str
    result_names: Mapping[int, str]
    current: str
    torque_limits: tuple[str, ...]
    current_limit: str
    torque_constant: str
    rules: tuple[Rule, ...]

    @property
    def name(self) -> str:
        """Return major and minor as people write them."""
        return '.'.join(map(str, self.version))

    @property
    def telemetry(self) -> Mapping[str, str]:
        """Return the field of `Telemetry` for each property that goes there as it is."""
        return {self.current: 'current', TEMPERATURE: 'temperature',
                MOTOR_TEMPERATURE: 'motor_temperature', BUS_VOLTAGE: 'bus_voltage'}

    @property
    def polled(self) -> tuple[str, ...]:
        """Return what is polled in turn: errors and state often, the others once each."""
        others = (*self.telemetry, self.reason) if self.reason else self.telemetry
        return tuple(name for other in others for name in (self.errors, STATE, other))

    def names_of(self, bits: float) -> tuple[str, ...]:
        """Return the names of error bits; unknown ones in hexadecimal."""
        return bit_names(int(bits), self.error_names)

    def why(self, result: float, bits: float) -> str:
        """Return why a state was not reached, from the values of `result` and `reason`."""
        names = self.names_of(bits) if math.isfinite(bits) else ()
        if math.isfinite(result):
            names = (self.result_names.get(int(result), f'{result:g}'), *names)
        return ', '.join(names) or 'no reason'

    def updated(self, telemetry: Telemetry, name: str, values: Mapping[str, float],
              now: float) -> Telemetry:
        """Return telemetry with the value of a property that came last, of all that have come."""
        if name in self.telemetry:
            reported: dict[str, Any] = {self.telemetry[name]: values[name]}
            return telemetry._replace(**reported)
        if name == STATE:
            return telemetry._replace(
                status_time=now, armed=values[STATE] == codec.CLOSED_LOOP_CONTROL)
        if name not in (self.errors, self.reason):
            return telemetry
        # What took the power away last time is no fault of a motor that has it again.
        reason = 0.0 if telemetry.armed else values.get(self.reason, 0.0)
        bits = int(values.get(self.errors, 0.0)) | int(reason)
        return telemetry._replace(status_time=now, faults=self.names_of(bits))

    def judge(self, read: Callable[[str], float], options: DriveOptions) -> tuple[Setting, ...]:
        """
        Read back every setting that safety rests on, and judge it.

        Parameters
        ----------
        read : callable
            Returns the value of a property, NaN if there is no such property.
        options : DriveOptions

        """
        limit, watchdog = options.torque_limit, options.watchdog
        bounds = [abs(read(name)) for name in self.torque_limits]
        currents = read(self.current_limit) * read(self.torque_constant)
        # A bound that is not known is none, and a torque constant below zero is no bound either.
        ceiling = math.nan if math.isnan(sum(bounds) + currents) or currents < 0.0 \
            else min(max(bounds), currents)
        enabled, timeout = read(WATCHDOG) == 1.0, read(WATCHDOG_TIMEOUT)
        return (
            Setting('torque limit', _reading(ceiling, ' N m'), f'at most {limit:g} N m',
                    ceiling <= 1.01 * limit, ', '.join(
                        _write(name, -limit if name.endswith('min') else limit)
                        for name in self.torque_limits)),
            Setting('watchdog', _reading(timeout, ' s') if enabled else 'off',
                    f'at most {watchdog:g} s', enabled and 0.0 < timeout <= 1.01 * watchdog,
                    f'{_write(WATCHDOG_TIMEOUT, watchdog)}, {_write(WATCHDOG, 1)}'),
            *(self._judge_rule(rule, read(rule.name)) for rule in self.rules))

    def _judge_rule(self, rule: Rule, value: float) -> Setting:
        words = f' ({rule.words[int(value)]})' if value in rule.words else ''
        wanted = ' or '.join(f'{item} ({rule.words[item]})' for item in rule.wanted)
        return Setting(rule.setting, _reading(value, words), wanted, value in rule.wanted,
                       rule.remedy or _write(rule.name, rule.wanted[0]))


def _reading(value: float, unit: str) -> str:
    return 'unknown' if math.isnan(value) else f'{value:.4g}{unit}'


def _write(name: str, value: float) -> str:
    """Return what a person types to change a setting."""
    return f'w {name} {value:g}'


def hardware_name(major: float, minor: float, variant: float) -> str:
    """Return what a board is called; not a number is a part that it does not report."""
    if major == 3:
        return f'v3.{minor:g}-{variant:g}V'
    name = {4.0: 'Pro', 5.0: 'S1', 6.0: 'Micro'}.get(major, 'board')
    return f'{name} ({in_words((major, minor, variant))})'


INPUT_MODE = Rule('input mode', 'axis0.controller.config.input_mode', (codec.PASSTHROUGH,), {
    0: 'inactive', 1: 'pass through', 2: 'velocity ramp', 3: 'position filter',
    4: 'mix channels', 5: 'trapezoidal trajectory', 6: 'torque ramp', 7: 'mirror', 8: 'tuning'})
MOTOR_TYPES = {0: 'by current', 2: 'by voltage', 3: 'induction'}

# ODrive.ComponentStatus
NOMINAL, RELATIVE_MODE = 0, 9
STATUS = MappingProxyType(dict(enumerate((
    'NOMINAL', 'NO_RESPONSE', 'INVALID_RESPONSE_LENGTH', 'PARITY_MISMATCH', 'ILLEGAL_HALL_STATE',
    'POLARITY_NOT_CALIBRATED', 'PHASES_NOT_CALIBRATED', 'NUMERICAL_ERROR', 'MISSING_INPUT',
    'RELATIVE_MODE', 'UNCONFIGURED', 'OVERSPEED', 'INDEX_NOT_FOUND', 'BAD_CONFIG', 'NOT_ENABLED',
    'SPINOUT_DETECTED', 'ENCODER_FIELD_TOO_LOW', 'ENCODER_FIELD_TOO_HIGH'))))

GENERATION_5 = Generation(
    version=(0, 5), axes=2, one_reply_at_a_time=False, errors='axis0.error',
    error_names=MappingProxyType({
        0x1: 'INVALID_STATE', 0x40: 'MOTOR_FAILED', 0x80: 'SENSORLESS_ESTIMATOR_FAILED',
        0x100: 'ENCODER_FAILED', 0x200: 'CONTROLLER_FAILED', 0x800: 'WATCHDOG_TIMER_EXPIRED',
        0x1000: 'MIN_ENDSTOP_PRESSED', 0x2000: 'MAX_ENDSTOP_PRESSED', 0x4000: 'ESTOP_REQUESTED',
        0x20000: 'HOMING_WITHOUT_ENDSTOP', 0x40000: 'OVER_TEMP', 0x80000: 'UNKNOWN_POSITION'}),
    reason='', no_estimate=0x100, result='', result_names=MappingProxyType({}),
    current='axis0.motor.current_control.Iq_measured',
    torque_limits=('axis0.motor.config.torque_lim',),
    current_limit='axis0.motor.config.current_lim',
    torque_constant='axis0.motor.config.torque_constant',
    rules=(
        INPUT_MODE, Rule('motor', 'axis0.motor.config.motor_type', (0,), MOTOR_TYPES),
        Rule('encoder', 'axis0.encoder.is_ready', (1,), {0: 'not ready', 1: 'ready'}, CALIBRATE)))

GENERATION_6 = Generation(
    version=(0, 6), axes=1, one_reply_at_a_time=True, errors='axis0.active_errors',
    error_names=MappingProxyType({
        0x1: 'INITIALIZING', 0x2: 'SYSTEM_LEVEL', 0x4: 'TIMING_ERROR', 0x8: 'MISSING_ESTIMATE',
        0x10: 'BAD_CONFIG', 0x20: 'DRV_FAULT', 0x40: 'MISSING_INPUT',
        0x100: 'DC_BUS_OVER_VOLTAGE', 0x200: 'DC_BUS_UNDER_VOLTAGE',
        0x400: 'DC_BUS_OVER_CURRENT', 0x800: 'DC_BUS_OVER_REGEN_CURRENT',
        0x1000: 'CURRENT_LIMIT_VIOLATION', 0x2000: 'MOTOR_OVER_TEMP',
        0x4000: 'INVERTER_OVER_TEMP', 0x8000: 'VELOCITY_LIMIT_VIOLATION',
        0x10000: 'POSITION_LIMIT_VIOLATION', 0x20000: 'REQUESTED_CURRENT_TOO_HIGH',
        0x1000000: 'WATCHDOG_TIMER_EXPIRED', 0x2000000: 'ESTOP_REQUESTED',
        0x4000000: 'SPINOUT_DETECTED', 0x8000000: 'BRAKE_RESISTOR_DISARMED',
        0x10000000: 'THERMISTOR_DISCONNECTED', 0x40000000: 'CALIBRATION_ERROR'}),
    reason='axis0.disarm_reason', no_estimate=0x8, result='axis0.procedure_result',
    result_names=MappingProxyType(dict(enumerate((
        'SUCCESS', 'BUSY', 'CANCELLED', 'DISARMED', 'NO_RESPONSE', 'POLE_PAIR_CPR_MISMATCH',
        'PHASE_RESISTANCE_OUT_OF_RANGE', 'PHASE_INDUCTANCE_OUT_OF_RANGE', 'UNBALANCED_PHASES',
        'INVALID_MOTOR_TYPE', 'ILLEGAL_HALL_STATE', 'TIMEOUT', 'HOMING_WITHOUT_ENDSTOP',
        'INVALID_STATE', 'NOT_CALIBRATED', 'NOT_CONVERGING', 'REQUESTED_CURRENT_TOO_HIGH')))),
    current='axis0.motor.foc.Iq_measured',
    torque_limits=('axis0.config.torque_soft_max', 'axis0.config.torque_soft_min'),
    current_limit='axis0.config.motor.current_soft_max',
    torque_constant='axis0.config.motor.torque_constant',
    rules=(
        INPUT_MODE, Rule('motor', 'axis0.config.motor.motor_type', (0,), MOTOR_TYPES),
        Rule('encoder', 'axis0.pos_vel_mapper.status', (NOMINAL, RELATIVE_MODE), STATUS,
             CALIBRATE),
        Rule('commutation', 'axis0.commutation_mapper.status', (NOMINAL,), STATUS, CALIBRATE),
        Rule('position', 'axis0.pos_vel_mapper.config.circular', (0,), {
            0: 'goes on over full turns', 1: 'starts anew each turn'}),
        Rule('torque at arming', 'axis0.config.init_torque', (0,), {0: 'none'})))

GENERATIONS = (GENERATION_5, GENERATION_6)


def in_words(version: Sequence[float]) -> str:
    """Return a version as people write it."""
    return '.'.join(f'{part:g}' for part in version)


def generation_of(version: Sequence[float], axis: int, port: str) -> Generation:
    """
    Return the generation of a firmware, for a motor output of the board on a port.

    Raises
    ------
    DriveError
        ``firmware`` if the version, or such an output in it, is not known.

    """
    name = in_words(version)
    found = [item for item in GENERATIONS if item.version == tuple(version[:2])]
    if not found:
        names = ' or '.join(item.name for item in GENERATIONS)
        raise DriveError('firmware', (
            f'{port}: ODrive firmware must be {names}, got {name}: older ones take a torque '
            'command for amperes, names and meanings in newer ones are not known'))
    if axis >= found[0].axes:
        raise DriveError('firmware', (
            f'{port}: an ODrive with firmware {name} has one motor output, so axis must be 0, '
            f'got {axis}'))
    return found[0]
