# SPDX-License-Identifier: Apache-2.0
"""
Approaches, drawn: a robot from its ranges, a ground, a sensor, a start.

Approach number n of a seed is the same whatever else is drawn.
"""
from dataclasses import dataclass
import math
from typing import Optional

import numpy as np

from ballbot_ros.control import load_tuning
from ballbot_ros.decision.planning.braking import Braking
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.physics.model.named_parameters import with_parameters
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.uncertainty import changed, independent, uncertain
from ballbot_ros.studies.evaluation.grounds import draw_shape, Ground, lay, STEEPEST
from ballbot_ros.studies.evaluation.sensors import draw_flaws, Flaws

# Behind the room that is known to be free, this much more floor is there, and then none [m].
BRINK = 0.35

SLIPPERY = 0.15  # part of the floors with less friction than anybody would count on


@dataclass(frozen=True)
class Approach:
    """
    One approach, to be run.

    Attributes
    ----------
    seed, number : int
    robot : Robot
        As it truly is.
    ground : Ground
    flaws : Flaws
    speed : float
        At the start [m/s].
    room_behind : float
        As the decision is told [m].

    """

    seed: int
    number: int
    robot: Robot
    ground: Ground
    flaws: Flaws
    speed: float
    room_behind: float

    @property
    def words(self) -> str:
        """Return what it is, for people."""
        robot = self.robot
        return (f'approach {self.number} of seed {self.seed}: {self.ground.words}, foot at '
                f'{self.ground.foot:.3f} m; from {self.speed:.2f} m/s with '
                f'{self.room_behind:.2f} m behind; {self.flaws.words}; M2 '
                f'{robot.pendulum_mass:.2f} kg, J1 {robot.ball_inertia:.3f} kg m2, friction '
                f'{robot.surface_friction:.2f}, of edges {robot.edge_friction:.2f}')


def draw_robot(robot: Robot, random: np.random.Generator) -> Robot:
    """Return a robot from the ranges of the file, with other frictions than it says."""
    free = independent(uncertain(robot))
    parts = random.random(len(free))
    drawn = changed(robot, {name: low + part * (high - low)
                            for part, (name, (low, high)) in zip(parts, free.items())})
    slippery = random.random() < SLIPPERY
    share = random.uniform(0.35, 0.6) if slippery else random.uniform(0.6, 1.3)
    return with_parameters(drawn, {
        'surface_friction': float(robot.surface_friction * share),
        'edge_friction': float(robot.edge_friction * random.uniform(0.6, 1.3))})


def draw_approach(nominal: Robot, tuning: DecisionTuning, seed: int, number: int,
                  kind: Optional[str] = None) -> Approach:
    """Return approach `number` of a seed; on a ground of one kind, if one is given."""
    random = np.random.default_rng([seed, number])
    name, shape = draw_shape(random, kind)
    random = np.random.default_rng([seed, number, 1])
    robot = draw_robot(nominal, random)
    flaws = draw_flaws(random, shape.sensors)
    slope = float(random.uniform(-STEEPEST, STEEPEST)) if random.random() < 0.6 else 0.0
    speed = round(float(random.uniform(0.1, 0.6)), 2) if random.random() < 0.4 else 0.0
    # Nobody is started where he cannot stop any more.
    braking = Braking(nominal, tuning, load_tuning('published'))
    late = speed * flaws.faults.latency + braking.distance(speed, min(0.0, slope), emergency=True)
    room = late + float(random.uniform(0.2, 2.2))
    behind = round(float(random.uniform(0.3, 1.5)), 2) if random.random() < 0.5 else 0.0
    brink = random.random() < 0.5
    foot = nominal.ball_radius + room
    back = behind + nominal.ball_radius + BRINK if brink else None
    return Approach(seed, number, robot, lay(
        name, shape, round(foot, 4), slope, back, robot.surface_friction), flaws, speed, behind)


def balanced_angle(robot: Robot, slope: float) -> float:
    """Return the pendulum angle of a ball that rolls steadily on a slope [rad]."""
    share = (robot.total_mass * robot.ball_radius * math.sin(slope)
             / (robot.pendulum_mass * robot.pendulum_length))
    return math.asin(min(max(share, -1.0), 1.0))
