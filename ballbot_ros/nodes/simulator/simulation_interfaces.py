# SPDX-License-Identifier: Apache-2.0
"""
The services and the action of simulation_interfaces, where that package is installed.

The state *stopped* means paused at the start of the scene.
"""
from functools import partial
import math
import re
from typing import Any, Optional

from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.task import Future

from ballbot_ros.errors import RefusedError
from ballbot_ros.nodes.simulator.scheduler import Scheduler
from ballbot_ros.nodes.simulator.settings import SimulatorSettings
from ballbot_ros.physics.model.state import State
from ballbot_ros.plant import FloorPlant, Plant
from ballbot_ros.ros.action_server import DeferredActionServer
from ballbot_ros.ros.conversions import to_time
from ballbot_ros.ros.endpoints import create_service, create_wall_timer
from ballbot_ros.ros.frames import Frames
from ballbot_ros.steering import lateral_speed

try:
    from simulation_interfaces.action import SimulateSteps
    from simulation_interfaces.msg import (
        Bounds, EntityCategory, EntityFilters, Result, SimulationState, SimulatorFeatures)
    from simulation_interfaces.srv import (
        GetEntities, GetEntityState, GetSimulationState, GetSimulatorFeatures, ResetSimulation,
        SetEntityState, SetSimulationState, StepSimulation)
    AVAILABLE = True
except ImportError:  # not part of every ROS 2 installation, or older than 2.0
    AVAILABLE = False

FEEDBACK = 0.05  # period of the feedback [s of wall time]


class Refusal(RefusedError):
    """The refusal of a request, with its result code if that is not RESULT_OPERATION_FAILED."""

    def __init__(self, code: int, why: str):
        super().__init__(why, 'refused', 'request')
        self.code = code


def serve(node: Node, plant: Plant, scheduler: Scheduler, settings: SimulatorSettings) -> None:
    """Serve the interfaces; log one line where their package is missing."""
    if AVAILABLE:
        Interfaces(node, plant, scheduler, Frames.of(settings).odom)
    else:
        node.get_logger().info('simulation_interfaces is not installed: the simulator is '
                               'controlled by ~/pause, ~/resume, ~/reset and ~/step only')


