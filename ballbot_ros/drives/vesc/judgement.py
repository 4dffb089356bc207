# SPDX-License-Identifier: Apache-2.0
"""
What the settings of a VESC do to a robot, judged before it moves.

A VESC that runs into one of its limits says nothing: the current is cut and the status stays
clean.  So each limit must lie outside what the robot needs, and where one is reached all the same
there is a warning.  Source: update_override_limits() of motor/mc_interface.c, bldc 5.03 to 7.01.
"""
import math
from typing import Mapping, NamedTuple, Optional

from ballbot_ros.drives.contract import Setting
from ballbot_ros.drives.vesc.codec import Values
from ballbot_ros.drives.vesc.options import VescOptions
from ballbot_ros.drives.vesc.settings import ALONE, Application, Layout

# The thread that looks at the timeout runs every 10 ms (timeout.c) [s].
THREAD = 0.01
# With `l_temp_accel_dec` 1, driving is cut from this temperature on [degC].
COLD = 25.0
UNKNOWN = Application(math.nan, math.nan, 'unknown', 'unknown')
MOTOR, GENERAL = 'VESC Tool, Motor Settings', 'VESC Tool, App Settings, General'


def unknown_limits(layout: Layout) -> Mapping[str, float]:
    """Return limits that could not be read: none of them is acceptable."""
    return dict.fromkeys(layout, math.nan)


def judge(application: Optional[Application], limits: Mapping[str, float],
          options: VescOptions, bus_voltage: float) -> tuple[Setting, ...]:
    """
    Return the settings that matter, and whether each is acceptable.

    Parameters
    ----------
    application : Application or None
        None where it could not be read.
    limits : mapping of str to float
        See `parse_limits`.
    options : VescOptions
    bus_voltage : float
        Of the supply, now [V].

    """
    app = application or UNKNOWN
    needed = options.torque_limit * options.speed_limit
    return (
        _torque(limits, options), _watchdog(app, options),
        Setting('brake current on timeout', _shown(app.brake_current, 'A'), '0 A: coast',
                app.brake_current == 0.0, f'{GENERAL}: Timeout Brake Current 0'),
        Setting('commands from', app.application, ' or '.join(ALONE) + ': this line alone',
                app.application in ALONE, f'{GENERAL}: APP to Use UART'),
        Setting('kill switch', app.kill_switch, 'any', app != UNKNOWN),
        _power('driving power', limits, 'max', 'Battery Current Max', 'Maximum Wattage', needed,
               bus_voltage),
        _power('braking power', limits, 'min', 'Battery Current Max Regen',
               'Maximum Braking Wattage', needed, bus_voltage),
        _supply(limits, bus_voltage), _speed(limits, options), _trip(limits, options),
        Setting('full torque below', ', '.join(
            f'{_shown(cut_from(limits, part), "degC")} ({name})'
            for part, name in (('fet', 'power stage'), ('motor', 'motor'))), 'any',
            not math.isnan(cut_from(limits, 'fet'))))


def cut_from(limits: Mapping[str, float], part: str) -> float:
    """Return the temperature above which driving torque is cut [degC]; part fet or motor."""
    start = limits[f'l_temp_{part}_start']
    return start + limits['l_temp_accel_dec'] * (COLD - start)


class FullTorqueRange(NamedTuple):
    """Within which a VESC gives all of its torque; see `full_torque_range`."""

    temperature: float  # of the power stage, at most [degC]
    motor_temperature: float  # at most [degC]
    lowest_voltage: float  # of the supply [V]
    highest_voltage: float  # [V]
    least_erpm: float
    most_erpm: float


def full_torque_range(limits: Mapping[str, float]) -> FullTorqueRange:
    """Return within what the limits cut nothing; NaN where that is unknown."""
    share = limits['l_erpm_start']
    return FullTorqueRange(
        cut_from(limits, 'fet'), cut_from(limits, 'motor'), limits['l_battery_cut_start'],
        limits.get('l_battery_regen_cut_start', math.inf), share * limits['l_min_erpm'],
        share * limits['l_max_erpm'])


