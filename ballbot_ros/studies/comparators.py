# SPDX-License-Identifier: Apache-2.0
"""
Simpler models of the maximum step height of a ball, in closed form.

These are the models of the paper's section 2, and the two that it names as further work.  None of
them integrates an equation of motion, unlike `paper.rigid_impact`: rigid impacts with restitution
and friction, and flight between them.

Notation: M = M1 + M2, kappa = J1 / (M R^2), h the height of the step, beta the angle of the
line from the edge to the centre at the first touch: cos beta = 1 - h/R.  An edge above the centre
is a wall, so that no height here exceeds R.
"""
import math
from typing import Callable

from ballbot_ros.crossing.rules import check_gravity
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.model.robot import Robot


def quasi_static(robot: Robot) -> float:
    """
    Return the maximum step height without speed [m].

    Eq. (1), of Halme et al. [4]: the level pendulum brings the common centre of mass, M2 e / M
    ahead of the centre of the ball, to the vertical through the edge.  Valid for a ball at rest
    at the step, with sufficient friction; a rolling ball crosses much higher steps.
    """
    offset = robot.pendulum_moment / robot.total_mass
    return robot.ball_radius - math.sqrt(robot.ball_radius**2 - offset**2)


def energy(robot: Robot, speed: float) -> float:
    """
    Return the height at which the rolling energy is used up [m].

    M g h = M v^2 / 2 + J1 (v/R)^2 / 2, after Kolacinski and Quinn [32]; the paper gives no formula
    and does not state whether they include the rotational energy.  An upper bound for a ball
    without drive, accurate for low steps, where the impact loss is small.
    """
    check(robot, speed)
    return min(rolling_energy(robot, speed) / robot.weight, robot.ball_radius)


def energy_with_held_pendulum(robot: Robot, speed: float, pendulum_angle: float) -> float:
    """
    Return the height at which rolling energy and motor work are used up [m].

    The motor holds the pendulum at an absolute angle with the torque M2 g e sin(phi), while the
    ball turns by beta about the edge: M g h = E + M2 g e sin(phi) beta.  Derived here.  An upper
    bound for the driven ball.  Without speed it is about four times the step of eq. (1): torques
    must balance at each point of the ascent, energies only in total.
    """
    check(robot, speed)
    available = rolling_energy(robot, speed)
    return bisect(lambda height: _lifts(robot, available, pendulum_angle, height),
                  robot.ball_radius)


def plastic_impulse(robot: Robot, speed: float) -> float:
    """
    Return the maximum step height after a plastic impact on the edge, without slip [m].

    Angular momentum about the edge is conserved at the impact, energy after it:
    v^2 = 2 g h (1 + kappa) / (kappa + cos beta)^2.  A textbook result; for a solid sphere and
    h = R/5 it is v = sqrt(14 g R) / 6.  The pendulum counts as a mass that does not rotate, which
    is correct if the motor holds it down.  Valid for a rigid edge without bounce or slip, and for
    speeds at which the ball stays on the edge.
    """
    check(robot, speed)
    if speed == 0.0:
        return 0.0
    kappa, radius = inertia_ratio(robot), robot.ball_radius
    drop = robot.gravity * radius / speed**2
    return min(radius * (1.0 + kappa) * (1.0 + drop - math.sqrt(drop * (drop + 2.0))), radius)


def plastic_impulse_with_held_pendulum(robot: Robot, speed: float,
                                       pendulum_angle: float) -> float:
    """
    Return the maximum step height after a plastic impact, while the motor holds the pendulum [m].

    The impact of `plastic_impulse`, then the climb of `energy_with_held_pendulum`.  Derived
    here; the momentum model for the driven ball.
    """
    check(robot, speed)
    kappa = inertia_ratio(robot)

    def enough(height: float) -> bool:
        kept = (kappa + 1.0 - height / robot.ball_radius) / (kappa + 1.0)
        return _lifts(robot, rolling_energy(robot, kept * speed), pendulum_angle, height)
    return bisect(enough, robot.ball_radius)