class Interfaces:
    """Serves the interfaces; poses are in a frame."""

    def __init__(self, node: Node, plant: Plant, scheduler: Scheduler, frame: str):
        self._plant, self._scheduler, self._frame = plant, scheduler, frame
        self._goal: Optional[ServerGoalHandle] = None
        for kind, name, act in (
                (GetSimulatorFeatures, 'get_simulator_features', self._features),
                (GetSimulationState, 'get_simulation_state', self._get_state),
                (SetSimulationState, 'set_simulation_state', self._set_state),
                (ResetSimulation, 'reset_simulation', self._reset),
                (GetEntities, 'get_entities', self._entities),
                (GetEntityState, 'get_entity_state', self._get_entity),
                (SetEntityState, 'set_entity_state', self._set_entity)):
            create_service(node, kind, f'~/{name}', _answering(act))
        create_service(node, StepSimulation, '~/step_simulation', self._step)
        self._steps = DeferredActionServer(
            node, SimulateSteps, '~/simulate_steps', lambda _: None, self._begin)
        create_wall_timer(node, FEEDBACK, self._update_goal)

    # State

    def _features(self, _: Any, response: Any) -> None:
        named = SimulatorFeatures
        response.features.features = [
            named.ENTITY_CATEGORIES, named.ENTITY_STATE_GETTING, named.ENTITY_STATE_SETTING,
            named.SIMULATION_RESET, named.SIMULATION_RESET_STATE, named.SIMULATION_RESET_TIME,
            named.SIMULATION_STATE_GETTING, named.SIMULATION_STATE_SETTING,
            named.SIMULATION_STATE_PAUSE,
            named.STEP_SIMULATION_SINGLE, named.STEP_SIMULATION_MULTIPLE,
            named.STEP_SIMULATION_ACTION]
        response.features.custom_info = (
            'One robot in a vertical plane; a step is a control period of '
            f'{self._plant.period:g} s.')

    @property
    def _state(self) -> int:
        if not self._scheduler.paused:
            return SimulationState.STATE_PLAYING
        return SimulationState.STATE_STOPPED if self._plant.at_start \
            else SimulationState.STATE_PAUSED

    def _get_state(self, _: Any, response: Any) -> None:
        response.state.state = self._state
        if self._scheduler.failure is not None:
            response.result.error_message = str(self._scheduler.failure)

    def _set_state(self, request: Any, _: Any) -> None:
        named, answer, state = SimulationState, SetSimulationState.Response, request.state.state
        if state == named.STATE_QUITTING:
            raise Refusal(Result.RESULT_FEATURE_UNSUPPORTED,
                          'quitting is not supported: end the process with SIGINT')
        if state not in (named.STATE_STOPPED, named.STATE_PLAYING, named.STATE_PAUSED):
            raise Refusal(answer.INCORRECT_TRANSITION,
                          f'{state} cannot be requested: 0 stops, 1 plays, 2 pauses')
        if state == self._state:
            raise Refusal(answer.ALREADY_IN_TARGET_STATE, 'already in this state')
        if state == named.STATE_PLAYING:
            try:
                self._scheduler.resume()
            except RefusedError as error:
                raise Refusal(answer.STATE_TRANSITION_ERROR, str(error)) from None
        elif state == named.STATE_STOPPED:
            self._scheduler.pause()
            self._scheduler.reset()
        elif self._state == named.STATE_STOPPED:
            raise Refusal(answer.INCORRECT_TRANSITION,
                          'already stopped at the start of the scene: play first')
        else:
            self._scheduler.pause()

    def _reset(self, request: Any, _: Any) -> None:
        scope = request.scope or request.SCOPE_ALL  # 0, the default, resets everything
        if scope == request.SCOPE_TIME and not self._scheduler.makes_time:
            raise Refusal(Result.RESULT_FEATURE_UNSUPPORTED,
                          'the time is that of another simulator: reset that one')
        if scope != request.SCOPE_SPAWNED:  # spawning is not supported
            self._scheduler.reset(bool(scope & request.SCOPE_STATE),
                                  bool(scope & request.SCOPE_TIME))

    # Steps

    def _run(self, steps: int) -> Future:
        if steps < 1:
            raise RefusedError('steps must be at least 1, got 0', 'out_of_range', 'steps')
        return self._scheduler.step(steps)

    def _step(self, request: Any, response: Any) -> Any:
        answer = Future()

        def finish(run: Future) -> None:
            answer.set_result(_ended(response, bool(run.result())))

        try:
            self._run(request.steps).add_done_callback(finish)
        except RefusedError as error:
            return _refused(response, error)
        return answer

    def _begin(self, handle: ServerGoalHandle) -> None:
        try:
            run = self._run(handle.request.steps)
        except RefusedError as error:
            handle.abort()
            return self._steps.finish(handle, _refused(SimulateSteps.Result(), error))
        self._goal = handle
        run.add_done_callback(partial(self._finish, handle))

    def _finish(self, handle: ServerGoalHandle, run: Future) -> None:
        self._publish_state(handle)
        self._goal = None
        if run.result():
            handle.succeed()
        elif handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        self._steps.finish(handle, _ended(SimulateSteps.Result(), bool(run.result())))

    def _update_goal(self) -> None:
        """Publish feedback of the goal, or end it on a cancel request."""
        if self._goal is None:
            return
        if self._goal.is_cancel_requested:
            self._scheduler.pause()  # which ends the steps, and so the goal
        else:
            self._publish_state(self._goal)

    def _publish_state(self, handle: ServerGoalHandle) -> None:
        left = self._scheduler.left
        assert left is not None  # steps are limited
        handle.publish_feedback(SimulateSteps.Feedback(
            completed_steps=handle.request.steps - left, remaining_steps=left))

    # Entities

    @property
    def _robot(self) -> str:
        return self._plant.model.robot.name

    def _entities(self, request: Any, response: Any) -> None:
        if self._passes(request.filters):
            response.entities = [self._robot]

    def _passes(self, filters: 'EntityFilters') -> bool:
        """Return whether the robot, which is the only entity, passes all filters."""
        if filters.tags.tags:
            raise Refusal(Result.RESULT_FEATURE_UNSUPPORTED, 'entities have no tags')
        try:
            named = re.search(filters.filter, self._robot) is not None
        except re.error as error:
            raise Refusal(Result.RESULT_OPERATION_FAILED,
                          f'{filters.filter!r} is not a regular expression: {error}') from None
        kinds = [one.category for one in filters.categories]
        return named and (not kinds or EntityCategory.CATEGORY_ROBOT in kinds) \
            and self._within(filters.bounds)

    def _within(self, bounds: 'Bounds') -> bool:
        if bounds.type == Bounds.TYPE_EMPTY:
            return True
        if bounds.type != Bounds.TYPE_SPHERE:
            raise Refusal(Result.RESULT_FEATURE_UNSUPPORTED, 'bounds can be a sphere only')
        if len(bounds.points) != 2:
            raise Refusal(Result.RESULT_OPERATION_FAILED, 'a sphere has two points')
        centre, (x, y, _) = bounds.points[0], self._plant.relative_pose
        return math.dist((centre.x, centre.y, centre.z), (x, y, self._plant.state.y)) \
            <= bounds.points[1].x + self._plant.model.robot.ball_radius

    def _check_entity(self, entity: str) -> None:
        if entity != self._robot:
            raise Refusal(Result.RESULT_NOT_FOUND,
                          f'there is no {entity!r}, only {self._robot!r}')

    def _get_entity(self, request: Any, response: Any) -> None:
        self._check_entity(request.entity)
        response.state = entity_message(self._plant, self._frame)

    def _set_entity(self, request: Any, _: Any) -> None:
        self._check_entity(request.entity)
        if request.set_pose and isinstance(self._plant, FloorPlant):
            raise Refusal(Result.RESULT_FEATURE_UNSUPPORTED,
                          'a pose on a floor cannot be set: start the simulator with start:=...')
        if request.set_acceleration:
            raise Refusal(Result.RESULT_FEATURE_UNSUPPORTED, 'accelerations follow from forces')
        if request.state.header.frame_id not in ('', self._frame):
            raise Refusal(Result.RESULT_OPERATION_FAILED,
                          f'the frame must be {self._frame!r}, got '
                          f'{request.state.header.frame_id!r}')
        try:
            state = placed(self._plant, request.state, request.set_pose, request.set_twist)
        except RefusedError as error:
            raise Refusal(SetEntityState.Response.INVALID_POSE, str(error)) from None
        self._scheduler.put(state)


