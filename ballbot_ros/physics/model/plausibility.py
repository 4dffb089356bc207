# SPDX-License-Identifier: Apache-2.0
"""Plausibility checks of robot parameters, speeds, heights and angles, with the likely unit."""
import math
from typing import Any, Iterator, Mapping

LEAD, AIR = 11340.0, 1.2  # densities between which that of a robot lies [kg/m3]
DENSITIES = (20.0, 5000.0)  # of robots: a corrected value that gives one of these was meant
DEEPEST = 0.25  # static penetration that can still be a contact [radii]
SPEED_MAX = 20.0  # plausible for a robot [m/s]
HORIZONTAL = 90.0  # pendulum angle [deg]
GRAVITY_MAX = 30.0  # more than on any planet with a surface [m/s2]

MASSES = {'g': 1e-3, 'mg': 1e-6}
LENGTHS = {'mm': 1e-3, 'cm': 1e-2}
INERTIAS = {'kg cm2': 1e-4, 'g m2': 1e-3, 'kg mm2': 1e-6, 'g cm2': 1e-7, 'g mm2': 1e-9}
STIFFNESSES = {'N/mm': 1e3, 'kN/m': 1e3, 'N/cm': 1e2}


def implausible(robot: Any) -> Iterator[str]:
    """
    Yield a sentence for each parameter of a `Robot` that contradicts physics.

    The likely unit is named where a value in another unit would be plausible.
    """
    radius, mass = robot.ball_radius, robot.total_mass
    volume = 4.0 / 3.0 * math.pi * radius**3
    density = mass / volume
    if density > LEAD:
        yield (f'the mean density of robot {robot.name!r} is {density:.3g} kg/m3, above that of '
               f'lead: ball_mass is {robot.ball_mass:g} kg, ball_radius {radius:g} m'
               + _meant(robot.ball_mass, 'kg', MASSES,
                        tuple(limit * volume for limit in DENSITIES)))
    if density < AIR:
        yield (f'the mean density of robot {robot.name!r} is {density:.3g} kg/m3, below that of '
               f'air: ball_mass is {robot.ball_mass:g} kg, ball_radius {radius:g} m'
               + _meant(radius, 'm', LENGTHS, tuple(
                   (mass / limit / (4.0 / 3.0 * math.pi)) ** (1.0 / 3.0)
                   for limit in reversed(DENSITIES))))
    shell = robot.ball_mass * radius**2
    if robot.ball_inertia > shell * (1.0 + 1e-9):
        yield (f'ball_inertia is {robot.ball_inertia:g} kg m2, above {shell:.3g} kg m2, which is '
               'ball_mass ball_radius^2, with all mass at the shell'
               + _meant(robot.ball_inertia, 'kg m2', INERTIAS, (0.1 * shell, shell)))
    reach = robot.pendulum_mass * (radius + robot.pendulum_length)**2
    if robot.pendulum_inertia > reach * (1.0 + 1e-9):
        yield (f'pendulum_inertia is {robot.pendulum_inertia:g} kg m2, above {reach:.3g} kg m2: '
               'such a pendulum does not fit into the ball'
               + _meant(robot.pendulum_inertia, 'kg m2', INERTIAS, (1e-3 * reach, reach)))
    # With a wrong mass the penetration follows from that.
    if density <= LEAD and robot.static_penetration > DEEPEST * radius:
        softest = robot.weight / (0.05 * radius)
        yield (f'at rest the ball would sink {robot.static_penetration:.3g} m into the ground, '
               f'{robot.static_penetration / radius:.2g} of its radius: contact_stiffness is '
               f'{robot.contact_stiffness:g} N/m'
               + _meant(robot.contact_stiffness, 'N/m', STIFFNESSES, (softest, math.inf)))
    if robot.gravity > GRAVITY_MAX:
        yield (f'gravity is {robot.gravity:g} m/s2'
               + _meant(robot.gravity, 'm/s2', {'mm/s2': 1e-3, 'cm/s2': 1e-2}, (9.0, 10.5)))


def speed_warnings(speed: float, name: str) -> Iterator[str]:
    """Yield a warning about an implausible speed [m/s]."""
    if abs(speed) > SPEED_MAX:
        yield (f'{name} is {speed:g} m/s, {3.6 * abs(speed):.0f} km/h: check the unit')


def height_warnings(robot: Any, height: float, where: str) -> Iterator[str]:
    """Yield a warning about a step [m] that no ball of this size can cross."""
    diameter = 2.0 * robot.ball_radius
    if height > diameter:
        yield (f'the step of {height:g} m {where} is higher than the ball ({diameter:g} m), which '
               'cannot get over it' + (
                   f': {height:g} mm are {1e-3 * height:g}' if height >= 1.0 else ''))


def angle_warnings(degrees: float) -> Iterator[str]:
    """Yield a warning about a set angle of the pendulum above the horizontal."""
    if abs(degrees) > HORIZONTAL + 1e-9:
        yield (f'the pendulum is held at {degrees:g} degrees, above the horizontal, where a '
               'larger angle gives less torque: 90 is horizontal')


def _meant(value: float, unit: str, others: Mapping[str, float],
           plausible: tuple[float, ...]) -> str:
    """Return a hint at the unit in which a value would lie within two bounds, if there is one."""
    low, high = plausible
    for other, factor in others.items():
        if low <= value * factor <= high:
            return f'; {value:g} {other} would be {value * factor:g} {unit}'
    return ''
