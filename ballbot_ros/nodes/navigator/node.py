# SPDX-License-Identifier: Apache-2.0
"""The node ``navigator``: drives to poses on a floor with steps."""
from dataclasses import replace
from functools import partial
import math
from pathlib import Path
import time
from typing import Any, List, Optional, Tuple

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn

from ballbot_ros.control import load_tuning
from ballbot_ros.decision import (
    check_decision, Knowledge, load_curve, load_decision_tuning, Motion, TerrainObservation)
from ballbot_ros.decision.decider import warm_up
from ballbot_ros.errors import BallbotError, MessageError
from ballbot_ros.floors import load_floor
from ballbot_ros.navigation import Route, RoutePlanner
from ballbot_ros.navigation.crossing import CrossingDriver
from ballbot_ros.navigation.execution import (
    NavigationState, Navigator, NavStatus, Percept)
from ballbot_ros.navigation.learned import Learned
from ballbot_ros.navigation.sensing import faces_in
from ballbot_ros.nodes.navigator.goals import NavigationServers
from ballbot_ros.nodes.navigator.localization import heading_of, Localization
from ballbot_ros.nodes.navigator.outputs import NavigationOutputs
from ballbot_ros.nodes.navigator.settings import NavigatorSettings
from ballbot_ros.physics.model.robot import load_robot
from ballbot_ros.ros import diagnostics
from ballbot_ros.ros.conversions import exact, terrain_observation, to_seconds
from ballbot_ros.ros.endpoints import (
    create_subscription, create_trigger, OdometryTimeout, subscribe_e_stop)
from ballbot_ros.ros.frames import FRAMES
from ballbot_ros.ros.lifecycle import FAILURE, ManagedNode, SUCCESS
from ballbot_ros.ros.parameters import declare
from ballbot_ros.ros.run import run
from ballbot_ros.ros.single_publisher import SinglePublisher

PERIOD = 0.02  # shortest time between two commands [s]
LATEST_SCAN = 0.5  # maximum age of a scan [s]


