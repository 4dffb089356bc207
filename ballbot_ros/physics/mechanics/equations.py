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
phi stays bounded while theta1 and theta2 grow with the way rolled, so nothing is lost by
subtracting two large numbers, and the equations separate: with M = M1 + M2, m = M2 e ::

    phi''    = (tau2 - c2 theta2' - m/M (Fx cos phi + Fy sin phi)) / (J2 + M2 e^2 M1/M)
    theta1'' = (tau1 - c1 theta1' - tau2 + c2 theta2') / J1
    x''      = (Fx - m (phi'' cos phi - phi'^2 sin phi)) / M
    y''      = (Fy - m (phi'' sin phi + phi'^2 cos phi)) / M - g

which is eq. (13) without a 4 x 4 solve.  Without a pendulum m = 0, tau2 = 0 and the first
line is left out.
"""
import math
from typing import Any, NamedTuple

from ballbot_ros.compiled import compiled, inlined
from ballbot_ros.physics.mechanics.contact import contact_loads
from ballbot_ros.physics.mechanics.laws import (
    limited, motor_torque, position_torque, velocity_torque)
from ballbot_ros.physics.model.contact_options import ContactOptions
from ballbot_ros.physics.model.robot import Robot

# Order of the state vector: coordinates, rates, then energy gone since the start.
(BALL_ANGLE, PENDULUM_ANGLE, X, Y, BALL_RATE, PENDULUM_RATE, VELOCITY_X, VELOCITY_Y,
 CONTACT_LOSS, FRICTION_LOSS, ROLLING_LOSS, JOINT_LOSS, MOTOR_WORK) = range(13)
SIZE = 13
COORDINATES = 4

# Laws of actuation, for Drive.law.
FREE, POSITION, VELOCITY, VOLTAGE, TORQUE = range(5)


class Numbers(NamedTuple):
    """A robot and its contact law as the compiled kernels read them; all SI."""

    mass: float  # M1 + M2
    pendulum_moment: float  # M2 e
    ball_inertia: float  # J1
    swing_inertia: float  # J2 + M2 e^2 M1 / M; 0 where there is no pendulum
    pendulum_inertia: float  # J2 + M2 e^2
    rolling_friction: float
    joint_friction: float
    radius: float
    stiffness: float
    damping: float
    slip_threshold: float
    gravity: float
    pulling: float  # switches are 0.0 or 1.0
    smooth_friction: float
    radius_lever: float

    @classmethod
    def of(cls, robot: Robot, options: ContactOptions) -> 'Numbers':
        """Return the numbers of a robot."""
        own = robot.pendulum_mass * robot.pendulum_length**2
        return cls(
            robot.total_mass, robot.pendulum_mass * robot.pendulum_length, robot.ball_inertia,
            robot.pendulum_inertia + own * robot.ball_mass / robot.total_mass,
            robot.pendulum_inertia + own, robot.rolling_friction, robot.joint_friction,
            robot.ball_radius, robot.contact_stiffness, robot.contact_damping,
            robot.slip_threshold, robot.gravity, float(options.pulling),
            float(options.friction_ramp == 'smooth'), float(options.slip_lever == 'radius'))


class Drive(NamedTuple):
    """The pendulum motor as the kernels read it; see `actuation` for making one."""

    law: int = FREE
    set_value: float = 0.0  # rad, rad/s, V or N m, as the law asks
    kp: float = 0.0  # VOLTAGE: stall torque per volt [N m/V]
    kd_or_ki: float = 0.0  # VOLTAGE: back voltage [V s/rad]
    gravity_torque: float = 0.0  # M2 g e where compensated
    limit: float = math.inf  # of the torque [N m]
    start_time: float = 0.0  # of the set-point, for the integral of eq. (12)
    start_joint_angle: float = 0.0


@compiled
def wanted_torque(time: float, state: Any, drive: Any) -> float:
    """Return the torque tau2 that the law asks for, without the limit [N m]."""
    joint_rate = state[PENDULUM_RATE] - state[BALL_RATE]
    if drive.law == POSITION:
        return position_torque(state[PENDULUM_ANGLE], state[PENDULUM_RATE], drive.set_value,
                               drive.kp, drive.kd_or_ki, drive.gravity_torque)
    if drive.law == VELOCITY:
        travel = state[PENDULUM_ANGLE] - state[BALL_ANGLE] - drive.start_joint_angle
        lag = drive.set_value * (time - drive.start_time) - travel
        return velocity_torque(state[PENDULUM_ANGLE], joint_rate, lag, drive.set_value,
                               drive.kp, drive.kd_or_ki, drive.gravity_torque)
    if drive.law == VOLTAGE:
        return motor_torque(drive.set_value, joint_rate, drive.kp, drive.kd_or_ki)
    if drive.law == TORQUE:
        return drive.set_value
    return 0.0


@compiled
def drive_slopes(state: Any, drive: Any) -> tuple:
    """
    Return the derivatives of `wanted_torque`.

    By ball angle, pendulum angle, ball rate, pendulum rate and time.
    """
    level = drive.gravity_torque * math.cos(state[PENDULUM_ANGLE])
    if drive.law == POSITION:
        return 0.0, level - drive.kp, 0.0, -drive.kd_or_ki, 0.0
    if drive.law == VELOCITY:
        # The lag grows with the ball angle and shrinks with the pendulum angle.
        return (drive.kd_or_ki, level - drive.kd_or_ki, drive.kp, -drive.kp,
                drive.kd_or_ki * drive.set_value)
    if drive.law == VOLTAGE:
        back = drive.kp * drive.kd_or_ki
        return 0.0, 0.0, back, -back, 0.0
    return 0.0, 0.0, 0.0, 0.0, 0.0


@compiled
def drive_torque(time: float, state: Any, drive: Any) -> float:
    """Return the torque tau2 of the pendulum motor, within its limit [N m]."""
    return limited(wanted_torque(time, state, drive), drive.limit)


@inlined
def write_rates(state: Any, robot: Any, loads: Any, motor: float, rates: Any) -> None:
    """
    Write the time derivative of `state` under given loads into `rates`; eq. (13).

    Parameters
    ----------
    state, rates : (13,) arrays
    robot : Numbers
    loads : tuple
        What the ground does to the ball, see `contact.contact_loads`.
    motor : float
        Torque tau2 of the pendulum motor [N m].

    """
    ball_rate = state[BALL_RATE]
    force_x, force_y, torque, contact_loss, friction_loss = loads
    rolling_torque = robot.rolling_friction * ball_rate

    rates[BALL_ANGLE] = ball_rate
    rates[X] = state[VELOCITY_X]
    rates[Y] = state[VELOCITY_Y]
    rates[CONTACT_LOSS] = contact_loss
    rates[FRICTION_LOSS] = friction_loss
    rates[ROLLING_LOSS] = rolling_torque * ball_rate

    if robot.swing_inertia > 0.0:
        angle, rate = state[PENDULUM_ANGLE], state[PENDULUM_RATE]
        sine, cosine = math.sin(angle), math.cos(angle)
        joint_rate = rate - ball_rate
        friction = robot.joint_friction * joint_rate
        moment = robot.pendulum_moment
        swing = (motor - friction - moment / robot.mass * (force_x * cosine + force_y * sine)
                 ) / robot.swing_inertia
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
    rates[BALL_RATE] = (torque - rolling_torque) / robot.ball_inertia
    rates[VELOCITY_X] = force_x / robot.mass
    rates[VELOCITY_Y] = force_y / robot.mass - robot.gravity


@compiled
def derivative(time: float, state: Any, robot: Any, ground: Any, drive: Any, table: Any,
               rates: Any) -> None:
    """
    Write the time derivative of `state` into `rates`.

    Parameters
    ----------
    time : float
        [s]
    state, rates : (13,) arrays
        Ordered as the constants of this module say.
    robot : Numbers
    ground : (n, 7) array
        See `Terrain.profile`.
    drive : Drive
    table : (2 n, 7) array
        Room for the contacts, see `contact.contact_table`.

    """
    loads = contact_loads(robot, ground, table, state[X], state[Y], state[VELOCITY_X],
                          state[VELOCITY_Y], state[BALL_RATE])
    motor = drive_torque(time, state, drive) if robot.swing_inertia > 0.0 else 0.0
    write_rates(state, robot, loads, motor, rates)


@compiled
def kinetic_energy(state: Any, robot: Any) -> float:
    """Return T1 + T2 of eq. (4) [J]."""
    velocity_x, velocity_y = state[VELOCITY_X], state[VELOCITY_Y]
    angle, rate = state[PENDULUM_ANGLE], state[PENDULUM_RATE]
    along = velocity_x * math.cos(angle) + velocity_y * math.sin(angle)
    return (0.5 * robot.mass * (velocity_x * velocity_x + velocity_y * velocity_y)
            + 0.5 * robot.ball_inertia * state[BALL_RATE]**2
            + 0.5 * robot.pendulum_inertia * rate * rate
            + robot.pendulum_moment * rate * along)


@compiled
def potential_energy(state: Any, robot: Any) -> float:
    """Return V1 + V2 of eq. (5) [J], zero for a centre at y = 0 and a level pendulum."""
    return robot.gravity * (robot.mass * state[Y]
                            - robot.pendulum_moment * math.cos(state[PENDULUM_ANGLE]))


@compiled
def is_finite(state: Any) -> bool:
    """Tell whether the motion is finite."""
    total = 0.0
    for i in range(VELOCITY_Y + 1):
        total += state[i]
    return math.isfinite(total)
