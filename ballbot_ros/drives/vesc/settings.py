# SPDX-License-Identifier: Apache-2.0
"""
Settings of a VESC that limit a motion, and their layout in each firmware.

Settings are one long sequence of numbers without names, at offsets that depend on the firmware.
Only the head of the sequence is read.  5.03 writes many numbers as two-byte integers that 5.02
wrote as four-byte floats; 6.05 changed more numbers, and inserted new ones; the head is the same
in all later versions up to 7.01.  The offsets of the rest (observer, encoder, position controller)
change with nearly every firmware, so the rest is not read.

Source: confgenerator.c of vedderb/bldc, tags 5.00 to 6.00, branches release_6_02, release_6_05,
release_6_06, release_7_00 and master (7.01); effect of the limits: update_override_limits() of
motor/mc_interface.c; applications and kill switch: datatypes.h.
"""
from dataclasses import dataclass
import math
import struct
from typing import Mapping, NamedTuple, Optional

from ballbot_ros.config.fields import count, flag, quantity
from ballbot_ros.drives.contract import DriveOptions, judge_torque, Setting, shown
from ballbot_ros.drives.vesc.uart.codec import GET_APPCONF, GET_MCCONF, Values


@dataclass(frozen=True)
class VescOptions(DriveOptions):
    """The options of a VESC driver."""

    torque_constant: float = quantity(
        'N m/A', 'motor torque per ampere; of a brushless motor 1.5 pole pairs x flux linkage',
        default=0.025, above=0.0)
    pole_pairs: int = count('pole pairs of the motor', default=7, minimum=1)
    encoder: bool = flag('the motor has an encoder, whose angle is finer than the commutation',
                         default=True)


Version = tuple[int, int]  # of a firmware

# The first whose values end with a status; without it a timeout or a kill switch is undetected.
OLDEST: Version = (5, 3)
NEWEST_MAJOR = 7
# The layout of the settings differs between test builds of these versions.
MOVING: tuple[Version, ...] = ((5, 3), (6, 0), (6, 5))

# Name in the firmware -> format and divisor of an integer; in their order.
Layout = Mapping[str, tuple[str, float]]
_CURRENTS: Layout = {
    'l_current_max': ('f', 1.0), 'l_current_min': ('f', 1.0), 'l_in_current_max': ('f', 1.0),
    'l_in_current_min': ('f', 1.0)}
_SPEEDS: Layout = {
    'l_abs_current_max': ('f', 1.0), 'l_min_erpm': ('f', 1.0), 'l_max_erpm': ('f', 1.0),
    'l_erpm_start': ('h', 1e4), 'l_max_erpm_fbrake': ('f', 1.0),
    'l_max_erpm_fbrake_cc': ('f', 1.0)}
_VOLTAGES = ('l_min_vin', 'l_max_vin', 'l_battery_cut_start', 'l_battery_cut_end')
_TEMPERATURES = ('l_temp_fet_start', 'l_temp_fet_end', 'l_temp_motor_start', 'l_temp_motor_end')
_POWER: Layout = {
    'l_temp_accel_dec': ('h', 1e4), 'l_min_duty': ('h', 1e4), 'l_max_duty': ('h', 1e4),
    'l_watt_max': ('f', 1.0), 'l_watt_min': ('f', 1.0), 'l_current_max_scale': ('h', 1e4),
    'l_current_min_scale': ('h', 1e4)}
SINCE_5_03: Layout = {
    **_CURRENTS, **_SPEEDS, **dict.fromkeys(_VOLTAGES, ('f', 1.0)),
    'l_slow_abs_current': ('B', 1.0), **dict.fromkeys(_TEMPERATURES, ('h', 10.0)), **_POWER}
SINCE_6_05: Layout = {
    **_CURRENTS, 'l_in_current_map_start': ('h', 1e4), 'l_in_current_map_filter': ('h', 1e4),
    **_SPEEDS, **dict.fromkeys(_VOLTAGES, ('h', 10.0)),
    'l_battery_regen_cut_start': ('h', 10.0), 'l_battery_regen_cut_end': ('h', 10.0),
    'l_slow_abs_current': ('B', 1.0), **dict.fromkeys(_TEMPERATURES, ('B', 1.0)), **_POWER}
# Before them: message, signature, and four bytes of modulation and motor type.
_MOTOR_HEAD = 9

KILL_SWITCHES = (
    'off', 'PPM low', 'PPM high', 'ADC2 low', 'ADC2 high', 'ADC3 low', 'ADC3 high', 'SWDIO low',
    'SWDIO high', 'SWCLK low', 'SWCLK high')
# Applications that may command the motor; with APP_NONE and APP_UART only this line does.
APPLICATIONS = ('none', 'PPM', 'ADC', 'UART', 'PPM and UART', 'ADC and UART', 'Nunchuk', 'NRF',
                'custom')
ALONE = ('none', 'UART')


