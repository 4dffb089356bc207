# SPDX-License-Identifier: Apache-2.0
"""
Required settings of an ODrive for a robot: actual and required value of each, and the reason.

In torque mode, above ``vel_limit - torque / vel_gain`` the drive reduces the torque, and above
``vel_limit`` it brakes without a command; above ``vel_limit_tolerance`` times that limit it
disarms (controller.cpp, limitVel and overspeed fault, at fw-v0.5.6).  The factory default is
2 turn/s, 0.07 m/s of rolling with a gear ratio of 50.  The drive also disarms if more than 0.01 A
would flow into the supply, unless a brake resistor absorbs it (low_level.cpp,
update_brake_current).  For 0.6, of which only the names are published, the same is assumed.
"""
import math
from typing import Callable

from ballbot_ros.drives.contract import DriveOptions, judge_torque, RUNAWAY, Setting, shown
from ballbot_ros.drives.odrive.firmware import (
    BACK_ALLOWED, BRAKE_DUTY_MAX, BUS_VOLTAGE, FACTORY_VELOCITY_TOLERANCE, Generation,
    LIMITS_TORQUE_MODE, MAX_BACK, OVERSPEED, Rule, VELOCITY_GAIN, VELOCITY_LIMIT,
    VELOCITY_TOLERANCE, WATCHDOG, WATCHDOG_TIMEOUT)

Read = Callable[[str], float]


def judge(generation: Generation, read: Read, options: DriveOptions) -> tuple[Setting, ...]:
    """
    Read back and check each safety-relevant setting.

    `read` returns the value of a property, NaN if there is no such property.
    """
    return (_torque(generation, read, options), _watchdog(read, options),
            *_velocity(read, options), _braking(generation, read, options),
            *(_rule(rule, read(rule.name)) for rule in generation.rules))


def _torque(generation: Generation, read: Read, options: DriveOptions) -> Setting:
    limit = options.own_limit
    bounds = [abs(read(name)) for name in generation.torque_limits]
    currents = read(generation.current_limit) * read(generation.torque_constant)
    # An unknown bound does not limit the torque, nor does a negative torque constant.
    ceiling = math.nan if math.isnan(sum(bounds) + currents) or currents < 0.0 \
        else min(max(bounds), currents)
    return judge_torque(ceiling, options, ', '.join(
        _write(name, -limit if name.endswith('min') else limit)
        for name in generation.torque_limits))


def _watchdog(read: Read, options: DriveOptions) -> Setting:
    enabled, timeout = read(WATCHDOG) == 1.0, read(WATCHDOG_TIMEOUT)
    return Setting('watchdog', shown(timeout, 's') if enabled else 'off',
                   f'at most {options.watchdog:g} s',
                   enabled and 0.0 < timeout <= 1.01 * options.watchdog,
                   f'{_write(WATCHDOG_TIMEOUT, options.watchdog)}, {_write(WATCHDOG, 1)}')


def _velocity(read: Read, options: DriveOptions) -> tuple[Setting, Setting]:
    """Check the speeds at which the drive reduces the torque and disarms by itself."""
    limit, gain, limits, trips, tolerance = map(read, (
        VELOCITY_LIMIT, VELOCITY_GAIN, LIMITS_TORQUE_MODE, OVERSPEED, VELOCITY_TOLERANCE))
    fastest = RUNAWAY * options.speed_limit / math.tau
    untouched = fastest + options.torque_limit / gain if gain > 0.0 else math.nan
    raised = _write(VELOCITY_LIMIT, _rounded_up(untouched if gain > 0.0 else fastest))
    return (
        Setting('velocity limit in torque mode', _where(limits, limit),
                f'at least {_rounded_up(untouched):g} turn/s or off',
                limits == 0.0 or limit >= untouched,
                raised if gain > 0.0 else _write(LIMITS_TORQUE_MODE, 0)),
        Setting('overspeed error', _where(trips, tolerance * limit),
                f'at least {_rounded_up(fastest):g} turn/s or off',
                trips == 0.0 or tolerance * limit >= fastest,
                _write(VELOCITY_TOLERANCE, FACTORY_VELOCITY_TOLERANCE)
                if limit >= fastest else raised))


def _braking(generation: Generation, read: Read, options: DriveOptions) -> Setting:
    """Check that the supply or a brake resistor absorbs the energy of a braking motor."""
    most, allowed, voltage = read(MAX_BACK), read(BACK_ALLOWED), read(BUS_VOLTAGE)
    resistance = read(generation.brake_resistance)
    enabled = read(generation.brake_enabled) == 1.0 and resistance > 0.0
    power = RUNAWAY * options.speed_limit * options.torque_limit
    needed = power / voltage if voltage > 0.0 else math.nan
    taken = BRAKE_DUTY_MAX * voltage / resistance if enabled else 0.0
    # With a resistor, the allowed current flows back, or the excess over its capacity if larger.
    back = max(allowed, needed - taken) if enabled else needed
    resistor = f'a brake resistor of {resistance:g} ohm' if enabled else 'no brake resistor'
    into = shown(-most, 'A') + ' into the supply'
    wanted = _rounded_up(10.0 * back + 1e-6) / 10.0  # more than `back`, as the check requires
    return Setting(
        'braking', f'{into}, {resistor}',
        f'at least {wanted:g} A into the supply' + ('' if enabled else ', or a brake resistor'),
        back < -most or power == 0.0 and not math.isnan(most),
        _write(MAX_BACK, -wanted if enabled else -max(wanted, 0.1)) + (
            ' (a battery accepts that. A supply does not. With a brake resistor set '
            f'{generation.brake_resistance} and {generation.brake_enabled} 1)'))


def _rule(rule: Rule, value: float) -> Setting:
    words = f'({rule.words[int(value)]})' if value in rule.words else ''
    wanted = ' or '.join(f'{item} ({rule.words[item]})' for item in rule.wanted)
    return Setting(rule.setting, shown(value, words).rstrip(), wanted, value in rule.wanted,
                   rule.remedy or _write(rule.name, rule.wanted[0]))


def _where(switch: float, velocity: float) -> str:
    """Return the velocity of a limit as text, ``off`` if it is disabled."""
    return 'off' if switch == 0.0 else shown(
        velocity if switch == 1.0 else math.nan, 'turn/s')


def _rounded_up(value: float) -> float:
    return value if not math.isfinite(value) else float(math.ceil(value))


def _write(name: str, value: float) -> str:
    return f'w {name} {value:g}'