def _answering(act: Any) -> Any:
    """Return a service callback that reports a `RefusedError` of `act` in the response."""
    def callback(request: Any, response: Any) -> Any:
        if hasattr(response, 'result'):
            response.result.result = Result.RESULT_OK
        try:
            act(request, response)
        except RefusedError as error:
            return _refused(response, error)
        return response
    return callback


def _refused(response: Any, error: RefusedError) -> Any:
    response.result.result = getattr(error, 'code', Result.RESULT_OPERATION_FAILED)
    response.result.error_message = str(error)
    return response


def _ended(response: Any, complete: bool) -> Any:
    response.result.result = Result.RESULT_OK if complete else Result.RESULT_OPERATION_FAILED
    response.result.error_message = '' if complete else 'ended before all steps were run'
    return response


NEGLIGIBLE = 1e-6  # tolerance of a number that must be zero


def entity_message(plant: Plant, frame: str) -> Any:
    """
    Return the true state of the ball.

    With x forward and z up, y points to the left, so the angles change sign.
    Accelerations are NaN: not measured.
    """
    from simulation_interfaces.msg import EntityState
    state, message = plant.state, EntityState()
    message.header.frame_id, message.header.stamp = frame, to_time(state.time)
    place, turned = message.pose.position, message.pose.orientation
    place.x, place.y, heading = plant.relative_pose
    place.z = state.y
    # About the axle, then about the vertical.
    sine, cosine = math.sin(-0.5 * state.ball_angle), math.cos(0.5 * state.ball_angle)
    turned.x, turned.y = -math.sin(0.5 * heading) * sine, math.cos(0.5 * heading) * sine
    turned.z, turned.w = math.sin(0.5 * heading) * cosine, math.cos(0.5 * heading) * cosine
    twist, side = message.twist, lateral_speed(plant.model.robot, plant.lateral)
    sine, cosine = math.sin(heading), math.cos(heading)
    twist.linear.x = state.velocity_x * cosine - side * sine
    twist.linear.y = state.velocity_x * sine + side * cosine
    twist.linear.z = state.velocity_y
    twist.angular.x, twist.angular.y = state.ball_rate * sine, -state.ball_rate * cosine
    twist.angular.z = plant.lateral.yaw_rate
    for vector in (message.acceleration.linear, message.acceleration.angular):
        vector.x = vector.y = vector.z = math.nan
    return message


