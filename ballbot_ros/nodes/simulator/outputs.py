# SPDX-License-Identifier: Apache-2.0
"""Outputs of the simulator, each topic at its own rate."""
import math
import struct
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Tuple

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.publisher import Publisher

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.nodes.simulator.settings import SimulatorSettings
from ballbot_ros.physics.model.state import State
from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.plant import FloorPlant, Latency, periods_per, Plant, Sensor, TerrainSensor
from ballbot_ros.ros.conversions import (
    ball_state_message, map_message, observation_message, odometry_message, scan_message,
    sec_nanosec, terrain_message, to_time)
from ballbot_ros.ros.endpoints import create_publisher, has_subscribers
from ballbot_ros.ros.frames import Frames
from ballbot_ros.ros.markers import floor_markers, MarkerTopic, world_markers
from ballbot_ros.ros.message_bytes import CDR, JointStateBytes
from ballbot_ros.ros.odometry import OdometryTopics
from ballbot_ros.ros.parameters import Commit
from ballbot_ros.steering.model import moved_to

# A serialized rosgraph_msgs/Clock (little-endian CDR), cheaper than a message at this rate.
CLOCK = struct.Struct('<4siI')


class Every(NamedTuple):
    """Number of control periods between two messages of each topic."""

    clock: int  # 0: with each message of another topic
    odometry: int
    ball_state: int
    joint_states: int


def every(settings: SimulatorSettings) -> Every:
    """Return the period of each output; raise `ConfigurationError` for an invalid rate."""
    def period(name: str) -> int:
        return periods_per(getattr(settings, name), settings.control_rate, name)
    return Every(period('clock_rate') if settings.clock_rate else 0, period('odom_rate'),
                 period('ball_state_rate'),
                 1 if settings.control == 'direct' else period('joint_state_rate'))


class Outputs:
    """
    Publishes the state of a plant.

    /clock is published first and with every message, unless a lower rate is set, so that no stamp
    is ahead of the receivers' clock; joint_states is published last, because in lockstep its
    answer ends the period.  Messages are not created without subscribers.

    Raises `ConfigurationError` if a rate does not divide the control rate.
    """

    def __init__(self, node: Node, plant: Plant, settings: SimulatorSettings):
        self._plant = plant
        self._last: Dict[str, Tuple[Callable[..., None], Tuple[Any, ...]]] = {}
        self._every = every(settings)
        self._clock: Optional[Publisher] = None
        if settings.publish_clock:
            self._clock = create_publisher(node, '/clock')
        self._odometry = OdometryTopics(node, plant.model.robot, settings, plant.steers)
        self._place = PlaceOnMap(node, plant, settings) if isinstance(plant, FloorPlant) else None
        self._ball = create_publisher(node, 'ball_state')
        self._sensors = Sensors(node, plant, settings)
        self._markers = MarkerTopic(node, settings.publish_markers)
        self._joints = create_publisher(node, 'joint_states')
        self._joint_states = JointStateBytes(
            self._odometry.frames.base, plant.model.robot.has_pendulum, plant.steers)

    def prepare(self, wanted: SimulatorSettings) -> Commit:
        """Check new rates and sensors; return a function that applies them."""
        periods, install = every(wanted), self._sensors.prepare(wanted)

        def commit() -> None:
            self._every = periods
            install()
            if self._place is not None:
                self._place.settings = wanted
        return commit

    def publish(self, everything: bool = False) -> None:
        """Publish the present state, on each topic that is due or on all of them."""
        plant, now, every = self._plant, self._plant.periods, self._every
        odometry, ball_state, joint_states = (
            everything or now % period == 0 for period in every[1:])
        seen = self._sensors.measure(everything)
        marked = self._markers.is_due(plant.time)
        stamped = odometry or ball_state or joint_states or seen or marked
        if stamped if not every.clock else everything or now % every.clock == 0:
            self._send('clock', self._publish_clock, plant.time)
        if odometry:
            self._send('odometry', self._publish_odometry, plant.state)
            if self._place is not None:
                self._send('place', self._odometry.publish_map, plant.time,
                           self._place.of_odom(plant.time))
        if ball_state:
            self._send('ball_state', self._publish_ball_state, plant.state, plant.torque)
        for publisher, message in seen:
            self._send(publisher.topic_name, publisher.publish, message)
        if marked:
            self._markers.publish(
                floor_markers(plant, self._odometry.frames) if isinstance(plant, FloorPlant)
                else world_markers(plant.state, plant.model, self._odometry.frames.odom))
        if joint_states:
            self._send('joint_states', self._joints.publish, self._joint_states.of(
                plant.state.time, plant.state, plant.torque,
                plant.lateral._replace(heading=plant.relative_pose[2])))

    @property
    def state_subscribers(self) -> int:
        """Return the number of subscribers of joint_states."""
        return self._joints.get_subscription_count()

    def repeat(self) -> None:
        """
        Publish the last message of each topic again, with its stamp.

        Late subscribers need it: in lockstep, a restarted controller requires the set-point of
        its period, for which the decision requires the observation.
        """
        for publish, values in self._last.values():
            publish(*values)

    def _send(self, what: str, publish: Callable[..., None], *values: Any) -> None:
        self._last[what] = publish, values
        publish(*values)

    def _publish_clock(self, time: float) -> None:
        if self._clock is not None and has_subscribers(self._clock):
            self._clock.publish(CLOCK.pack(CDR, *sec_nanosec(time)))

    def _publish_odometry(self, state: State) -> None:
        plant = self._plant
        self._odometry.publish(lambda: odometry_message(
            state, plant.relative_pose, plant.lateral, plant.model.robot.ball_radius,
            self._odometry.frames), state.ball_angle, state.joint_angle, plant.lateral)

    def _publish_ball_state(self, state: State, torque: float) -> None:
        if has_subscribers(self._ball):
            self._ball.publish(ball_state_message(
                state, torque, self._plant.model, self._odometry.frames, self._plant.lateral,
                self._plant.relative_pose))