class Application(NamedTuple):
    """Settings read from a ``GET_APPCONF``."""

    timeout: float  # [s]; 0 for never
    brake_current: float  # when the timeout expires [A]
    kill_switch: str  # one of `KILL_SWITCHES`
    application: str  # one of `APPLICATIONS`


def why_not(version: Version, test: int) -> str:
    """Return why a firmware, or a test build (0 for none), is not supported; empty if it is."""
    if version < OLDEST:
        return ('its values end without the status of timeout and kill switch, and '
                'its settings have another layout (5.03 changed both)')
    if version[0] > NEWEST_MAJOR:
        return 'the layout of its settings is unknown'
    if test and version in MOVING:
        return f'it is test build {test}, and the layout of settings differs between test builds'
    return ''


def layout_of(version: Version) -> Layout:
    """Return the layout of the motor limits in a firmware."""
    return SINCE_6_05 if version >= (6, 5) else SINCE_5_03


def _struct_of(layout: Layout) -> struct.Struct:
    return struct.Struct('>' + ''.join(form for form, _ in layout.values()))


def parse_limits(payload: bytes, version: Version) -> Optional[Mapping[str, float]]:
    """Return the limits of a ``GET_MCCONF`` by their names, None if it is not one."""
    layout = layout_of(version)
    form = _struct_of(layout)
    if len(payload) < _MOTOR_HEAD + form.size or payload[0] != GET_MCCONF:
        return None
    values = form.unpack_from(payload, _MOTOR_HEAD)
    return {name: value / scale for value, (name, (_, scale)) in zip(values, layout.items())}


def pack_limits(limits: Mapping[str, float], version: Version) -> bytes:
    """Return the head of a ``GET_MCCONF``, as the firmware sends it."""
    layout = layout_of(version)
    return struct.pack('>BIBBBB', GET_MCCONF, 0, 1, 0, 2, 2) + _struct_of(layout).pack(*(
        limits[name] if form == 'f' else int(limits[name] * scale)
        for name, (form, scale) in layout.items()))


def _application_offset(version: Version) -> int:
    """Return the offset of the kill switch mode in a ``GET_APPCONF``; next is the app."""
    return 33 if version >= (6, 0) else 29


def parse_application(payload: bytes, version: Version) -> Optional[Application]:
    """Return the settings of a ``GET_APPCONF``, None if it is not one."""
    offset = _application_offset(version)
    if len(payload) < offset + 2 or payload[0] != GET_APPCONF:
        return None
    milliseconds, brake = struct.unpack_from('>If', payload, 6)
    return Application(milliseconds / 1000.0, brake, _name(KILL_SWITCHES, payload[offset]),
                       _name(APPLICATIONS, payload[offset + 1]))


def pack_application(settings: Application, version: Version) -> bytes:
    """Return the head of a ``GET_APPCONF``, as the firmware sends it."""
    head = struct.pack('>BIBIf', GET_APPCONF, 0, 1, round(1000.0 * settings.timeout),
                       settings.brake_current)
    return head.ljust(_application_offset(version), b'\0') + bytes((
        KILL_SWITCHES.index(settings.kill_switch), APPLICATIONS.index(settings.application)))


def _name(names: tuple[str, ...], number: int) -> str:
    return names[number] if number < len(names) else f'number {number}'


# Period of the thread that checks the timeout (timeout.c) [s].
THREAD = 0.01
# With `l_temp_accel_dec` 1, driving is cut from this temperature on [degC].
CURRENT_CUT_TEMPERATURE = 25.0
# Settings that could not be read: none of them is acceptable.
UNKNOWN = Application(math.nan, math.nan, 'unknown', 'unknown')
UNKNOWN_LIMITS: Mapping[str, float] = dict.fromkeys(SINCE_6_05, math.nan)
MOTOR, GENERAL = 'VESC Tool, Motor Settings', 'VESC Tool, App Settings, General'


def judge(app: Application, limits: Mapping[str, float], options: VescOptions,
          bus_voltage: float) -> tuple[Setting, ...]:
    """
    Return the safety-relevant settings, and whether each is acceptable.

    See `parse_limits` for the limits; the voltage is the present one of the supply [V].
    """
    needed = options.torque_limit * options.speed_limit
    return (
        _torque(limits, options), _watchdog(app, options),
        Setting('brake current on timeout', shown(app.brake_current, 'A'), '0 A: coast',
                app.brake_current == 0.0, f'{GENERAL}: Timeout Brake Current 0'),
        Setting('commands from', app.application, ' or '.join(ALONE) + ': only this line',
                app.application in ALONE, f'{GENERAL}: APP to Use UART'),
        Setting('kill switch', app.kill_switch, 'any', app != UNKNOWN),
        _power('driving power', limits, 'max', 'Battery Current Max', 'Maximum Wattage', needed,
               bus_voltage),
        _power('braking power', limits, 'min', 'Battery Current Max Regen',
               'Maximum Braking Wattage', needed, bus_voltage),
        _supply(limits, bus_voltage), _speed(limits, options), _trip(limits, options),
        Setting('full torque below', ', '.join(
            f'{shown(cut_from(limits, part), "degC")} ({name})'
            for part, name in (('fet', 'power stage'), ('motor', 'motor'))), 'any',
            not math.isnan(cut_from(limits, 'fet'))))


