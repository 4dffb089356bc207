# SPDX-License-Identifier: Apache-2.0
"""The state of the robot as an entity of simulation_interfaces, and back."""
import math
from typing import Any

from ballbot_ros.errors import RefusedError
from ballbot_ros.physics.model.state import State
from ballbot_ros.plant import Plant
from ballbot_ros.ros.conversions import to_time

# What rounding may leave of a number that must be none; how deep the ball may lie [m].
NEGLIGIBLE, DEEPEST = 1e-6, 0.001


def entity_message(state: State, frame: str) -> Any:
    """
    Return the true state of the ball.

    The ball rolls about the y axis, which points away from who sees +x to the right, so its
    angles change sign.  Accelerations are NaN: nobody measures them.
    """
    from simulation_interfaces.msg import EntityState
    message = EntityState()
    message.header.frame_id, message.header.stamp = frame, to_time(state.time)
    place, turned = message.pose.position, message.pose.orientation
    place.x, place.z = state.x, state.y
    turned.y, turned.w = math.sin(-0.5 * state.ball_angle), math.cos(0.5 * state.ball_angle)
    twist = message.twist
    twist.linear.x, twist.linear.z = state.velocity_x, state.velocity_y
    twist.angular.y = -state.ball_rate
    for vector in (message.acceleration.linear, message.acceleration.angular):
        vector.x = vector.y = vector.z = math.nan
    return message


def placed(plant: Plant, message: Any, pose: bool, twist: bool) -> State:
    """
    Return the state of a plant with pose and twist of a message, as far as they are to be set.

    The pendulum keeps its absolute angle and rate; the ball keeps its full turns.

    Raises
    ------
    RefusedError
        If something is not finite, not in the plane of motion, or the ball lies in the ground.

    """
    state = plant.state
    if pose:
        place, turned = message.pose.position, message.pose.orientation
        _check((place.x, place.y, place.z), (place.y,), 'position')
        _check((turned.x, turned.y, turned.z, turned.w), (turned.x, turned.z), 'orientation')
        if abs(math.hypot(turned.y, turned.w) - 1.0) > 1e-3:
            raise RefusedError('orientation must be a quaternion of length 1')
        angle = -2.0 * math.atan2(turned.y, turned.w)
        turns = round((state.ball_angle - angle) / math.tau)
        moved = angle + math.tau * turns - state.ball_angle
        state = state._replace(x=place.x, y=place.z, ball_angle=state.ball_angle + moved)
        deepest = max((touch.penetration for touch in plant.model.touches(state)), default=0.0)
        if deepest > DEEPEST:
            raise RefusedError(
                f'the ball would lie {1e3 * deepest:.1f} mm in the ground, 1 mm is allowed')
    if twist:
        linear, angular = message.twist.linear, message.twist.angular
        _check((linear.x, linear.y, linear.z), (linear.y,), 'linear velocity')
        _check((angular.x, angular.y, angular.z), (angular.x, angular.z), 'angular velocity')
        state = state._replace(
            velocity_x=linear.x, velocity_y=linear.z, ball_rate=-angular.y)
    return state


def _check(numbers: Any, none: Any, what: str) -> None:
    """Refuse numbers that are not finite, or leave the plane of motion."""
    if not all(map(math.isfinite, numbers)):
        raise RefusedError(f'{what} must be finite')
    if any(abs(number) > NEGLIGIBLE for number in none):
        raise RefusedError(f'{what} must be in the x-z plane, in which the robot moves')
