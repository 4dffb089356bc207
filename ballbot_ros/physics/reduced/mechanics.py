# SPDX-License-Identifier: Apache-2.0
"""
Velocities, forces and rates of a ball on a track: the algebra behind `rolling`, see there.

All functions take the *slow state*, of the size of the full one and with its angles and losses;
in place of x and of the two rates it has WAY, SPIN (K) and SWING (Q).
"""
import math
from typing import Any

from ballbot_ros.compiled import compiled
from ballbot_ros.physics.dynamics import (
    BALL_ANGLE, BALL_RATE, FREE, PENDULUM_ANGLE, PENDULUM_RATE, POSITION, VELOCITY_X, VELOCITY_Y,
    VOLTAGE, wanted_torque, X, Y)
from ballbot_ros.physics.dynamics import VELOCITY as VELOCITY_LAW
from ballbot_ros.physics.reduced.track import normal_at, TURNING

WAY, SPIN, SWING = X, BALL_RATE, PENDULUM_RATE


@compiled
def settling_time(robot: Any) -> float:
    """Return tau_n, the time scale of the contact spring [s]."""
    return math.sqrt(robot.mass / robot.stiffness)


@compiled
def gain_rate(robot: Any, drive: Any) -> float:
    """Return how fast the motor's law and the joint's friction bring the pendulum along [1/s]."""
    if robot.swing_inertia <= 0.0:
        return 0.0
    gain = robot.joint_friction
    stiffness = 0.0
    if drive.law == POSITION:
        gain += drive.kd_or_ki
        stiffness = drive.kp
    elif drive.law == VELOCITY_LAW:
        gain += drive.kp
        stiffness = drive.kd_or_ki
    elif drive.law == VOLTAGE:
        gain += drive.kp * drive.kd_or_ki
    stiffness += robot.pendulum_moment * robot.gravity
    return gain / robot.swing_inertia + math.sqrt(stiffness / robot.swing_inertia)


@compiled
def outlook(slow: Any, track: Any) -> tuple:
    """Return normal, sine and cosine of the pendulum, and its direction's parts along n and t."""
    normal_x, normal_y = normal_at(slow[WAY], track)
    return complete(normal_x, normal_y, math.sin(slow[PENDULUM_ANGLE]),
                    math.cos(slow[PENDULUM_ANGLE]))


@compiled
def complete(normal_x: float, normal_y: float, sine: float, cosine: float) -> tuple:
    """Return what `outlook` does."""
    return (normal_x, normal_y, sine, cosine, cosine * normal_x + sine * normal_y,
            cosine * normal_y - sine * normal_x)


@compiled
def outlook_near(look: tuple, way: float, angle: float, track: Any) -> tuple:
    """Return the outlook after a small turn of the way and of the pendulum [m or rad], [rad]."""
    normal_x, normal_y, sine, cosine, _, _ = look
    bend = 1.0 - 0.5 * angle * angle
    sine, cosine = sine * bend + cosine * angle, cosine * bend - sine * angle
    if track[TURNING] > 0.0:
        bend = 1.0 - 0.5 * way * way
        normal_x, normal_y = normal_x * bend + normal_y * way, normal_y * bend - normal_x * way
    return complete(normal_x, normal_y, sine, cosine)


@compiled
def inertias(dent: float, look: tuple, robot: Any) -> tuple:
    """
    Return distance, lever and the equations for the two rates, or the two accelerations.

    (c11, c12; c21, c22) times (of the ball, of the pendulum); a ball without pendulum gets one
    of inertia 1 that nothing acts on.
    """
    a_t = look[5]
    distance = robot.radius - dent
    lever = robot.radius if robot.radius_lever > 0.0 else distance
    own = robot.pendulum_inertia if robot.swing_inertia > 0.0 else 1.0
    moment = robot.pendulum_moment
    return (distance, lever, robot.ball_inertia + robot.mass * distance * lever,
            -distance * moment * a_t, -moment * a_t * lever, own)