def warnings_of(values: Values, within: FullTorqueRange) -> tuple[str, ...]:
    """Return which limits are reached and cut the torque, named as in VESC Tool."""
    heat, motor_heat, lowest, highest, least, most = within
    if (values.temperature <= heat and values.motor_temperature <= motor_heat
            and lowest <= values.bus_voltage <= highest and least <= values.erpm <= most):
        return ()
    reached = {
        'MOSFET_TEMP_CUTOFF': values.temperature > heat,
        'MOTOR_TEMP_CUTOFF': values.motor_temperature > motor_heat,
        'BATTERY_VOLTAGE_CUTOFF': values.bus_voltage < lowest,
        'BATTERY_VOLTAGE_REGEN_CUTOFF': values.bus_voltage > highest,
        'ERPM_LIMIT': values.erpm > most or values.erpm < least}
    return tuple(name for name, is_reached in reached.items() if is_reached)


def _shown(value: float, unit: str) -> str:
    return 'unknown' if math.isnan(value) else f'{value:.4g} {unit}'


def _torque(limits: Mapping[str, float], options: VescOptions) -> Setting:
    most = limits['l_current_max'] * limits['l_current_max_scale']
    least = limits['l_current_min'] * limits['l_current_min_scale']
    # Of what is no number max may return either.
    ceiling = options.torque_constant * (
        max(most, -least) if most - least < math.inf else math.nan)
    return Setting(
        'torque limit', _shown(ceiling, 'N m'), f'at most {options.own_limit:g} N m',
        ceiling <= 1.01 * options.own_limit,
        f'{MOTOR}, Current: Motor Current Max and Max Brake '
        f'{options.own_limit / options.torque_constant:.3g} A')


def _watchdog(app: Application, options: VescOptions) -> Setting:
    wanted = max(options.watchdog - THREAD, 0.5 * options.watchdog)
    return Setting(
        'watchdog', 'off' if app.timeout == 0.0 else _shown(app.timeout + THREAD, 's'),
        f'at most {wanted + THREAD:g} s, of which the drive takes {THREAD:g} s to notice',
        0.0 < app.timeout <= wanted + 1e-6,
        f'{GENERAL}: Timeout {1000.0 * wanted:.0f} ms')


def _power(name: str, limits: Mapping[str, float], end: str, current: str, wattage: str,
           needed: float, bus_voltage: float) -> Setting:
    """Return whether the supply may give, or take, the power of full torque at full speed."""
    least = min(abs(limits[f'l_in_current_{end}']) * bus_voltage, abs(limits[f'l_watt_{end}']))
    sign = 1.0 if end == 'max' else -1.0
    return Setting(
        name, _shown(least, 'W'), f'at least {needed:.3g} W, or torque goes missing at speed',
        least > 0.0 and least >= needed,
        f'{MOTOR}, Current: {current} {sign * max(needed / bus_voltage, 1.0):.3g} A or beyond, '
        f'and {wattage} {sign * max(needed, 1.0):.3g} W or beyond'
        if bus_voltage > 0.0 else '')


def _supply(limits: Mapping[str, float], bus_voltage: float) -> Setting:
    lowest = max(limits['l_min_vin'], limits['l_battery_cut_start'])
    highest = min(limits['l_max_vin'], limits.get('l_battery_regen_cut_start', math.inf))
    return Setting(
        'supply', _shown(bus_voltage, 'V'),
        f'between {_shown(lowest, "V")} and {_shown(highest, "V")}, or torque goes missing',
        lowest < bus_voltage < highest,
        f'{MOTOR}, Voltage: Battery Voltage Cutoff Start below it, Regen Cutoff Start and Maximum '
        'Input Voltage above it')


def _speed(limits: Mapping[str, float], options: VescOptions) -> Setting:
    per_minute = options.pole_pairs * 60.0 / math.tau
    highest = min(limits['l_max_erpm'], -limits['l_min_erpm']) * limits['l_erpm_start'] \
        / per_minute
    return Setting(
        'speed limit', _shown(highest, 'rad/s'),
        f'at least {options.speed_limit:.4g} rad/s, or torque goes missing',
        highest > 0.0 and highest >= options.speed_limit,
        f'{MOTOR}, Speed: Max ERPM and Max ERPM Reverse times ERPM Limit Start at least '
        f'{options.speed_limit * per_minute:.0f}')


def _trip(limits: Mapping[str, float], options: VescOptions) -> Setting:
    needed = options.torque_limit / options.torque_constant
    trip = limits['l_abs_current_max']
    return Setting(
        'over-current trip', _shown(trip, 'A'), f'more than {needed:.3g} A', trip > needed,
        f'{MOTOR}, Current: Absolute Maximum Current 1.5 to 2 times that')
