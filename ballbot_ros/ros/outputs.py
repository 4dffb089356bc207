# SPDX-License-Identifier: Apache-2.0
"""What the simulator publishes, each topic at its own rate."""
from typing import Any, Dict

from rclpy.node import Node
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from ballbot_ros.msg import BallState
from ballbot_ros.plant import periods_per, Plant
from ballbot_ros.ros import qos
from ballbot_ros.ros.conversions import (
    ball_state_message, joint_state_message, odometry_message, to_time)
from ballbot_ros.ros.endpoints import create_publisher
from ballbot_ros.ros.markers import MarkerTopic, world_markers
from ballbot_ros.ros.odometry import OdometryTopics
from ballbot_ros.ros.sensors import Sensors
from ballbot_ros.ros.settings import SimulatorSettings


class Outputs:
    """
    Publishes the state of a plant.

    /clock is published first, so that nothing is stamped later than the receivers' clock;
    joint_states is published last, because in lockstep its answer ends the period.

    Parameters
    ----------
    node : Node
    plant : Plant
    settings : SimulatorSettings

    Raises
    ------
    ConfigurationError
        If a rate does not divide the control rate.

    """

    def __init__(self, node: Node, plant: Plant, settings: SimulatorSettings):
        """Create the publishers."""
        self._plant = plant
        self._last: Dict[Publisher, Any] = {}
        rates = ('clock_rate', 'odom_rate', 'ball_state_rate')
        every = [periods_per(getattr(settings, rate), settings.control_rate, rate)
                 for rate in rates]
        self._schedule = list(zip(every, (
            self._publish_clock, self._publish_odometry, self._publish_ball_state)))
        self._clock = create_publisher(node, Clock, '/clock', qos.CLOCK)
        self._odometry = OdometryTopics(node, plant.model.robot, settings)
        self._ball = create_publisher(node, BallState, 'ball_state', qos.STATE)
        self._sensors = Sensors(node, plant, settings)
        self._markers = MarkerTopic(node, settings.publish_markers)
        self._joints = create_publisher(node, JointState, 'joint_states', qos.STATE)
        self._joints_every = 1 if settings.control == 'direct' else periods_per(
            settings.joint_state_rate, settings.control_rate, 'joint_state_rate')

    def publish(self, everything: bool = False) -> None:
        """Publish the present state, on each topic whose turn has come or on all of them."""
        for every, publish in self._schedule:
            if everything or self._plant.periods % every == 0:
                publish()
        for publisher, message in self._sensors.look(everything):
            self._send(publisher, message)
        if self._markers.is_due(self._plant.time):
            self._markers.publish(world_markers(
                self._plant.state, self._plant.model, self._odometry.frames.odom))
        if everything or self._plant.periods % self._joints_every == 0:
            self._send(self._joints, joint_state_message(
                self._plant.state, self._plant.torque, self._plant.model.robot.has_pendulum,
                self._odometry.frames))

    def repeat(self) -> None:
        """
        Publish the last message of each topic again, with its stamp.

        For subscribers that were not there in time: a controller that is started again in
        lockstep needs the set-point of its period, hence the decision the observation.
        """
        for publisher, message in self._last.items():
            publisher.publish(message)

    def _send(self, publisher: Publisher, message: Any) -> None:
        self._last[publisher] = message
        publisher.publish(message)

    def _publish_clock(self) -> None:
        self._send(self._clock, Clock(clock=to_time(self._plant.time)))

    def _publish_odometry(self) -> None:
        state = self._plant.state
        for publisher, message in self._odometry.messages(
                odometry_message(state, self._odometry.frames), state.ball_angle,
                state.joint_angle):
            self._send(publisher, message)

    def _publish_ball_state(self) -> None:
        self._send(self._ball, ball_state_message(
            self._plant.state, self._plant.torque, self._plant.model, self._odometry.frames))
