# SPDX-License-Identifier: Apache-2.0
r"""
Equations of motion of the ball and its pendulum: eqs. (3)-(6) and (13), solved by hand.

::

          y ^        phi = theta1 + theta2: absolute angle of the pendulum,
            |              0 hanging down, + towards +x
            |   ___        theta1: ball angle     all angles counter-clockwise positive
            | /     \      theta2 = phi - theta1: joint angle, measured by an encoder
            ||   o   |
            | \  |\ /   e: pendulum length
        ____|__‾‾|‾*‾____________> x          rolling forward (to +x) turns the ball
                 phi                           clockwise: ball_rate = -v / R < 0

The state holds phi instead of the paper's theta2.  That is a mere change of variables, but
phi stays bounded while theta1 and theta2 grow with the distance rolled, so no precision is lost by
subtracting two large numbers, and the equations separate: with M = M1 + M2, m = M2 e ::

    phi''    = (tau2 - c2 theta2' - m/M (Fx cos phi + Fy sin phi)) / (J2 + M2 e^2 M1/M)
    theta1'' = (tau1 - c1 theta1' - tau2 + c2 theta2') / J1
    x''      = (Fx - m (phi'' cos phi - phi'^2 sin phi)) / M
    y''      = (Fy - m (phi'' sin phi + phi'^2 cos phi)) / M - g

which is eq. (13) without a 4 x 4 solve.  Without a pendulum m = 0, tau2 = 0 and the first
line is omitted.
"""
import math
from typing import NamedTuple

from ballbot_ros.jit import compiled, row_reader
from ballbot_ros.physics.mechanics.contact import (
    Accelerations, Compliance, contact_loads, ContactMode, Loads, Response, spring_energy)
from ballbot_ros.physics.model.actuation import Actuator, actuator_torque
from ballbot_ros.physics.model.robot import Parameters
from ballbot_ros.physics.model.state import (
    BALL_ANGLE, BALL_RATE, CONTACT_LOSS, FRICTION_LOSS, JOINT_LOSS, MOTOR_WORK, PENDULUM_ANGLE,
    PENDULUM_RATE, ROLLING_LOSS, VELOCITY_X, VELOCITY_Y, X, Y)
from ballbot_ros.physics.model.terrain import Array

# Kernels that read the parameters of a robot, or a law, from a row of numbers.
read_parameters, read_actuator = row_reader(Parameters), row_reader(Actuator)


class System(NamedTuple):
    """The arguments of the equations of motion other than time and state."""

    parameters: Parameters
    ground: Array  # (n, 7), see `Terrain.profile`
    actuator: Actuator


# Angles up to which the series below are exact to rounding: the short ones, which suffice for most
# steps, and the long ones [rad].
CLOSE, NEARBY = 0.05, 0.5

Direction = tuple[float, float]       # sine and cosine of an angle
AngleTrig = tuple[float, float, float]   # an angle [rad] and its direction


@compiled
def angle_trig(angle: float) -> AngleTrig:
    """Return an angle [rad] with its direction."""
    return angle, math.sin(angle), math.cos(angle)


@compiled
def direction_near(angle: float, start: AngleTrig) -> Direction:
    """
    Return sine and cosine of an angle [rad], quickly if it is near that of `start`.

    Uses the series of sine and cosine of the difference, and the addition theorems.
    """
    known, sine, cosine = start
    ahead = angle - known
    square = ahead * ahead
    # In independent pairs; the sums that depend on all of them come last.
    if square < CLOSE * CLOSE:
        bent = (-1 / 6 + square * (1 / 120)) + (square * square) * (-1 / 5040)
        back = (-1 / 2 + square * (1 / 24)) + (square * square) * (
            -1 / 720 + square * (1 / 40320))
    elif square < NEARBY * NEARBY:
        fourth = square * square
        bent = (-1 / 6 + square * (1 / 120)) + fourth * (
            (-1 / 5040 + square * (1 / 362880)) + fourth * (
                -1 / 39916800 + square * (1 / 6227020800)))
        back = (-1 / 2 + square * (1 / 24)) + fourth * (
            (-1 / 720 + square * (1 / 40320)) + fourth * (
                (-1 / 3628800 + square * (1 / 479001600)) + fourth * (-1 / 87178291200)))
    else:
        return math.sin(angle), math.cos(angle)
    along, across = cosine * ahead, sine * ahead
    return ((sine + along) + square * (along * bent + sine * back),
            (cosine - across) + square * (cosine * back - across * bent))


@compiled
def unforced(motion: Array, pendulum_trig: Direction, motor: float, parameters: Parameters
             ) -> Response:
    """
    Return the accelerations without ground forces, and the response to these; eq. (13).

    Parameters
    ----------
    motion : (8,) array, or longer
        The coordinates are not used.
    pendulum_trig : tuple
        Sine and cosine of the pendulum angle.
    motor : float
        Torque tau2 of the pendulum motor [N m].
    parameters : Parameters

    """
    sine, cosine = pendulum_trig
    per_mass = 1.0 / parameters.mass  # a division in each call would take as long as the rest
    per_inertia = 1.0 / parameters.ball_inertia
    spin = motion[BALL_RATE]
    rolling = parameters.rolling_friction * spin
    if parameters.swing_inertia <= 0.0:
        return ((-per_inertia * rolling, 0.0, 0.0, -parameters.gravity),
                (0.0, 0.0, per_mass, 0.0, per_mass, per_inertia))
    rate = motion[PENDULUM_RATE]
    joint = motor - parameters.joint_friction * (rate - spin)
    per_swing = 1.0 / parameters.swing_inertia
    arm = parameters.pendulum_moment * per_mass
    share, away, own = arm * per_swing, arm * rate * rate, per_swing * joint
    sway_x, sway_y = share * cosine, share * sine
    arm_x, arm_y = arm * cosine, arm * sine
    return ((-per_inertia * (rolling + joint), own, away * sine - arm_x * own,
             -parameters.gravity - away * cosine - arm_y * own),
            (-sway_x, -sway_y, per_mass + arm_x * sway_x, arm_x * sway_y,
             per_mass + arm_y * sway_y, per_inertia))