@compiled
def motion(slow: Any, dent: float, rise: float, slip: float, look: tuple, robot: Any) -> tuple:
    """Return the rates of ball and pendulum, and the velocity along t and n."""
    _, _, _, _, a_n, a_t = look
    distance, lever, c11, c12, c21, c22 = inertias(dent, look, robot)
    first = slow[SPIN] + distance * robot.mass * slip
    second = slow[SWING] - robot.pendulum_moment * (a_n * rise + a_t * slip)
    inverse = 1.0 / (c11 * c22 - c12 * c21)
    rate = (first * c22 - c12 * second) * inverse
    return rate, (c11 * second - c21 * first) * inverse, slip - lever * rate, rise


@compiled
def torque_of(time: float, slow: Any, rate: float, swing: float, saturated: int, robot: Any,
              drive: Any, probe: Any) -> float:
    """Return the torque of the motor [N m]; `saturated` as in the mode."""
    if drive.law == FREE or robot.swing_inertia <= 0.0:
        return 0.0
    if saturated != 0:
        return saturated * drive.limit
    probe[BALL_ANGLE], probe[PENDULUM_ANGLE] = slow[BALL_ANGLE], slow[PENDULUM_ANGLE]
    probe[BALL_RATE], probe[PENDULUM_RATE] = rate, swing
    return wanted_torque(time, probe, drive)


@compiled
def forces(slow: Any, dent: float, moved: tuple, motor: float, rise_rate: float,
           slip_rate: float, look: tuple, track: Any, robot: Any) -> tuple:
    """
    Return the normal force and the friction that the motion asks for.

    Parameters
    ----------
    moved : tuple
        From `motion`.
    rise_rate, slip_rate : float
        v_n' and s' [m/s2].

    """
    normal_x, normal_y, sine, _, a_n, a_t = look
    rate, swing, speed, rise = moved
    distance, lever, c11, c12, c21, c22 = inertias(dent, look, robot)
    mass, moment, weight = robot.mass, robot.pendulum_moment, robot.mass * robot.gravity
    drag = robot.joint_friction * (swing - rate)
    on_ball = drag - motor - robot.rolling_friction * rate
    turning = speed / distance if track[TURNING] > 0.0 else 0.0
    lever_rate = rise if robot.radius_lever == 0.0 else 0.0
    centrifugal = moment * swing * swing
    along = slip_rate - lever_rate * rate + turning * rise  # of v_t' + W v_n, without theta1''
    across = rise_rate - turning * speed
    first = on_ball + distance * (mass * along - centrifugal * a_n - weight * normal_x)
    second = (motor - drag - moment * robot.gravity * sine
              - moment * (a_n * across + a_t * along))
    inverse = 1.0 / (c11 * c22 - c12 * c21)
    spin_up = (first * c22 - c12 * second) * inverse
    swing_up = (c11 * second - c21 * first) * inverse
    normal = mass * across + moment * swing_up * a_n + centrifugal * a_t + weight * normal_y
    return normal, (robot.ball_inertia * spin_up - on_ball) / distance


@compiled
def write_slow_rates(slow: Any, dent: float, moved: tuple, motor: float, look: tuple,
                     track: Any, robot: Any, rates: Any) -> None:
    """Write the rates of the slow state that do not need the forces into `rates`."""
    normal_x, normal_y, sine, _, a_n, a_t = look
    rate, swing, speed, rise = moved
    mass, moment = robot.mass, robot.pendulum_moment
    distance = robot.radius - dent
    drag = robot.joint_friction * (swing - rate)
    turning = speed / distance if track[TURNING] > 0.0 else 0.0
    momentum_t = mass * speed + moment * a_t * swing
    momentum_n = mass * rise + moment * a_n * swing
    rates[BALL_ANGLE] = rate
    rates[PENDULUM_ANGLE] = swing if robot.swing_inertia > 0.0 else 0.0
    rates[WAY] = turning if track[TURNING] > 0.0 else speed
    rates[SPIN] = (drag - motor - robot.rolling_friction * rate
                   - distance * mass * robot.gravity * normal_x
                   - rise * momentum_t + turning * distance * momentum_n)
    rates[SWING] = (motor - drag - moment * robot.gravity * sine
                    + moment * swing * (rise * a_t - speed * a_n))
    rates[Y] = rates[VELOCITY_X] = rates[VELOCITY_Y] = 0.0
