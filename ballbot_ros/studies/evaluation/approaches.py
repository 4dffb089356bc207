# SPDX-License-Identifier: Apache-2.0
"""
Approaches: a robot drawn from its ranges, a terrain, a sensor, and a start.

Approach number n of a seed does not depend on the other approaches.
"""
from dataclasses import dataclass
import math
from typing import Optional, Sequence, Tuple

import numpy as np

from ballbot_ros.crossing.rules import touch_distance
from ballbot_ros.decision import Knowledge
from ballbot_ros.physics.model.robot import Robot, with_parameters
from ballbot_ros.physics.model.uncertainty import changed, independent, uncertain
from ballbot_ros.studies.evaluation.search import limit_at, set_robots
from ballbot_ros.studies.evaluation.sensors import draw_sensor, SensorModel
from ballbot_ros.studies.evaluation.terrains import draw_shape, Ground, lay, Shape, SLOPE_MAX

SLIPPERY_SHARE = 0.2             # fraction of floors with low friction
UNSEEN_ROOM = 1.0          # floor behind each edge, if the user grants it [m]
CROSSABLE_ROOM = (0.15, 2.5)    # front of the ball to the step [m]
CROSSABLE_HEIGHT = (0.008, 0.06)  # [m]


@dataclass(frozen=True)
class Approach:
    """The inputs of one approach."""

    seed: int
    number: int
    robot: Robot  # the true one
    ground: Ground
    sensor: SensorModel
    speed: float  # at the start [m/s]
    room_behind: float  # of the decision tuning; the ground provides both [m]
    unseen_room: float

    @property
    def description(self) -> str:
        robot = self.robot
        return (f'approach {self.number} of seed {self.seed}: {self.ground.description}, foot at '
                f'{self.ground.foot:.3f} m; from {self.speed:.2f} m/s with '
                f'{self.room_behind:.2f} m behind, unseen_room {self.unseen_room:.2f} m; '
                f'{self.sensor.description}; M2 {robot.pendulum_mass:.2f} kg, J1 '
                f'{robot.ball_inertia:.3f} kg m2, friction {robot.surface_friction:.2f}, of edges '
                f'{robot.edge_friction:.2f}')


def draw_robot(robot: Robot, random: np.random.Generator) -> Robot:
    """Return a robot drawn from the ranges of its file, with drawn coefficients of friction."""
    free = independent(uncertain(robot))
    parts = random.random(len(free))
    drawn = changed(robot, {name: low + part * (high - low)
                            for part, (name, (low, high)) in zip(parts, free.items())})
    slippery = random.random() < SLIPPERY_SHARE
    share = random.uniform(0.3, 0.6) if slippery else random.uniform(0.6, 1.3)
    return with_parameters(drawn, {
        'surface_friction': float(robot.surface_friction * share),
        'edge_friction': float(robot.edge_friction * random.uniform(0.6, 1.3))})


def draw_approach(nominal: Knowledge, seed: int, number: int, kind: Optional[str] = None,
                  sensor: Optional[str] = None) -> Approach:
    """
    Return approach `number` of a seed, on a kind of `terrains.KINDS`, with one of `sensors.KINDS`.

    By default, both are drawn; a sensor that cannot detect the terrain is replaced by another.
    """
    random = np.random.default_rng([seed, number])
    room = UNSEEN_ROOM if random.random() < 0.5 else 0.0
    name, shape = draw_shape(random, room, kind)
    random = np.random.default_rng([seed, number, 1])
    robot = draw_robot(nominal.robot, random)
    model = draw_sensor(random, shape.sensors, sensor)
    slope = float(random.uniform(-SLOPE_MAX, SLOPE_MAX)) if random.random() < 0.6 else 0.0
    if shape.slope is not None:
        slope = float(random.uniform(*shape.slope))
    speed = round(float(random.uniform(0.1, 0.6)), 2) if random.random() < 0.4 else 0.0
    # No approach starts where the ball can no longer stop.
    grip = 0.8 * robot.surface_friction
    slope = max(slope, -math.atan(grip) + 0.01)
    slide = speed**2 / (2.0 * robot.gravity * (grip + math.tan(min(0.0, slope))))
    before = (speed * (model.faults.latency + model.reordering)
              + max(slide, nominal.braking.distance(speed, min(0.0, slope), emergency=True))
              + float(random.uniform(0.2, 2.2)))
    behind = round(float(random.uniform(0.3, 1.5)), 2) if random.random() < 0.5 else 0.0
    # The floor behind the start ends exactly where room_behind ends, or is long.
    radius = nominal.robot.ball_radius
    back = max(behind, radius) if random.random() < 0.5 else None
    foot = round(radius + before, 4)
    ground = lay(name, shape, foot, slope, back, robot.surface_friction)
    return Approach(seed, number, robot, ground, model, speed, behind,
                    room if ground.shortest_floor >= room - 1e-6 else 0.0)


def crossable_approach(nominal: Robot, limits: Sequence[Tuple[float, float]], seed: int,
                       number: int) -> Approach:
    """
    Return approach `number` of a seed to a step that most robots cross, with a perfect sensor.

    The step is on level ground; the robot is one of those of `search.limit_of_most`.
    """
    random = np.random.default_rng([seed, number, 2])
    robots = set_robots(nominal)
    radius = nominal.ball_radius
    while True:
        room = float(random.uniform(*CROSSABLE_ROOM))
        behind = round(float(random.uniform(0.0, 1.5)), 2)
        height = round(float(random.uniform(*CROSSABLE_HEIGHT)), 4)
        robot = robots[int(random.integers(len(robots)))]
        run_up = room + radius + behind - touch_distance(radius, height)
        if height <= limit_at(limits, run_up):
            break
    shape = Shape(f'step of {1e3 * height:.1f} mm', [(0.0, height)], 0.0)
    ground = lay('crossable', shape, round(radius + room, 4), 0.0, max(behind, radius), math.nan)
    return Approach(seed, number, robot, ground, SensorModel(('terrain', 'step')[number % 2]),
                    0.0, behind, UNSEEN_ROOM)
