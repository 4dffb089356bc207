# SPDX-License-Identifier: Apache-2.0
"""Outputs of the decision: the newest decision and its set-point."""
import math
from typing import Optional, Tuple

from builtin_interfaces.msg import Time
from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import JointState

from ballbot_ros.decision.decider import Answer
from ballbot_ros.msg import StepDecision
from ballbot_ros.nodes.obstacle_decision.gain_watch import GainWatch
from ballbot_ros.nodes.obstacle_decision.settings import DecisionSettings
from ballbot_ros.ros.conversions import decision_message, set_point_message, to_seconds, to_time
from ballbot_ros.ros.endpoints import create_publisher, wait_until_received
from ballbot_ros.ros.markers import decision_markers, MarkerTopic


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
        """Return the stamp of the newest set-point, infinity before there is one [s]."""
        return math.inf if self._newest is None else to_seconds(self._newest[1].header.stamp)

    def forget(self) -> None:
        """Clear the message to repeat."""
        self._newest = None

    def decide(self, stamp: Time, answer: Answer, odometry: Odometry) -> None:
        """Publish a decision stamped like its observation, and the set-point for now."""
        if self._markers.is_due(to_seconds(stamp)):
            self._markers.publish(decision_markers(answer.decision, odometry, self._radius))
        # In lockstep the stamp of the set-point identifies its period.
        self._newest = (decision_message(stamp, answer.decision, self._frame),
                        set_point_message(to_time(answer.stamp), answer.set_angle))
        self.repeat()

    def rest(self, stamp: Time) -> None:
        """Publish a set-point for rest, and no decision."""
        self._newest = None, set_point_message(stamp, 0.0)
        self.repeat()

    def repeat(self) -> None:
        """Publish the newest again, if there is one."""
        if self._newest is not None:
            decision, set_point = self._newest
            if decision is not None:
                self._decisions.publish(decision)
            self._set_points.publish(set_point)

    def end(self, stamp: Time) -> None:
        """Lower the pendulum, if it was driven, and wait until this is received."""
        if self._newest is not None:
            self._set_points.publish(set_point_message(stamp, 0.0))
            wait_until_received(self._set_points)