def cut_from(limits: Mapping[str, float], part: str) -> float:
    """Return the temperature above which driving torque is cut [degC]; `part` is fet or motor."""
    start = limits[f'l_temp_{part}_start']
    return start + limits['l_temp_accel_dec'] * (CURRENT_CUT_TEMPERATURE - start)


def warnings_of(values: Values, limits: Mapping[str, float]) -> tuple[str, ...]:
    """Return the limits that now cut the torque, named as in VESC Tool; omit unknown ones."""
    fraction = limits['l_erpm_start']
    reached = {
        'MOSFET_TEMP_CUTOFF': values.temperature > cut_from(limits, 'fet'),
        'MOTOR_TEMP_CUTOFF': values.motor_temperature > cut_from(limits, 'motor'),
        'BATTERY_VOLTAGE_CUTOFF': values.bus_voltage < limits['l_battery_cut_start'],
        'BATTERY_VOLTAGE_REGEN_CUTOFF':
            values.bus_voltage > limits.get('l_battery_regen_cut_start', math.inf),
        'ERPM_LIMIT': values.erpm < fraction * limits['l_min_erpm']
        or values.erpm > fraction * limits['l_max_erpm']}
    return tuple(name for name, is_reached in reached.items() if is_reached)


def _torque(limits: Mapping[str, float], options: VescOptions) -> Setting:
    most = limits['l_current_max'] * limits['l_current_max_scale']
    least = limits['l_current_min'] * limits['l_current_min_scale']
    # max may return either argument if one is NaN.
    ceiling = options.torque_constant * (
        max(most, -least) if most - least < math.inf else math.nan)
    return judge_torque(
        ceiling, options, f'{MOTOR}, Current: Motor Current Max and Max Brake '
        f'{options.own_limit / options.torque_constant:.3g} A')


def _watchdog(app: Application, options: VescOptions) -> Setting:
    wanted = max(options.watchdog - THREAD, 0.5 * options.watchdog)
    return Setting(
        'watchdog', 'off' if app.timeout == 0.0 else shown(app.timeout + THREAD, 's'),
        f'at most {wanted + THREAD:g} s, of which the drive needs {THREAD:g} s to detect it',
        0.0 < app.timeout <= wanted + 1e-6,
        f'{GENERAL}: Timeout {1000.0 * wanted:.0f} ms')


def _power(name: str, limits: Mapping[str, float], end: str, current: str, wattage: str,
           needed: float, bus_voltage: float) -> Setting:
    """Check that the supply may provide, or absorb, the power of full torque at full speed."""
    least = min(abs(limits[f'l_in_current_{end}']) * bus_voltage, abs(limits[f'l_watt_{end}']))
    sign = 1.0 if end == 'max' else -1.0
    return Setting(
        name, shown(least, 'W'), f'at least {needed:.3g} W, or the torque is cut at high speed',
        least > 0.0 and least >= needed,
        f'{MOTOR}, Current: {current} {sign * max(needed / bus_voltage, 1.0):.3g} A or beyond, '
        f'and {wattage} {sign * max(needed, 1.0):.3g} W or beyond'
        if bus_voltage > 0.0 else '')


def _supply(limits: Mapping[str, float], bus_voltage: float) -> Setting:
    lowest = max(limits['l_min_vin'], limits['l_battery_cut_start'])
    highest = min(limits['l_max_vin'], limits.get('l_battery_regen_cut_start', math.inf))
    return Setting(
        'supply', shown(bus_voltage, 'V'),
        f'between {shown(lowest, "V")} and {shown(highest, "V")}, or the torque is cut',
        lowest < bus_voltage < highest,
        f'{MOTOR}, Voltage: Battery Voltage Cutoff Start below it, Regen Cutoff Start and Maximum '
        'Input Voltage above it')


def _speed(limits: Mapping[str, float], options: VescOptions) -> Setting:
    per_minute = options.pole_pairs * 60.0 / math.tau
    highest = min(limits['l_max_erpm'], -limits['l_min_erpm']) * limits['l_erpm_start'] \
        / per_minute
    return Setting(
        'speed limit', shown(highest, 'rad/s'),
        f'at least {options.speed_limit:.4g} rad/s, or the torque is cut',
        highest > 0.0 and highest >= options.speed_limit,
        f'{MOTOR}, Speed: Max ERPM and Max ERPM Reverse times ERPM Limit Start at least '
        f'{options.speed_limit * per_minute:.0f}')


def _trip(limits: Mapping[str, float], options: VescOptions) -> Setting:
    needed = options.torque_limit / options.torque_constant
    trip = limits['l_abs_current_max']
    return Setting(
        'over-current trip', shown(trip, 'A'), f'more than {needed:.3g} A', trip > needed,
        f'{MOTOR}, Current: Absolute Maximum Current 1.5 to 2 times that')
