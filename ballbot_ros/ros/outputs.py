# SPDX-License-Identifier: Apache-2.0
"""What the simulator publishes, each topic at its own rate."""
import struct
from typing import Any, Dict, NamedTuple, Optional

from rclpy.node import Node
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from ballbot_ros.msg import BallState
from ballbot_ros.plant import periods_per, Plant
from ballbot_ros.ros import qos
from ballbot_ros.ros.conversions import (
    ball_state_message, joint_state_message, odometry_message)
from ballbot_ros.ros.endpoints import create_publisher
from ballbot_ros.ros.markers import MarkerTopic, world_markers
from ballbot_ros.ros.odometry import OdometryTopics
from ballbot_ros.ros.parameter_changes import Commit
from ballbot_ros.ros.sensors import Sensors
from ballbot_ros.ros.settings import SimulatorSettings


# A serialized rosgraph_msgs/Clock (little-endian CDR): made so often, messages would cost more.
LITTLE_ENDIAN, CLOCK = b'\0\1\0\0', struct.Struct('<4siI')


class Every(NamedTuple):
    """Control periods from one message to the next."""

    clock: int  # 0: with each message of another topic
    odometry: int
    ball_state: int
    joint_states: int


def every(settings: SimulatorSettings) -> Every:
    """Return when what is due; raise `ConfigurationError` for a rate that does not fit."""
    periods = [periods_per(getattr(settings, name), settings.control_rate, name)
               for name in ('odom_rate', 'ball_state_rate')]
    clock = settings.clock_rate and periods_per(
        settings.clock_rate, settings.control_rate, 'clock_rate')
    return Every(int(clock), *periods, 1 if settings.control == 'direct' else periods_per(
        settings.joint_state_rate, settings.control_rate, 'joint_state_rate'))


class Outputs:
    """
    Publishes the state of a plant.

    /clock is published first, and with everything else, so that nothing is stamped later than the
    receivers' clock, unless its rate says otherwise; joint_states is published last, because in
    lockstep its answer ends the period.

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
        self._every = every(settings)
        self._clock: Optional[Publisher] = None
        if settings.publish_clock:
            self._clock = create_publisher(node, Clock, '/clock', qos.CLOCK)
        self._odometry = OdometryTopics(node, plant.model.robot, settings)
        self._ball = create_publisher(node, BallState, 'ball_state', qos.STATE)
        self._sensors = Sensors(node, plant, settings)
        self._markers = MarkerTopic(node, settings.publish_markers)
        self._joints = create_publisher(node, JointState, 'joint_states', qos.STATE)

    def prepare(self, wanted: SimulatorSettings) -> Commit:
        """Check other rates and sensors; return what puts them in force."""
        periods, see = every(wanted), self._sensors.prepare(wanted)

        def commit() -> None:
            self._every = periods
            see()
        return commit

    def publish(self, everything: bool = False) -> None:
        """Publish the present state, on each topic whose turn has come or on all of them."""
        now, every = self._plant.periods, self._every
        odometry, ball_state, joint_states = (
            everything or now % period == 0 for period in every[1:])
        seen = self._sensors.look(everything)
        marked = self._markers.is_due(self._plant.time)
        stamped = odometry or ball_state or joint_states or seen or marked
        if stamped if not every.clock else everything or now % every.clock == 0:
            self._publish_clock()
        if odometry:
            self._publish_odometry()
        if ball_state:
            self._publish_ball_state()
        for publisher, message in seen:
            self._send(publisher, message)
        if marked:
            self._markers.publish(world_markers(
                self._plant.state, self._plant.model, self._odometry.frames.odom))
        if joint_states:
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
        if self._clock is not None:
            self._send(self._clock, CLOCK.pack(
                LITTLE_ENDIAN, *divmod(round(1e9 * self._plant.time), 10**9)))

    def _publish_odometry(self) -> None:
        state = self._plant.state
        for publisher, message in self._odometry.messages(
                odometry_message(state, self._odometry.frames), state.ball_angle,
                state.joint_angle):
            self._send(publisher, message)

    def _publish_ball_state(self) -> None:
        self._send(self._ball, ball_state_message(
            self._plant.state, self._plant.torque, self._plant.model, self._odometry.frames))
