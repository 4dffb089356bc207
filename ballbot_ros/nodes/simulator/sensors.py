# SPDX-License-Identifier: Apache-2.0
"""What the simulated sensors of the ground ahead publish, and when."""
from dataclasses import fields
from typing import Any, Dict, List, Tuple

from rclpy.node import Node
from rclpy.publisher import Publisher

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.plant import Latency, periods_per, Plant, Sensor, SensorFaults, TerrainSensor
from ballbot_ros.ros.conversions import observation_message, terrain_message, to_time
from ballbot_ros.ros.endpoints import create_publisher
from ballbot_ros.ros.frames import Frames
from ballbot_ros.ros.parameter_changes import Commit
from ballbot_ros.ros.settings import SimulatorSettings


class Sensors:
    """
    The step sensor and, where it has a rate, the terrain sensor.

    A look is stamped when it was made and published when its latency has passed.

    Parameters
    ----------
    node : Node
    plant : Plant
    settings : SimulatorSettings

    Raises
    ------
    ConfigurationError
        If a rate does not divide the control rate, or in lockstep, where each period of the
        observations waits for its one answer, there may be none or two of them.

    """

    def __init__(self, node: Node, plant: Plant, settings: SimulatorSettings):
        """Create sensors and publishers."""
        self._node, self._plant, self._frames = node, plant, Frames.of(settings)
        self._late: Latency[Tuple[Publisher, Any]] = Latency(settings.sensor_latency)
        self._topics: Dict[str, Publisher] = {}
        self.prepare(settings)()

    def prepare(self, settings: SimulatorSettings) -> Commit:
        """
        Make sensors with these parameters; return what puts them in force.

        A look that is held back keeps its place: only the time until it is told changes.

        Raises
        ------
        ConfigurationError
            See the class.

        """
        faults = SensorFaults(**{item.name: getattr(settings, f'sensor_{item.name}')
                                 for item in fields(SensorFaults)})
        if settings.lockstep:
            check_lockstep(settings)
        ground = self._plant.model.terrain
        step, terrain = None, None
        if settings.observation_rate > 0.0:
            step = Sensor(
                ground, settings.observation_reach, settings.observation_distance_sd,
                settings.observation_height_sd, settings.seed, faults)
        if settings.terrain_rate > 0.0:
            terrain = TerrainSensor(
                ground, settings.terrain_reach, settings.terrain_height_sd, settings.seed, faults)
        periods = [
            periods_per(rate, settings.control_rate, name) if rate > 0.0 else 0
            for name, rate in (('observation_rate', settings.observation_rate),
                               ('terrain_rate', settings.terrain_rate))]

        def commit() -> None:
            self._step, self._terrain = step, terrain
            self._step_periods, self._terrain_periods = periods
            self._late.seconds = faults.latency
            if step is not None:
                self._step_topic = self._topic('step_observation')
            if terrain is not None:
                self._terrain_topic = self._topic('terrain_observation')
        return commit

    def _topic(self, name: str) -> Publisher:
        """Return a publisher, made when it is first needed."""
        if name not in self._topics:
            self._topics[name] = create_publisher(self._node, name)
        return self._topics[name]

    def look(self, everything: bool = False) -> List[Tuple[Publisher, Any]]:
        """
        Return the messages that are to be published now, each with its publisher.

        Parameters
        ----------
        everything : bool
            The state is new: forget what is held back, and look now.

        """
        plant = self._plant
        if everything:
            self._late.clear()
        if self._step is not None and (
                everything or plant.periods % self._step_periods == 0):
            sight = self._step.look(plant.state.x, plant.periods // self._step_periods)
            if sight is not None:
                self._late.put(plant.time, (self._step_topic, observation_message(
                    to_time(plant.time), sight, self._step, self._frames)))
        if self._terrain is not None and (
                everything or plant.periods % self._terrain_periods == 0):
            ground = self._terrain.look(
                plant.state.x, plant.state.y, plant.periods // self._terrain_periods)
            if ground is not None:
                self._late.put(plant.time, (self._terrain_topic, terrain_message(
                    to_time(plant.time), ground, self._frames)))
        return self._late.due(plant.time)


def check_lockstep(settings: SimulatorSettings) -> None:
    """Refuse observations that may come twice, late or not at all."""
    if settings.observation_rate > 0.0 and settings.terrain_rate > 0.0:
        raise ConfigurationError(
            'terrain_rate must be 0 Hz where observation_rate is above 0 Hz in lockstep, where '
            f'each period has one answer, got {settings.observation_rate:g} and '
            f'{settings.terrain_rate:g} Hz; set one of them to 0')
    for name in ('sensor_latency', 'sensor_dropout'):
        if getattr(settings, name) > 0.0:
            raise ConfigurationError(
                f'{name} must be 0 in lockstep, where each period waits for its observation, got '
                f'{getattr(settings, name):g}; set lockstep to false')
