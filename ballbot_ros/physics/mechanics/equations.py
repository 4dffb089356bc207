# SPDX-License-Identifier: Apache-2.0
r"""
Equations of motion of the ball and its pendulum: eqs. (3)-(6) and (13), solved by hand.

::

          y ^        phi = theta1 + theta2: absolute angle of the pendulum,
            |              0 hanging down, + towards +x
            |   ___        theta1: ball angle     all angles counter-clockwise positive
            | /     \      theta2 = phi - theta1: joint angle, what an encoder reads
            ||   o   |
            | \  |\ /   e: pendulum length
        ____|__‾‾|‾*‾____________> x          rolling forward (to +x) turns the ball
                 phi                           clockwise: ball_rate = -v / R < 0

The state holds phi instead of the paper's theta2.  That is a mere change of variables, but
phi stays bounded while theta1 and theta2 grow with the distance rolled, so nothing is lost by
subtracting two large numbers, and the equations separate: with M = M1 + M2, m = M2 e ::

    phi''    = (tau2 - c2 theta2' - m/M (Fx cos phi + Fy sin phi)) / (J2 + M2 e^2 M1/M)
    theta1'' = (tau1 - c1 theta1' - tau2 + c2 theta2') / J1
    x''      = (Fx - m (phi'' cos phi - phi'^2 sin phi)) / M
    y''      = (Fy - m (phi'' sin phi + phi'^2 cos phi)) / M - g

which is eq. (13) without a 4 x 4 solve.  Without a pendulum m = 0, tau2 = 0 and the first
line is left out.
"""
import math

from ballbot_ros.jit import compiled, inlined
from ballbot_ros.physics.mechanics.contact import contact_loads
from ballbot_ros.physics.mechanics.laws import (
    limited, motor_torque, position_feedback, velocity_feedback)
from ballbot_ros.physics.model.parameters import (
    Actuator, Parameters, POSITION, System, TORQUE, VELOCITY, VOLTAGE)
from ballbot_ros.physics.model.state import (
    BALL_ANGLE, BALL_RATE, CONTACT_LOSS, FRICTION_LOSS, JOINT_LOSS, MOTOR_WORK, PENDULUM_ANGLE,
    PENDULUM_RATE, ROLLING_LOSS, VELOCITY_X, VELOCITY_Y, X, Y)
from ballbot_ros.physics.model.terrain import Array

# What the ground does to the ball, see `contact.contact_loads`.
Loads = tuple[float, float, float, float, float]


@compiled
def unsaturated_torque(time: float, state: Array, actuator: Actuator) -> float:
    """Return the torque tau2 that the law asks for, without the limit [N m]."""
    sine = math.sin(state[PENDULUM_ANGLE]) if actuator.gravity_torque != 0.0 else 0.0
    return torque_asked(time, state, sine, actuator)


@compiled
def torque_asked(time: float, state: Array, sine: float, actuator: Actuator) -> float:
    """Return what `unsaturated_torque` does where the sine of the pendulum angle is known."""
    joint_rate = state[PENDULUM_RATE] - state[BALL_RATE]
    if actuator.law == POSITION:
        return actuator.gravity_torque * sine + position_feedback(
            state[PENDULUM_ANGLE], state[PENDULUM_RATE], actuator.set_value, actuator.kp,
            actuator.kd_or_ki)
    if actuator.law == VELOCITY:
        travel = state[PENDULUM_ANGLE] - state[BALL_ANGLE] - actuator.start_joint_angle
        lag = actuator.set_value * (time - actuator.start_time) - travel
        return actuator.gravity_torque * sine + velocity_feedback(
            joint_rate, lag, actuator.set_value, actuator.kp, actuator.kd_or_ki)
    if actuator.law == VOLTAGE:
        return motor_torque(actuator.set_value, joint_rate, actuator.kp, actuator.kd_or_ki)
    if actuator.law == TORQUE:
        return actuator.set_value
    return 0.0


@compiled
def torque_slopes(actuator: Actuator) -> tuple[float, float, float, float, float]:
    """
    Return the derivatives of `unsaturated_torque` without gravity compensation: constants.

    By ball angle, pendulum angle, ball rate, pendulum rate and time.
    """
    if actuator.law == POSITION:
        return 0.0, -actuator.kp, 0.0, -actuator.kd_or_ki, 0.0
    if actuator.law == VELOCITY:
        # The lag grows with the ball angle and shrinks with the pendulum angle.
        return (actuator.kd_or_ki, -actuator.kd_or_ki, actuator.kp, -actuator.kp,
                actuator.kd_or_ki * actuator.set_value)
    if actuator.law == VOLTAGE:
        back = actuator.kp * actuator.kd_or_ki
        return 0.0, 0.0, back, -back, 0.0
    return 0.0, 0.0, 0.0, 0.0, 0.0