def placed(plant: Plant, message: Any, pose: bool, twist: bool) -> State:
    """
    Return the state of a plant with the pose, the twist, or both, of a message.

    The pendulum keeps its absolute angle and rate; the ball keeps its number of full turns.

    Raises `RefusedError` if a value is not finite or not in the plane of motion, or the ball
    penetrates the ground more than twice as deep as at rest.
    """
    state = plant.state
    if pose:
        place, turned = message.pose.position, message.pose.orientation
        _check((place.x, place.y, place.z), (place.y,), 'position')
        _check((turned.x, turned.y, turned.z, turned.w), (turned.x, turned.z), 'orientation')
        if abs(math.hypot(turned.y, turned.w) - 1.0) > 1e-3:
            raise RefusedError(
                'orientation must be a quaternion of length 1', 'out_of_range', 'orientation')
        angle = -2.0 * math.atan2(turned.y, turned.w)
        turns = round((state.ball_angle - angle) / math.tau)
        state = state._replace(x=place.x, y=place.z, ball_angle=angle + math.tau * turns)
        robot, ground = plant.model.robot, float(plant.model.terrain.height(place.x))
        depths = [touch.penetration for touch in plant.model.touches(state)]
        if place.z <= ground:  # a centre in the ground has no contact
            depths.append(robot.ball_radius + ground - place.z)
        deepest, allowed = max(depths, default=0.0), 2.0 * robot.static_penetration
        if deepest > allowed:
            raise RefusedError(
                f'the ball would penetrate the ground by {1e3 * deepest:.1f} mm, '
                f'{1e3 * allowed:.1f} mm is allowed, twice the depth at rest',
                'out_of_range', 'position')
    if twist:
        linear, angular = message.twist.linear, message.twist.angular
        _check((linear.x, linear.y, linear.z), (linear.y,), 'linear velocity')
        _check((angular.x, angular.y, angular.z), (angular.x, angular.z), 'angular velocity')
        state = state._replace(
            velocity_x=linear.x, velocity_y=linear.z, ball_rate=-angular.y)
    return state


def _check(numbers: Any, zeros: Any, what: str) -> None:
    """Refuse numbers that are not finite, or leave the plane of motion."""
    if not all(map(math.isfinite, numbers)):
        raise RefusedError(f'{what} must be finite', 'not_finite', what)
    if any(abs(number) > NEGLIGIBLE for number in zeros):
        raise RefusedError(
            f'{what} must be in the x-z plane, in which the robot moves', 'out_of_range', what)