@compiled
def forced(free: Accelerations, compliance: Compliance, force_x: float, force_y: float,
           torque: float) -> Accelerations:
    """Return the accelerations under force [N] and torque [N m] of the ground; see `unforced`."""
    turn, swing, along_x, along_y = free
    sway_x, sway_y, own_x, cross, own_y, per_inertia = compliance
    return (turn + per_inertia * torque, swing + sway_x * force_x + sway_y * force_y,
            along_x + own_x * force_x + cross * force_y,
            along_y + cross * force_x + own_y * force_y)


@compiled
def write_motion(motion: Array, found: Accelerations, parameters: Parameters,
                 rates: Array) -> None:
    """Write velocities and accelerations of a motion into `rates`."""
    rates[BALL_ANGLE] = motion[BALL_RATE]
    rates[PENDULUM_ANGLE] = motion[PENDULUM_RATE] if parameters.swing_inertia > 0.0 else 0.0
    rates[X], rates[Y] = motion[VELOCITY_X], motion[VELOCITY_Y]
    rates[BALL_RATE], rates[PENDULUM_RATE], rates[VELOCITY_X], rates[VELOCITY_Y] = found


@compiled
def write_rates(state: Array, parameters: Parameters, loads: Loads, motor: float,
                rates: Array) -> None:
    """
    Write the time derivative of `state` under given loads, including the energy flows.

    Parameters
    ----------
    state, rates : (13,) arrays
    parameters : Parameters
    loads : tuple
        Loads of the ground on the ball, see `contact.loads_of`.
    motor : float
        Torque tau2 of the pendulum motor [N m].

    """
    force_x, force_y, torque, contact_loss, friction_loss = loads
    angle, spin = state[PENDULUM_ANGLE], state[BALL_RATE]
    free, compliance = unforced(state, (math.sin(angle), math.cos(angle)), motor, parameters)
    write_motion(state, forced(free, compliance, force_x, force_y, torque), parameters, rates)
    joint_rate = state[PENDULUM_RATE] - spin if parameters.swing_inertia > 0.0 else 0.0
    rates[CONTACT_LOSS], rates[FRICTION_LOSS] = contact_loss, friction_loss
    rates[ROLLING_LOSS] = parameters.rolling_friction * spin * spin
    rates[JOINT_LOSS] = parameters.joint_friction * joint_rate * joint_rate
    rates[MOTOR_WORK] = motor * joint_rate


@compiled
def derivative(time: float, state: Array, system: System, mode: ContactMode, rates: Array
               ) -> None:
    """
    Write the time derivative of `state` into `rates`.

    Parameters
    ----------
    time : float
        [s]
    state, rates : (13,) arrays
        In the order of `model.state`.
    system : System
    mode : ContactMode
        Its table is filled with the contacts; its signs are not used.

    """
    parameters = system.parameters
    loads = contact_loads(state, parameters, system.ground, mode)
    motor = 0.0
    if parameters.swing_inertia > 0.0:
        motor = actuator_torque(time, state, system.actuator)
    write_rates(state, parameters, loads, motor, rates)


@compiled
def kinetic_energy(state: Array, parameters: Parameters) -> float:
    """Return T1 + T2 of eq. (4) [J]."""
    velocity_x, velocity_y = state[VELOCITY_X], state[VELOCITY_Y]
    angle, rate, spin = state[PENDULUM_ANGLE], state[PENDULUM_RATE], state[BALL_RATE]
    along = velocity_x * math.cos(angle) + velocity_y * math.sin(angle)
    return (0.5 * parameters.mass * (velocity_x * velocity_x + velocity_y * velocity_y)
            + 0.5 * parameters.ball_inertia * (spin * spin)
            + 0.5 * parameters.pendulum_inertia * rate * rate
            + parameters.pendulum_moment * rate * along)


@compiled
def potential_energy(state: Array, parameters: Parameters) -> float:
    """Return V1 + V2 of eq. (5) [J], zero for a centre at y = 0 and a level pendulum."""
    return parameters.gravity * (
        parameters.mass * state[Y]
        - parameters.pendulum_moment * math.cos(state[PENDULUM_ANGLE]))


@compiled
def energies(state: Array, parameters: Parameters, ground: Array,
             contacts: Array) -> tuple[float, float, float]:
    """Return kinetic and potential energy, and that of the contacts [J]; see `derivative`."""
    return (kinetic_energy(state, parameters), potential_energy(state, parameters),
            spring_energy(state, parameters, ground, contacts))


@compiled
def is_finite(state: Array) -> bool:
    """Return whether the motion is finite."""
    total = 0.0
    for i in range(VELOCITY_Y + 1):
        total += state[i]
    return math.isfinite(total)