class PlaceOnMap:
    """
    Publishes the map, and computes the pose of ``odom`` on it, exact or with a drifting error.

    The error represents that of a localisation: an Ornstein-Uhlenbeck process for each coordinate.
    `settings` may be replaced.
    """

    CORRELATION = 10.0  # correlation time of the drift [s]

    def __init__(self, node: Node, plant: FloorPlant, settings: SimulatorSettings):
        self._plant, self.settings = plant, settings
        self._error: NDArray[np.float64] = np.zeros(3)
        self._at = 0.0
        self._random = np.random.default_rng([settings.seed, 1])
        self._topic = create_publisher(node, 'map')  # referenced: its message is latched
        self._topic.publish(map_message(plant.floor, Frames.of(settings)))

    def of_odom(self, now: float) -> Tuple[float, float, float]:
        """Return x, y and heading of odom on the map at a time [m], [rad]."""
        elapsed, self._at = max(0.0, now - self._at), now
        left = math.exp(-elapsed / self.CORRELATION)
        sd = np.array([*2 * (self.settings.map_sd,), self.settings.map_heading_sd])
        self._error = left * self._error + math.sqrt(1.0 - left**2) * sd \
            * self._random.standard_normal(3)
        # A heading error turns the map about the robot, not about the origin of the map.
        place, (x, y, heading) = self._plant.relative_pose, self._plant.start_pose
        true_x, true_y, _ = self._plant.pose
        turned = heading + float(self._error[2])
        if not self._error.any():
            return x, y, heading
        away_x, away_y = self._error[:2].tolist()
        shown = true_x + away_x, true_y + away_y
        return (*moved_to(shown, turned, -place[0], -place[1]), turned)


