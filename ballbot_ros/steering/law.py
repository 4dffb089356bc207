# SPDX-License-Identifier: Apache-2.0
"""
Steady turns, their limits by lean, torque and friction, and the steering law.

The law turns the ball at a commanded yaw rate within these limits, and damps the nutation.
"""
import math
from typing import NamedTuple

from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.steering.model import accelerations, LateralState, required_steering

RESERVE = 0.15  # fraction of lean, torque and friction reserved for damping and disturbances
PRECISION = 1e-4  # tolerance of a limit [1/m]
SWING_MAX = 0.5 * math.pi - 1e-6  # largest swing of the pendulum in a turn [rad]


class Turn(NamedTuple):
    """A steady turn."""

    lean: float  # [rad]
    tilt: float  # [rad]
    yaw_rate: float  # [rad/s]
    torque: float  # of the lateral axis [N m]
    lateral_acceleration: float  # [m/s2]


def steady_turn(robot: Robot, speed: float, curvature: float) -> Turn:
    """
    Return the steady turn of a curvature, yaw rate over speed [1/m], eqs. (S4) and (S5).

    The speed of the ball along its path may have either sign [m/s].
    """
    first = robot.pendulum_moment
    second = first * robot.pendulum_length
    radius, yaw_rate = robot.ball_radius, curvature * speed
    swing = 0.0
    # The pendulum is light relative to the ball: each iteration gains at least one digit.
    for _ in range(8):
        cosine = math.cos(swing)
        rolled = (robot.ball_inertia + robot.total_mass * radius**2 - first * radius * cosine)
        ratio = rolled * yaw_rate * speed / radius / (
            first * robot.gravity + yaw_rate**2 * (first * radius - second * cosine))
        swing = math.asin(ratio) if abs(ratio) < 1.0 else math.copysign(SWING_MAX, ratio)
    inertia = robot.ball_inertia + robot.pendulum_inertia + second * math.sin(swing)**2
    tilt = math.atan(curvature * radius * inertia / robot.ball_inertia)
    turning = LateralState(lean=swing + tilt, tilt=tilt, yaw_rate=yaw_rate)
    torque = accelerations(robot, turning, speed, 0.0).torque
    return Turn(swing + tilt, tilt, yaw_rate, torque, yaw_rate * speed)


def possible(robot: Robot, turn: Turn) -> bool:
    """Return whether a turn leaves the reserve of lean, torque and friction."""
    limits, share = required_steering(robot), 1.0 - RESERVE
    return (abs(turn.lean) <= share * limits.largest_lean
            and abs(turn.torque) <= share * limits.largest_torque
            and abs(turn.lateral_acceleration) <= share * robot.surface_friction * robot.gravity)


def curvature_limit(robot: Robot, speed: float) -> float:
    """
    Return the largest curvature at a speed [1/m]; 0 for a robot that drives straight.

    It decreases with the speed along the path, of either sign [m/s]; at rest it is the limit for
    low speeds, at which the ball rolls in a circle like a tilted wheel.
    """
    if robot.steering is None or not robot.has_pendulum:
        return 0.0
    low, high = 0.0, math.tan(robot.steering.largest_lean) / robot.ball_radius
    while high - low > PRECISION:
        middle = 0.5 * (low + high)
        if possible(robot, steady_turn(robot, speed, middle)):
            low = middle
        else:
            high = middle
    return low


def yaw_rate_limit(robot: Robot, speed: float) -> float:
    """Return the largest yaw rate at a speed [rad/s]; see `curvature_limit`."""
    return abs(speed) * curvature_limit(robot, speed)


DAMPING_RATIO = 0.7  # of the nutation at rest; with the speed it becomes faster, not less damped
STANDSTILL = 0.02  # below this speed the pendulum hangs straight [m/s]
# Below this speed the feedback fades, because a tilt turns a slower ball less [m/s].
FADE_SPEED = 0.06


def law(robot: Robot, state: LateralState, speed: float, yaw_rate: float) -> float:
    """
    Return the set-point of the lean that turns the ball at a yaw rate, eq. (S7).

    Parameters
    ----------
    state : LateralState
        Measured or estimated; the heading is not used.
    speed : float
        Speed of the ball along its heading [m/s].
    yaw_rate : float
        Commanded yaw rate; limited to `yaw_rate_limit` [rad/s].

    Returns
    -------
    float
        Set-point within the largest lean [rad].

    Raises
    ------
    ConfigurationError
        If the robot has no steering.

    """
    limits = required_steering(robot)
    first = robot.pendulum_moment
    inertia = (robot.ball_inertia + robot.total_mass * robot.ball_radius**2
               + robot.pendulum_inertia
               + first * (robot.pendulum_length - 2.0 * robot.ball_radius))
    vertical = robot.ball_inertia + robot.pendulum_inertia
    rolling = speed / robot.ball_radius
    lean = 0.0
    if abs(speed) > STANDSTILL:
        turn = steady_turn(robot, speed, yaw_rate / speed)
        if not possible(robot, turn):
            turn = steady_turn(robot, speed, math.copysign(
                curvature_limit(robot, speed), yaw_rate / speed))
        # The vertical angular momentum of the state is conserved, so the tilt follows from it.
        missing = vertical / (robot.ball_inertia * rolling) * (turn.yaw_rate - state.yaw_rate)
        lean = turn.lean - turn.tilt + min(abs(speed) / FADE_SPEED, 1.0) * math.atan(
            math.tan(state.tilt) + missing)
    lean -= (2.0 * DAMPING_RATIO * math.sqrt(inertia / (first * robot.gravity))
             * state.tilt_rate)
    return min(max(lean, -limits.largest_lean), limits.largest_lean)
