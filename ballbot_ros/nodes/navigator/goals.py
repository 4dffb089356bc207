# SPDX-License-Identifier: Apache-2.0
"""The actions ``navigate_to_pose`` and ``compute_path_to_pose``, and goals from goal_pose."""
from collections import Counter
import math
import time
from typing import Any, Optional, Tuple

from geometry_msgs.msg import PoseStamped
from rclpy.action.server import ServerGoalHandle
from rclpy.duration import Duration

from ballbot_ros.errors import BallbotError, RefusedError
from ballbot_ros.navigation.execution import NavStatus
from ballbot_ros.nodes.navigator.localization import heading_of
from ballbot_ros.nodes.navigator.outputs import path_message, stamped_pose
from ballbot_ros.ros.action_server import DeferredActionServer
from ballbot_ros.ros.conversions import to_time

try:
    from nav2_msgs.action import ComputePathToPose, NavigateToPose
except ImportError:
    from ballbot_ros.action import ComputePathToPose, NavigateToPose

__all__ = ['ComputePathToPose', 'NavigateToPose', 'NavigationServers']

FEEDBACK = 0.2  # period [s]
FAILED = 9000  # error_code; error_msg begins with the reason code


class NavigationServers:
    """Serves both actions; a new goal replaces the active one, whose action is aborted."""

    def __init__(self, node: Any):
        self._node = node
        self.refused: Counter = Counter()  # goals by reason
        self._handle: Optional[ServerGoalHandle] = None
        self._started = self._feedback_at = -math.inf
        self._navigate = DeferredActionServer(
            node, NavigateToPose, 'navigate_to_pose', self._check, self._begin)
        self._compute = DeferredActionServer(
            node, ComputePathToPose, 'compute_path_to_pose', self._check_plan, self._plan)

    def _goal(self, message: PoseStamped) -> Tuple[float, ...]:
        """
        Return x, y and heading, without a heading if all components of the quaternion are 0.

        Raises `RefusedError` for another frame or a pose that is not finite.
        """
        frame = self._node._settings.map_frame
        if message.header.frame_id not in ('', frame):
            raise RefusedError(
                f'the pose must be in the frame {frame!r}, got {message.header.frame_id!r}; '
                f'transform it, or set the fixed frame of RViz to {frame!r}',
                'wrong_frame', 'header.frame_id')
        at, turn = message.pose.position, message.pose.orientation
        goal: Tuple[float, ...] = (at.x, at.y)
        if any((turn.x, turn.y, turn.z, turn.w)):
            goal = (at.x, at.y, heading_of(turn))
        if not all(map(math.isfinite, goal)):
            raise RefusedError(
                'the position must be finite, and the quaternion of length 1, or 0 for any '
                f'heading, got {goal}', 'not_finite', 'pose')
        return goal

    def _ready(self) -> None:
        node = self._node
        if not node.active:
            raise RefusedError('navigator is not active', 'inactive', 'navigator')
        if node.refusal is not None:
            raise node.refusal
        if node.percept is None:
            raise RefusedError(
                'no pose on the map: odom, or the transform from the map to it, is missing',
                'missing', 'odom')

    def _ready_to_drive(self) -> None:
        self._ready()
        if self._node.e_stop:
            raise RefusedError('the e-stop is engaged: release it first', 'e_stop', 'e_stop')
        self._node.check_commands()

    def _check(self, request: Any) -> None:
        try:
            self._ready_to_drive()
            self._node.navigator.planner.check_goal(self._goal(request.pose))
        except BallbotError as error:
            self.count(error)
            raise

    def count(self, error: BallbotError) -> None:
        """Count a refused goal by its reason."""
        self.refused[getattr(error, 'reason', 'failed')] += 1
        self._node.diagnostics.publish()

    def begin_pose(self, message: PoseStamped, handle: Optional[ServerGoalHandle] = None) -> None:
        """Drive to a pose, of an action if a handle is given; this replaces an active goal."""
        node = self._node
        self._ready_to_drive()
        node.state = node.navigator.begin(node.state, self._goal(message), node.percept)
        replaced, self._handle, self._started = self._handle, handle, node.percept.stamp
        if replaced is not None:
            replaced.abort()
            self._navigate.finish(replaced, NavigateToPose.Result(
                error_code=FAILED, error_msg='preempted: another goal replaced this one'))
        self.step()  # a ball at the goal has already arrived

    def _begin(self, handle: ServerGoalHandle) -> None:
        try:
            self.begin_pose(handle.request.pose, handle)
        except BallbotError as error:
            self._fail(self._navigate, handle, NavigateToPose, error)

    def _check_plan(self, request: Any) -> None:
        self._ready()
        self._goal(request.goal)

    def _plan(self, handle: ServerGoalHandle) -> None:
        node, request, started = self._node, handle.request, time.monotonic()
        percept = node.percept
        try:
            start = self._goal(request.start) if request.use_start else (
                percept.x, percept.y, percept.heading)
            planner, goal = node.navigator.planner, self._goal(request.goal)
            route = planner.route(start, goal)
        except BallbotError as error:
            self._fail(self._compute, handle, ComputePathToPose, error)
            return
        handle.succeed()
        node.get_logger().info(planner.explain(route, start, goal) or 'the shortest path')
        self._compute.finish(handle, ComputePathToPose.Result(
            path=path_message(route, node._settings.map_frame, to_time(percept.stamp)),
            planning_time=Duration(seconds=time.monotonic() - started).to_msg()))

    def step(self) -> None:
        """Log the end of a goal, and update its action; called at each command of a goal."""
        handle, node = self._handle, self._node
        state = node.state
        if state.status.ended:
            node.get_logger().info(f'{state.status.value}: {state.message}')
        if handle is None:
            return
        if state.status.ended:
            self._handle = None
            result = NavigateToPose.Result()
            if state.status is NavStatus.SUCCEEDED:
                handle.succeed()
            else:
                result.error_code, result.error_msg = FAILED, f'{state.reason}: {state.message}'
                (handle.canceled if state.status is NavStatus.CANCELED else handle.abort)()
            self._navigate.finish(handle, result)
            return
        if handle.is_cancel_requested and state.next is not NavStatus.CANCELED:
            node.state = node.navigator.cancel(state)
        if not 0.0 <= node.percept.stamp - self._feedback_at < FEEDBACK:
            self._feedback_at = node.percept.stamp
            handle.publish_feedback(self._feedback())

    def _feedback(self) -> Any:
        node = self._node
        percept, state = node.percept, node.state
        segments = state.route.segments[state.index:] if state.route is not None else ()
        length = sum(math.dist(one, two) for segment in segments
                     for one, two in zip(segment.points, segment.points[1:])) - state.along
        return NavigateToPose.Feedback(
            current_pose=stamped_pose(node._settings.map_frame, to_time(percept.stamp),
                                      percept.x, percept.y, percept.heading),
            navigation_time=Duration(seconds=max(percept.stamp - self._started, 0.0)).to_msg(),
            estimated_time_remaining=Duration(seconds=state.remaining).to_msg(),
            number_of_recoveries=state.recoveries, distance_remaining=max(length, 0.0))

    def _fail(self, server: DeferredActionServer, handle: ServerGoalHandle, kind: Any,
              error: BallbotError) -> None:
        self._node.get_logger().warning(f'{kind.__name__} failed: {error}')
        handle.abort()
        server.finish(handle, kind.Result(
            error_code=FAILED, error_msg=f'{getattr(error, "reason", "")}: {error}'))