class Sensors:
    """
    The sensors for steps, terrain and, on a floor, laser scans, each if its rate is above 0.

    A measurement is stamped when it is made, and published after the latency.

    Raises `ConfigurationError` if a rate does not divide the control rate, or if in lockstep,
    where each observation period waits for one answer, there may be none or two.
    """

    def __init__(self, node: Node, plant: Plant, settings: SimulatorSettings):
        self._node, self._plant, self._frames = node, plant, Frames.of(settings)
        self._late: Latency[Tuple[Publisher, Any]] = Latency(settings.sensor.latency)
        self._topics: Dict[str, Publisher] = {}
        self.prepare(settings)()

    def prepare(self, settings: SimulatorSettings) -> Commit:
        """
        Create sensors with these parameters; return a function that installs them.

        Pending measurements keep their content; only their latency changes.  Raises as the class.
        """
        if settings.lockstep:
            check_lockstep(settings)
        rates = {'step_observation': 'observation_rate', 'terrain_observation': 'terrain_rate'}
        if isinstance(self._plant, FloorPlant):
            rates['scan'] = 'scan_rate'
        periods = {topic: periods_per(rate, settings.control_rate, name)
                   for topic, name in rates.items() if (rate := getattr(settings, name)) > 0.0}
        ground = self._plant.profile()
        sensors = sensors_on(ground, settings)

        def commit() -> None:
            self._settings, self._periods = settings, periods
            self._ground, (self._step, self._terrain) = ground, sensors
            self._late.seconds = settings.sensor.latency
            for topic in periods.keys() - self._topics:
                self._topics[topic] = create_publisher(self._node, topic)
        return commit

    def measure(self, everything: bool = False) -> List[Tuple[Publisher, Any]]:
        """
        Return the messages that are to be published now, each with its publisher.

        `everything` is for a state that was set: pending measurements are discarded, and all
        sensors measure.
        """
        plant, settings = self._plant, self._settings
        if everything:
            self._late.clear()
        numbers = {topic: plant.periods // period for topic, period in self._periods.items()
                   if everything or plant.periods % period == 0}
        if not numbers:
            return self._late.due(plant.time)
        stamp, ground = to_time(plant.time), plant.profile()
        if ground is not self._ground:
            self._ground, (self._step, self._terrain) = ground, sensors_on(ground, settings)
        for topic, number in numbers.items():
            message = None
            if topic == 'step_observation':
                sight = self._step.measure(plant.state.x, number)
                if sight is not None:
                    message = observation_message(stamp, sight, self._step, self._frames)
            elif topic == 'terrain_observation':
                view = self._terrain.measure(plant.state.x, plant.state.y, number)
                if view is not None:
                    message = terrain_message(stamp, view, self._frames)
            elif isinstance(plant, FloorPlant) and has_subscribers(self._topics[topic]):
                noise = settings.scan_sd * np.random.default_rng(
                    [settings.seed, number]).standard_normal(settings.scan_beams)
                message = scan_message(stamp, plant, settings.scan_beams, settings.scan_reach,
                                       noise, self._frames)
            if message is not None:
                self._late.put(plant.time, (self._topics[topic], message))
        return self._late.due(plant.time)


def sensors_on(ground: Terrain, settings: SimulatorSettings) -> Tuple[Sensor, TerrainSensor]:
    return (Sensor(ground, settings.observation_reach, settings.observation_distance_sd,
                   settings.observation_height_sd, settings.seed, settings.sensor),
            TerrainSensor(ground, settings.terrain_reach, settings.terrain_height_sd,
                          settings.seed, settings.sensor))


def check_lockstep(settings: SimulatorSettings) -> None:
    """Refuse lockstep without commands, or if observations may be repeated, late or missing."""
    if settings.control == 'onboard':
        raise ConfigurationError(
            'lockstep waits for the joint_commands that answer each state, and with '
            'control:=onboard there are none; use control:=direct and a node controller',
            'inconsistent', 'control')
    if settings.observation_rate > 0.0 and settings.terrain_rate > 0.0:
        raise ConfigurationError(
            'terrain_rate must be 0 Hz where observation_rate is above 0 Hz in lockstep, where '
            f'each period has one answer, got {settings.observation_rate:g} and '
            f'{settings.terrain_rate:g} Hz; set one of them to 0', 'inconsistent', 'terrain_rate')
    for name, value in (('sensor_latency', settings.sensor.latency),
                        ('sensor_dropout', settings.sensor.dropout)):
        if value > 0.0:
            raise ConfigurationError(
                f'{name} must be 0 in lockstep, where each period waits for its observation, got '
                f'{value:g}; set lockstep to false', 'inconsistent', name)
