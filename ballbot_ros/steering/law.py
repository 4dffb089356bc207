# SPDX-License-Identifier: Apache-2.0
"""The steering law: a commanded yaw rate within the limits, and damped nutation."""
import math

from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.steering.limits import curvature_limit, possible, steady_turn
from ballbot_ros.steering.model import LateralState, required_steering

DAMPING_RATIO = 0.7  # of the nutation at rest; with the speed it becomes faster, not less damped
STANDSTILL = 0.02  # below this speed the pendulum hangs straight [m/s]
# Below this speed the feedback fades, as a tilt turns the ball less and less [m/s].
FADE_SPEED = 0.06


def law(robot: Robot, state: LateralState, speed: float, yaw_rate: float) -> float:
    """
    Return the set-point of the lean that turns the ball at a yaw rate, eq. (S7).

    Parameters
    ----------
    robot : Robot
    state : LateralState
        Measured or estimated; the heading is not used.
    speed : float
        Of the ball along its heading [m/s].
    yaw_rate : float
        Commanded; limited to `yaw_rate_limit` [rad/s].

    Returns
    -------
    float
        Within the largest lean [rad].

    Raises
    ------
    ConfigurationError
        If the robot has no steering.

    """
    limits = required_steering(robot)
    first = robot.pendulum_mass * robot.pendulum_length
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
        # The vertical angular momentum of the state stays, so the tilt follows from it.
        missing = vertical / (robot.ball_inertia * rolling) * (turn.yaw_rate - state.yaw_rate)
        lean = turn.lean - turn.tilt + min(abs(speed) / FADE_SPEED, 1.0) * math.atan(
            math.tan(state.tilt) + missing)
    lean -= (2.0 * DAMPING_RATIO * math.sqrt(inertia / (first * robot.gravity))
             * state.tilt_rate)
    return min(max(lean, -limits.largest_lean), limits.largest_lean)