@compiled
def actuator_torque(time: float, state: Array, actuator: Actuator) -> float:
    """Return the torque tau2 of the pendulum motor, within its limit [N m]."""
    return limited(unsaturated_torque(time, state, actuator), actuator.limit)


@inlined
def write_rates(state: Array, parameters: Parameters, loads: Loads, motor: float,
                rates: Array) -> None:
    """
    Write the time derivative of `state` under given loads into `rates`; eq. (13).

    Parameters
    ----------
    state, rates : (13,) arrays
    parameters : Parameters
    loads : tuple
        What the ground does to the ball, see `contact.contact_loads`.
    motor : float
        Torque tau2 of the pendulum motor [N m].

    """
    ball_rate = state[BALL_RATE]
    force_x, force_y, torque, contact_loss, friction_loss = loads
    rolling_torque = parameters.rolling_friction * ball_rate

    rates[BALL_ANGLE] = ball_rate
    rates[X] = state[VELOCITY_X]
    rates[Y] = state[VELOCITY_Y]
    rates[CONTACT_LOSS] = contact_loss
    rates[FRICTION_LOSS] = friction_loss
    rates[ROLLING_LOSS] = rolling_torque * ball_rate

    if parameters.swing_inertia > 0.0:
        angle, rate = state[PENDULUM_ANGLE], state[PENDULUM_RATE]
        sine, cosine = math.sin(angle), math.cos(angle)
        joint_rate = rate - ball_rate
        friction = parameters.joint_friction * joint_rate
        moment = parameters.pendulum_moment
        swing = (motor - friction - moment / parameters.mass * (force_x * cosine + force_y * sine)
                 ) / parameters.swing_inertia
        rates[PENDULUM_ANGLE] = rate
        rates[PENDULUM_RATE] = swing
        rates[JOINT_LOSS] = friction * joint_rate
        rates[MOTOR_WORK] = motor * joint_rate
        torque += friction - motor
        force_x -= moment * (cosine * swing - sine * rate * rate)
        force_y -= moment * (sine * swing + cosine * rate * rate)
    else:
        rates[PENDULUM_ANGLE] = 0.0
        rates[PENDULUM_RATE] = 0.0
        rates[JOINT_LOSS] = 0.0
        rates[MOTOR_WORK] = 0.0
    rates[BALL_RATE] = (torque - rolling_torque) / parameters.ball_inertia
    rates[VELOCITY_X] = force_x / parameters.mass
    rates[VELOCITY_Y] = force_y / parameters.mass - parameters.gravity


@compiled
def derivative(time: float, state: Array, system: System, contacts: Array, rates: Array) -> None:
    """
    Write the time derivative of `state` into `rates`.

    Parameters
    ----------
    time : float
        [s]
    state, rates : (13,) arrays
        Ordered as `model.state` says.
    system : System
    contacts : (2 n, 7) array
        Filled with the contacts, see `contact.contact_table`.

    """
    parameters = system.parameters
    loads = contact_loads(state, parameters, system.ground, contacts)
    motor = 0.0
    if parameters.swing_inertia > 0.0:
        motor = actuator_torque(time, state, system.actuator)
    write_rates(state, parameters, loads, motor, rates)


@compiled
def kinetic_energy(state: Array, parameters: Parameters) -> float:
    """Return T1 + T2 of eq. (4) [J]."""
    velocity_x, velocity_y = state[VELOCITY_X], state[VELOCITY_Y]
    angle, rate = state[PENDULUM_ANGLE], state[PENDULUM_RATE]
    along = velocity_x * math.cos(angle) + velocity_y * math.sin(angle)
    return (0.5 * parameters.mass * (velocity_x * velocity_x + velocity_y * velocity_y)
            + 0.5 * parameters.ball_inertia * state[BALL_RATE]**2
            + 0.5 * parameters.pendulum_inertia * rate * rate
            + parameters.pendulum_moment * rate * along)


@compiled
def potential_energy(state: Array, parameters: Parameters) -> float:
    """Return V1 + V2 of eq. (5) [J], zero for a centre at y = 0 and a level pendulum."""
    return parameters.gravity * (
        parameters.mass * state[Y]
        - parameters.pendulum_moment * math.cos(state[PENDULUM_ANGLE]))


@compiled
def is_finite(state: Array) -> bool:
    """Return whether the motion is finite."""
    total = 0.0
    for i in range(VELOCITY_Y + 1):
        total += state[i]
    return math.isfinite(total)