class NavigatorNode(ManagedNode):
    """
    Plans and drives; `NavigatorSettings` has its parameters.

    *Configure* reads the floor and computes crossings; *activate* accepts goals;
    *deactivate* stops the ball and ends the goal.  With a goal, it publishes cmd_vel on free
    floor, and over steps the set-points of an internal obstacle decision: only one source drives
    at a time, and no node obstacle_decision is needed.
    """

    def __init__(self, **kwargs: Any):
        """Wait for a transition or, with autostart, trigger it."""
        super().__init__('navigator', **kwargs)
        self._settings = declare(self, NavigatorSettings)
        self._robot = load_robot(self._settings.robot)
        self._knowledge = Knowledge(
            self._robot, load_curve(self._settings.curve),
            load_decision_tuning(self._settings.tuning),
            load_tuning(self._settings.control_tuning))
        # Checked before any transition, so that the node ends if they are inconsistent.
        check_decision(self._robot, self._knowledge.curve, self._knowledge.tuning)
        self.navigator: Optional[Navigator] = None
        self.state = NavigationState()
        self.percept: Optional[Percept] = None
        self.e_stop = False  # whether it is engaged
        self._active = False
        self._problem = ''  # why configure failed
        self._odom = SinglePublisher(self, 'odom')
        self._commands = [SinglePublisher(self, topic) for topic in ('cmd_vel', 'set_point')]
        self.refusal: Optional[MessageError] = None  # why the last odometry was not used
        self._observations: List[TerrainObservation] = []
        self._faces: Optional[Tuple[Tuple[float, float], ...]] = None
        self._traveled = 0.0
        self._last: Optional[Odometry] = None
        self._kept: Optional[Learned] = None
        self._published: Optional[Route] = None
        self.localization = Localization(self, self._settings)
        self._outputs = NavigationOutputs(self, self._settings.map_frame)
        create_subscription(self, 'odom', self._on_odometry)
        create_subscription(self, 'terrain_observation', self._on_terrain)
        create_subscription(self, 'goal_pose', self._on_goal)
        subscribe_e_stop(self, self._on_e_stop)
        create_trigger(self, '~/reload', self._reload)
        create_trigger(self, '~/forget', self._forget)
        self.servers = NavigationServers(self)
        self.diagnostics = diagnostics.Diagnostics(
            self, 'navigation', self._health, self._robot.name)
        self._timeout = OdometryTimeout(self, partial(self.abort, 'missing'))
        if self._settings.autostart:
            self.autostart()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read floor and learned file, and compute the crossings."""
        try:
            start = time.monotonic()
            settings = self._settings
            self._kept = Learned.read(Path(settings.learned).expanduser()) \
                if settings.learned else Learned()
            planner = RoutePlanner(load_floor(settings.floor), self._knowledge, self._kept)
            self.navigator = Navigator(planner, self._knowledge)
            self.state = NavigationState(learned=planner.learned)
            self._write()  # a file that cannot be written is reported now
            warm_up(self._knowledge, 'rollout')
            self.navigator.planner.warm_up()
            self._crossing = CrossingDriver(self._knowledge)
        except BallbotError as error:
            if str(error) != self._problem:  # logged once, not with each attempt
                self._problem = str(error)
                self.get_logger().error(f'cannot configure: {error}')
            return FAILURE
        self._problem = ''
        self.get_logger().info(f'ready to plan after {time.monotonic() - start:.1f} s')
        return SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Accept goals."""
        self._active = True
        return SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop the ball and end the goal."""
        self._active = False
        self.abort('inactive', 'the node was deactivated')
        return SUCCESS

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop the ball, end the goal and discard the navigator with its floor."""
        self.on_deactivate(state)
        self.navigator = None
        return SUCCESS

    on_shutdown = on_error = on_cleanup

    @property
    def active(self) -> bool:
        """Return whether goals are accepted."""
        return self._active and self.navigator is not None

    def check_commands(self) -> None:
        """Raise `MessageError` if another node also publishes cmd_vel or set_point."""
        for publishers in self._commands:
            publishers.name()

    def abort(self, reason: str, message: str) -> None:
        """End the active goal immediately, with a command to rest."""
        if not self.state.status.ended:
            self.state = replace(self.state, status=NavStatus.FAILED, reason=reason,
                                 message=message, next=None)
            self._crossing.end()
            self._outputs.rest(self.get_clock().now().to_msg() if self._last is None
                               else self._last.header.stamp)
            self.servers.step()

    def _on_e_stop(self, engaged: bool) -> None:
        self.e_stop = engaged
        if engaged:
            self.abort('e_stop', 'the e-stop is engaged')

    def _on_goal(self, message: PoseStamped) -> None:
        """Drive to a pose that RViz sends."""
        try:
            self.servers.begin_pose(message)
        except BallbotError as error:
            self.servers.count(error)
            self.get_logger().warning(f'goal_pose refused: {error}')

    def _on_terrain(self, message: Any) -> None:
        observation = terrain_observation(message)
        if self._last is not None and observation.frame == self._last.child_frame_id:
            # With a frame_prefix, the frame has another name than the decision requires.
            observation = replace(observation, frame=FRAMES.base)
        self._observations.append(observation)
        del self._observations[:-20]
        try:
            self._faces = faces_in(observation)
        except MessageError as error:
            self.get_logger().warning(
                f'terrain_observation refused: {error}', throttle_duration_sec=1.0)

    def _check_odometry(self, message: Odometry) -> None:
        """Raise `MessageError` for several publishers, another frame, or an old transform."""
        self._odom.name()
        if message.header.frame_id != self._settings.odom_frame:
            raise MessageError(
                f'odom must be in the frame {self._settings.odom_frame!r}, got '
                f'{message.header.frame_id!r}; set odom_frame, or correct the publisher',
                'wrong_frame', 'header.frame_id')
        self.localization.check(to_seconds(message.header.stamp))

    def _on_odometry(self, message: Odometry) -> None:
        try:
            self._check_odometry(message)
        except MessageError as error:
            self.refusal = error
            self.get_logger().warning(f'odom refused: {error}', throttle_duration_sec=1.0)
            self.abort(error.reason, str(error))
            return
        self.refusal, last = None, self._last
        if last is not None and exact(message) < exact(last):
            self.abort('time_jump', 'time went back')
            self._observations.clear()
        position, heading = message.pose.pose.position, heading_of(message.pose.pose.orientation)
        if last is None or self.state.status is not NavStatus.CROSSING:
            self._traveled = 0.0
        else:
            before = last.pose.pose.position
            self._traveled += (position.x - before.x) * math.cos(heading) \
                + (position.y - before.y) * math.sin(heading)
        self._last = message
        self._timeout.restart()
        now = to_seconds(message.header.stamp)
        if self.percept is not None and 0.0 < now - self.percept.stamp < PERIOD - 1e-6:
            return
        # In lockstep, the simulator repeats a state until it is answered.
        if self._outputs.repeat(message.header.stamp):
            return
        pose = self.localization.on_map(position.x, position.y, heading)
        if pose is None:
            return
        self.percept = Percept(now, *pose, message.twist.twist.linear.x,
                               self.localization.points(
                                   pose, message.child_frame_id, now - LATEST_SCAN), self._faces)
        self._faces = None
        if self.active:
            self._drive(self.percept, message)

    def _drive(self, percept: Percept, message: Odometry) -> None:
        """Advance the navigation, and publish its command while there is a goal."""
        assert self.navigator is not None
        if self.state.status.ended:
            return
        try:
            self.check_commands()
        except MessageError as error:
            self.abort(error.reason, str(error))
            return
        self.state, command = self.navigator.advance(
            self.state, percept._replace(crossing=self._crossing.take_report()))
        if self.state.route is not self._published:
            self._published = self.state.route
            self._outputs.plan(self._published, message.header.stamp)
            if self.state.message:
                self.get_logger().info(self.state.message)
        self._outputs.command(message.header.stamp, self._crossing.set_point(
            command, Motion(percept.stamp, self._traveled, percept.speed), self._observations))
        self._observations.clear()
        self._keep()
        self.servers.step()

    def _keep(self) -> None:
        """Write the learned data to their file, if they have changed."""
        if self.state.learned != self._kept:
            self._kept = self.state.learned
            self._write()

    def _write(self) -> None:
        if not self._settings.learned:
            return
        try:
            self.state.learned.write(Path(self._settings.learned).expanduser())
        except OSError as error:
            self.get_logger().warning(
                f'learned data cannot be kept: {error}', throttle_duration_sec=10.0)

    def _reload(self) -> str:
        """Reload the floor; if it has changed, the ball stops and replans."""
        if self.navigator is None:
            raise BallbotError('the node is not configured', 'inactive', 'navigator')
        floor = load_floor(self._settings.floor)
        self.state = self.navigator.with_floor(self.state, floor)
        return f'floor {floor.name} read'

    def _forget(self) -> str:
        """Delete the learned data of the floor."""
        self.state = replace(self.state, learned=Learned(places=self.state.learned.places))
        if self.navigator is not None:
            self.navigator.planner.learn(self.state.learned)
        self._keep()
        return 'heights, obstacles and outcomes deleted'

    def make_safe(self) -> None:
        """Publish a final command to rest."""
        self.abort('inactive', 'navigator was ended')

    def _health(self) -> Tuple[bytes, str, dict]:
        values = {'status': self.state.status.value, 'replans': self.state.replans,
                  'obstacles': len(self.state.learned.obstacles),
                  **diagnostics.refusals('goals', self.servers.refused)}
        if not self.active:
            return diagnostics.WARN, ': '.join(filter(None, ('inactive', self._problem))), values
        if self.refusal is not None:
            return diagnostics.WARN, str(self.refusal), values
        try:
            self.check_commands()
        except MessageError as error:
            return diagnostics.WARN, str(error), values
        if self.percept is None:
            return diagnostics.WARN, 'waiting for odom' if self._last is None else (
                f'waiting for the transform from {self._settings.map_frame} to '
                f'{self._settings.odom_frame}'), values
        failed = self.state.status is NavStatus.FAILED
        return diagnostics.WARN if failed else diagnostics.OK, \
            self.state.message or self.state.status.value, values


def main(args: Optional[List[str]] = None) -> int:
    return run(NavigatorNode, args)
