# SPDX-License-Identifier: Apache-2.0
"""A simulated robot that a `Navigator` drives on a floor, with its sensors and localisation."""
from dataclasses import dataclass
import math
from typing import Callable, Optional, Tuple

import numpy as np

from ballbot_ros.control import JointReadings, PendulumController
from ballbot_ros.decision import Knowledge, Motion, TerrainObservation
from ballbot_ros.floors import Floor, ranges
from ballbot_ros.floors.floor import Point
from ballbot_ros.navigation.crossing import CrossingDriver
from ballbot_ros.navigation.execution import (
    NavigationState, Navigator, Percept, REST)
from ballbot_ros.navigation.sensing import faces_in
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.simulation.solver import Solver
from ballbot_ros.plant import TerrainSensor
from ballbot_ros.plant.floor_plant import FloorPlant
from ballbot_ros.steering import law

CONTROL_RATE = 500  # [Hz]
PERIODS_PER_COMMAND = 10  # control periods between two commands
OBSERVATION_INTERVAL = 5  # commands between two observations while the ball drives freely
RAYS = 96  # of the planar laser, all around
LASER_REACH, TERRAIN_REACH = 3.0, 3.0  # [m]
CORRELATION = 20.0  # time constant of the drift of the localisation [s]


@dataclass(frozen=True)
class Errors:
    """Errors of sensors and localisation; without arguments, none."""

    place_sd: float = 0.0  # stationary standard deviations of the localisation's drift [m], [rad]
    heading_sd: float = 0.0
    height_sd: float = 0.0  # white noise of terrain heights and of laser ranges [m]
    laser_sd: float = 0.0


class FloorLoop:
    """
    Robot, sensors, localisation, `Navigator` and obstacle decision in one process.

    The navigator plans on the map, and the decision assumes the nominal robot; robot and floor are
    the true ones.
    """

    def __init__(self, navigator: Navigator, knowledge: Knowledge, robot: Robot, floor: Floor,
                 pose: Tuple[float, float, float], errors: Errors = Errors(), seed: int = 0):
        self._navigator, self._nominal = navigator, knowledge.robot
        self.plant = FloorPlant(robot, floor, pose, CONTROL_RATE,
                                solver=Solver('adaptive', tolerance=1e-7))
        self._controller = PendulumController(knowledge.robot, knowledge.control)
        self._crossing = CrossingDriver(knowledge)
        self._floor, self._errors, self._seed = floor, errors, seed
        self._random = np.random.default_rng([seed, 7])
        self._drift = np.array([errors.place_sd, errors.place_sd, errors.heading_sd]) \
            * self._random.standard_normal(3)
        self.state, self.command = NavigationState(), REST
        self.ticks = 0
        self.offset = (0.0, 0.0, 0.0)  # of the localisation, set by the caller

    @property
    def percept(self) -> Percept:
        """Return localisation and odometry."""
        x, y, heading = (true + drift + offset for true, drift, offset in zip(
            self.plant.pose, self._drift, self.offset))
        return Percept(self.plant.time, float(x), float(y), float(heading),
                       self.plant.state.velocity_x, crossing=self._crossing.take_report())

    def begin(self, goal: Tuple[float, ...]) -> None:
        """Set a goal; raises `RefusedError` as `Navigator.begin` does."""
        self.state = self._navigator.begin(self.state, goal, self.percept)

    def step(self) -> None:
        """Sense, command and advance by one tick."""
        percept, observations = self.percept, []
        observes = self.ticks % OBSERVATION_INTERVAL == 0 and self.command != REST
        if observes or self.command.crosses:
            observation = self._terrain()
            if observation is not None:
                observations.append(observation)
        if observes:
            percept = percept._replace(
                points=self._scan(percept),
                faces=faces_in(observations[0]) if observations else None)
        self.state, self.command = self._navigator.advance(self.state, percept)
        state = self.plant.state
        self._controller.give(self._crossing.set_point(
            self.command, Motion(self.plant.time, state.x, state.velocity_x), observations))
        self._advance()
        self.ticks += 1

    def _advance(self) -> None:
        plant, decay = self.plant, math.exp(-PERIODS_PER_COMMAND / CONTROL_RATE / CORRELATION)
        lean = law(self._nominal, plant.lateral, plant.state.velocity_x,
                   self._controller.set_point.yaw_rate)
        for _ in range(PERIODS_PER_COMMAND):
            plant.advance(self._controller.torque(JointReadings.of(plant.state)), lean)
        errors = self._errors
        self._drift = decay * self._drift + math.sqrt(1.0 - decay * decay) * np.array(
            [errors.place_sd, errors.place_sd, errors.heading_sd]) \
            * self._random.standard_normal(3)

    def _terrain(self) -> Optional[TerrainObservation]:
        state = self.plant.state
        sensor = TerrainSensor(self.plant.profile(), TERRAIN_REACH, self._errors.height_sd,
                               self._seed)
        seen = sensor.measure(state.x, state.y, self.ticks)
        return None if seen is None else TerrainObservation(
            self.plant.time, seen.x, seen.z, seen.z_sd, seen.x_min, seen.x_max)

    def _scan(self, percept: Percept) -> Tuple[Point, ...]:
        """Return the points of the planar laser in the frame of the map, as localised [m]."""
        x, y, heading = self.plant.pose
        angles = np.linspace(-math.pi, math.pi, RAYS, endpoint=False)
        measured = ranges(self._floor, (x, y), (heading + angles).tolist(), LASER_REACH) \
            + self._errors.laser_sd * self._random.standard_normal(RAYS)
        return tuple((percept.x + distance * math.cos(percept.heading + angle),
                      percept.y + distance * math.sin(percept.heading + angle))
                     for angle, distance in zip(angles.tolist(), measured.tolist())
                     if math.isfinite(distance))

    def run(self, limit: float, listener: Optional[Callable[['FloorLoop'], None]] = None) -> None:
        """Run until the goal has ended, or up to a time [s]."""
        while self.plant.time < limit and not self.state.status.ended:
            self.step()
            if listener is not None:
                listener(self)