def free_pendulum_impulse(robot: Robot, speed: float, pendulum_angle: float = 0.0) -> float:
    """
    Return the maximum step height after a plastic impact of a ball whose pendulum is free [m].

    The momentum model that the paper leaves as further work.  No impulse passes the free joint, so
    that the momentum of the swing, the second row of A in eq. (6), is conserved.  Eliminating it
    gives the effective mass of the centre of a ball whose pendulum is free, ::

        W = M 1 - (M2 e)^2 / (J2 + M2 e^2) u u',    u = (cos phi, sin phi)

    and with t = (cos beta, sin beta), the direction about the edge, the impact leaves the rate ::

        Omega = (J1 v/R + R t' W (v, 0)) / (J1 + R^2 t' W t)

    The energy of the swing stays in the swing; the rest, Omega^2 (J1 + R^2 t' W t) / 2, must equal
    M g h.  Derived here from A, and tested against it.  Valid as `plastic_impulse` is, with which
    it agrees without a pendulum; the swing after the impact is neglected.  The speed is in m/s,
    the absolute pendulum angle at the impact in rad.
    """
    check(robot, speed)
    given = robot.pendulum_moment**2 / robot.joint_inertia if robot.has_pendulum else 0.0
    cosine, sine = math.cos(pendulum_angle), math.sin(pendulum_angle)
    radius, ball, mass = robot.ball_radius, robot.ball_inertia, robot.total_mass

    def enough(height: float) -> bool:
        ahead = 1.0 - height / radius
        up = math.sqrt(max(1.0 - ahead * ahead, 0.0))
        along = ahead * cosine + up * sine
        moment = ball + radius**2 * (mass - given * along * along)
        rate = (ball / radius + radius * (mass * ahead - given * along * cosine)) * speed / moment
        return rate > 0.0 and 0.5 * moment * rate * rate >= robot.weight * height
    return bisect(enough, radius)


def rolling_energy(robot: Robot, speed: float) -> float:
    """Return M v^2 / 2 + J1 (v/R)^2 / 2, for a pendulum that does not rotate [J]."""
    return 0.5 * robot.total_mass * (1.0 + inertia_ratio(robot)) * speed**2


def inertia_ratio(robot: Robot) -> float:
    """Return J1 / (M R^2)."""
    return robot.ball_inertia / (robot.total_mass * robot.ball_radius**2)


def check(robot: Robot, speed: float) -> None:
    """Refuse a speed or gravity for which there is no maximum step height."""
    if not (math.isfinite(speed) and speed >= 0.0):
        raise ConfigurationError(
            f'speed must be finite and at least 0 m/s, got {speed!r}', 'out_of_range', 'speed')
    check_gravity(robot)


def _lifts(robot: Robot, available: float, pendulum_angle: float, height: float) -> bool:
    """Return whether an energy [J] and the work of a held pendulum lift the ball onto a step."""
    turn = math.acos(1.0 - height / robot.ball_radius)
    work = robot.largest_gravity_torque * math.sin(pendulum_angle) * turn
    return available + work >= robot.weight * height


def highest_passed(passes: Callable[[float], bool], robot: Robot, speed: float,
                   tolerance: float) -> float:
    """
    Return the maximum step height that passes, at most the ball radius, within a tolerance [m].

    The paper's ascending bracketing: the height doubles until the ball fails, then the bracket is
    halved.
    """
    low, high = 0.0, max(tolerance, 0.25 * speed**2 / (2.0 * robot.gravity))
    while high < robot.ball_radius and passes(high):
        low, high = high, 2.0 * high
    return bisect(passes, min(high, robot.ball_radius), low, tolerance)


def bisect(enough: Callable[[float], bool], high: float, low: float = 0.0,
           tolerance: float = 0.0) -> float:
    """
    Return the largest value from `low` to `high` that is enough, found by halving.

    `low` is assumed to be enough.  The result is the lower end of the last bracket, which is at
    most as wide as the tolerance.
    """
    if enough(high):
        return high
    while high - low > tolerance and low < (middle := 0.5 * (low + high)) < high:
        low, high = (middle, high) if enough(middle) else (low, middle)
    return low
