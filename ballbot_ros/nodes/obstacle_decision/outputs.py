# SPDX-License-Identifier: Apache-2.0
"""Outputs of the decision: decision, set-point, markers, and a monitor of the followers' gains."""
import math
from typing import Optional, Tuple

from builtin_interfaces.msg import Time
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import ParameterEvent
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import qos_profile_parameter_events
from sensor_msgs.msg import JointState

from ballbot_ros.decision.decider import Answer
from ballbot_ros.msg import StepDecision
from ballbot_ros.nodes.obstacle_decision.settings import DecisionSettings
from ballbot_ros.ros.conversions import (
    decision_message, motion, set_point_message, to_seconds, to_time)
from ballbot_ros.ros.endpoints import (
    create_publisher, create_subscription, endpoint_name, wait_until_received)
from ballbot_ros.ros.markers import decision_markers, MarkerTopic

EVENTS = '/parameter_events'


class GainWatch:
    """
    Monitors the gains of the nodes that follow the set-points of a node.

    Plans depend on the gains (``control_tuning``), which determine how the pendulum moves to its
    set angle.  New gains are not adopted automatically: several nodes may follow, and the learned
    parameters depend on the gains.
    """

    def __init__(self, node: Node):
        self._node, self._topic = node, node.resolve_topic_name('set_point')
        create_subscription(
            node, EVENTS, self.on_event, ParameterEvent, qos_profile_parameter_events)

    def on_event(self, event: ParameterEvent) -> None:
        """Warn when a node that follows the set-points changes its gains."""
        changed = {one.name: parameter_value_to_python(one.value)
                   for one in event.changed_parameters
                   if one.name == 'tuning' or one.name.startswith('gains.')}
        followers = map(endpoint_name, self._node.get_subscriptions_info_by_topic(self._topic))
        if not changed or event.node not in followers:
            return
        planned = self._node.get_parameter('control_tuning').value
        if 'tuning' in changed:
            if changed['tuning'] == planned:
                return
            changed = {'tuning': changed['tuning']}
        gains = ', '.join(f'{name} {value}' for name, value in changed.items())
        self._node.get_logger().warning(
            f'{event.node} now uses other gains ({gains}), but plans are still computed for '
            f'control_tuning {planned!r}: to keep them, set control_tuning to a file with '
            'these gains')


class DecisionOutputs:
    """Publishes step_decision, set_point and markers."""

    def __init__(self, node: Node, settings: DecisionSettings, radius: float):
        """Create the publishers; the radius is that of the ball [m]."""
        self._frame, self._radius = settings.terrain_frame, radius
        self._markers = MarkerTopic(node, settings.publish_markers)
        self._decisions = create_publisher(node, 'step_decision')
        self._set_points = create_publisher(node, 'set_point')
        self._gains = GainWatch(node)
        self._newest: Optional[Tuple[Optional[StepDecision], JointState]] = None

    @property
    def time(self) -> float:
        """Return the stamp of the newest set-point, infinity before the first one [s]."""
        return math.inf if self._newest is None else to_seconds(self._newest[1].header.stamp)

    def forget(self) -> None:
        """Clear the message to repeat."""
        self._newest = None

    def decide(self, stamp: Time, answer: Answer, odometry: Odometry) -> None:
        """Publish a decision with the stamp of its observation, and the current set-point."""
        if self._markers.is_due(to_seconds(stamp)):
            self._markers.publish(decision_markers(answer.decision, odometry, self._radius))
        # In lockstep the stamp of the set-point identifies its period.
        self._newest = (decision_message(stamp, answer.decision, motion(odometry).position,
                                         self._frame),
                        set_point_message(to_time(answer.stamp), answer.set_angle))
        self.repeat()

    def rest(self, stamp: Time) -> None:
        """Publish a set-point for rest, and no decision."""
        self._newest = None, set_point_message(stamp, 0.0)
        self.repeat()

    def repeat(self) -> None:
        """Publish the newest decision and set-point again, if any."""
        if self._newest is not None:
            decision, set_point = self._newest
            if decision is not None:
                self._decisions.publish(decision)
            self._set_points.publish(set_point)

    def end(self, stamp: Time) -> None:
        """Lower the pendulum, if it was driven, and wait until the set-point is received."""
        if self._newest is not None:
            self._set_points.publish(set_point_message(stamp, 0.0))
            wait_until_received(self._set_points)
