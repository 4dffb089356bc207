# SPDX-License-Identifier: Apache-2.0
"""The actions ``~/drive_to`` and ``~/cross_step``; `decision.goals` implements their behaviour."""
import math
from typing import Any, Optional, Tuple

from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node

from ballbot_ros.action import CrossStep, DriveTo
from ballbot_ros.decision import (
    CrossGoal, Decider, Decision, DriveGoal, Ending, GoalEnd, Motion)
from ballbot_ros.errors import RefusedError
from ballbot_ros.nodes.obstacle_decision.standstill import Standstill
from ballbot_ros.ros.action_server import DeferredActionServer
from ballbot_ros.ros.conversions import decision_message, to_time
from ballbot_ros.ros.endpoints import OdometryTimeout

FEEDBACK = 0.1  # period of the feedback [s]


class GoalServers:
    """Serves both actions, one goal at a time; during a standstill, goals are rejected."""

    def __init__(self, node: Node, decider: Decider, standstill: Standstill):
        self._node, self._decider, self._standstill = node, decider, standstill
        self._running: Optional[Tuple[DeferredActionServer, ServerGoalHandle]] = None
        self._goal: Any = None
        self._last_feedback = -math.inf
        self._drive = DeferredActionServer(
            node, DriveTo, '~/drive_to', self._check_drive,
            lambda handle: self._begin(self._drive, handle))
        self._cross = DeferredActionServer(
            node, CrossStep, '~/cross_step', self._check_cross,
            lambda handle: self._begin(self._cross, handle))
        self._timeout = OdometryTimeout(node, self.abort)

    def _check(self) -> Motion:
        """Return the motion at the start of a goal; raise `RefusedError` if none can start."""
        decider = self._decider
        if self._standstill.standing:
            raise RefusedError(self._standstill.reason, 'standing', 'e_stop')
        if decider.goals.goal is not None:
            raise RefusedError('another goal is active: cancel it first', 'busy', 'goal')
        if decider.motion is None or decider.planned is None:
            raise RefusedError(
                'no odometry received yet: is a simulator or a bridge running?', 'missing', 'odom')
        return decider.motion

    def _check_drive(self, request: DriveTo.Goal) -> None:
        start, decider = self._check(), self._decider
        target = request.target + (start.position if request.relative else 0.0)
        self._goal = DriveGoal(
            start, target, request.speed_limit, request.tolerance, request.timeout,
            decider.knowledge.tuning, decider.knowledge.robot.ball_radius, decider.free_from)

    def _check_cross(self, request: CrossStep.Goal) -> None:
        self._goal = CrossGoal(self._check(), request.timeout)

    def _begin(self, server: DeferredActionServer, handle: ServerGoalHandle) -> None:
        self._decider.goals.begin(self._goal)
        self._running, self._last_feedback = (server, handle), -math.inf
        self._timeout.restart()

    def step(self) -> None:
        """Update the goal; called after each decision."""
        if self._running is None:
            return
        decider, (server, handle) = self._decider, self._running
        self._timeout.restart()
        if decider.end is not None:
            return self._finish(server, handle, decider.end)
        if handle.is_cancel_requested and not self._goal.canceled:
            self._goal.cancel()
        motion, planned = decider.motion, decider.planned
        assert motion is not None and planned is not None  # there has been a decision
        if motion.stamp - self._last_feedback >= FEEDBACK:
            self._last_feedback = motion.stamp
            handle.publish_feedback(self._feedback(motion, planned))

    def abort(self, why: str) -> None:
        """Abort the active goal, if any, because of the e-stop or missing odometry."""
        if self._running is not None:
            self._decider.goals.end()
            self._finish(*self._running, GoalEnd(
                Ending.E_STOP if self._standstill.engaged else Ending.LOST, why))

    def _finish(self, server: DeferredActionServer, handle: ServerGoalHandle,
                end: GoalEnd) -> None:
        self._running = None
        self._node.get_logger().info(f'{end.ending.value}: {end.message}')
        if end.ending in (Ending.REACHED, Ending.CROSSED):
            handle.succeed()
        elif end.ending is Ending.CANCELED:
            handle.canceled()
        else:
            handle.abort()
        server.finish(handle, self._result(end))

    def _result(self, end: GoalEnd) -> Any:
        decider, goal = self._decider, self._goal
        kind = DriveTo.Result if isinstance(goal, DriveGoal) else CrossStep.Result
        result = kind(outcome=getattr(kind, f'OUTCOME_{end.ending.name}'), message=end.message,
                      position=decider.motion.position if decider.motion else math.nan)
        result.decision, result.reason, _ = _in_force(decider)
        if isinstance(goal, DriveGoal):
            result.remaining = goal.target - result.position
        else:
            result.height = goal.height
        return result

    def _feedback(self, motion: Motion, planned: Decision) -> Any:
        goal = self._goal
        kind = DriveTo.Feedback if isinstance(goal, DriveGoal) else CrossStep.Feedback
        feedback = kind(position=motion.position, speed=motion.speed)
        feedback.decision, _, feedback.message = _in_force(self._decider)
        if isinstance(goal, CrossGoal):
            feedback.phase = getattr(kind, f'PHASE_{goal.phase.name}')
            feedback.distance, feedback.height = planned.distance, planned.height
            feedback.probability = planned.outlook.probability
        else:
            feedback.remaining = goal.target - motion.position
        return feedback


def _in_force(decider: Decider) -> Tuple[int, int, str]:
    """Return kind, reason and explanation of the last decision about the terrain."""
    planned, decision = decider.planned, decider.decision
    if planned is None or decision is None:
        return 0, 0, ''
    message = decision_message(to_time(0.0), planned)
    return message.decision, message.reason, decision.explanation
