# SPDX-License-Identifier: Apache-2.0
"""Sampled worlds, and rollouts of plans in them."""
from dataclasses import dataclass
import math
from operator import add
from typing import Optional, Sequence

import numpy as np

from ballbot_ros.control.speed_law import SpeedLaw
from ballbot_ros.decision.learning.particles import Particles
from ballbot_ros.decision.planning.ahead import Ahead, FACES_MAX
from ballbot_ros.decision.planning.rollout.rollout import (
    CORNER_FRICTION, DRAW, EDGE_AT, FACE, FALLS, FLOOR_FRICTION, HEIGHT, OVER, pack_scratch, PLACE,
    PlainDrive, PLAN, REST, RESULT, ROBOT, run_many, Scratch, SLOPE, Start, STUCK, TOUCH_SPEED,
    VERDICT)
from ballbot_ros.decision.planning.situation import Knowledge
from ballbot_ros.decision.values import Outlook
from ballbot_ros.physics.model.terrain import Array

# Number of worlds, drawn once and used cyclically.
WORLDS = 1024


@dataclass(frozen=True)
class Tally:
    """Results of the rollouts of one plan."""

    over: float = 0.0
    stuck: float = 0.0
    falls: float = 0.0
    touch_speed: float = 0.0  # sum over the rollouts that touch [m/s]
    touched: float = 0.0
    beyond: float = 0.0  # rollouts that stop only beyond the known ground

    @classmethod
    def of(cls, results: Array, room_to: float = math.inf) -> 'Tally':
        """Count the rows of (n, RESULT) results; ground is known up to `room_to` [m]."""
        verdicts, speeds = results[:, VERDICT], results[:, TOUCH_SPEED]
        touched = np.isfinite(speeds)
        over, stuck, falls = (
            float(np.sum(verdicts == verdict)) for verdict in (OVER, STUCK, FALLS))
        return cls(over, stuck, falls, float(np.sum(speeds[touched])), float(np.sum(touched)),
                   float(np.sum(results[:, REST] > room_to)))

    def __add__(self, other: 'Tally') -> 'Tally':
        """Return the sum of both tallies."""
        return Tally(*map(add, vars(self).values(), vars(other).values()))

    @property
    def attempts(self) -> float:
        """Return the number of rollouts."""
        return self.over + self.stuck + self.falls

    @property
    def probability(self) -> float:
        """Return the expected success probability with a uniform prior (Laplace)."""
        return (self.over + 1.0) / (self.attempts + 2.0)

    @property
    def harm(self) -> float:
        """Return the number of rollouts that do not rest before the line behind the edge."""
        return max(self.falls, self.beyond)

    @property
    def speed(self) -> float:
        """Return the mean speed at touch [m/s]; NaN if none touched."""
        return self.touch_speed / self.touched if self.touched else math.nan

    @property
    def outlook(self) -> Outlook:
        """Return the prediction; NaN without rollouts."""
        number = self.attempts
        if not number:
            return Outlook()
        return Outlook(self.probability, self.stuck / number, self.falls / number,
                       touch_speed=self.speed, attempts=int(round(number)))


class Worlds:
    """
    Worlds sampled from the particles and from the terrain uncertainty.

    The samples are drawn once, and each plan is evaluated in the same samples: a plan that was
    refused is not permitted by other samples in the next search.
    """

    def __init__(self, knowledge: Knowledge):
        robot, tuning, control = knowledge.robot, knowledge.tuning, knowledge.control
        self._seed, self._highest_descent = knowledge.seed, tuning.highest_descent
        # Columns: slope, then height and position of each face, independent of `FACES_MAX`.
        self._normal = np.random.default_rng(self._seed).standard_normal(
            (1 + 2 * FACES_MAX, WORLDS)).T
        self._draws = np.zeros((WORLDS, DRAW))
        self._particles: Optional[Particles] = None
        self._bias = np.zeros(WORLDS)
        law = SpeedLaw.tuned(robot, control)
        self._drive: PlainDrive = (
            control.position_kp, control.position_kd, float(control.gravity_compensation),
            control.torque_limit, robot.motor_line, law[:], tuning.largest_lean,
            tuning.emergency_lean, tuning.dead_time, tuning.cruise_speed)
        self.attempts = 0  # number of rollouts so far
        self.set_particles(knowledge.initial_particles)

    def set_particles(self, particles: Particles) -> None:
        """Use the robots of these particles."""
        if particles is self._particles:
            return
        self._particles = particles
        chosen = np.random.default_rng(self._seed).permutation(
            particles.draw(WORLDS, self._seed))
        self._draws[:, :ROBOT] = particles.rows[chosen]
        self._draws[:, FLOOR_FRICTION] = particles.column('surface_friction')[chosen]
        self._draws[:, CORNER_FRICTION] = particles.column('edge_friction')[chosen]
        self._bias[:] = particles.column('height_bias')[chosen]

    def see(self, ahead: Ahead) -> None:
        """Sample the terrain from its uncertainty."""
        draws, normal = self._draws, self._normal
        draws[:, SLOPE] = normal[:, 0] * ahead.slope_sd
        draws[:, HEIGHT:] = 0.0
        for index, face in enumerate(ahead.faces[:FACES_MAX]):
            # The height bias of a sensor is common to all rising faces.
            draws[:, HEIGHT + index] = (normal[:, 1 + 2 * index] * face.height_sd
                                        - np.sign(face.height) * self._bias)
            draws[:, PLACE + index] = normal[:, 2 + 2 * index] * face.position_sd

    def middle(self) -> Array:
        """Return the mean of all worlds, (1, DRAW)."""
        middle: Array = np.mean(self._draws, axis=0, keepdims=True)
        return middle

    def spread(self) -> float:
        """Return the standard deviation of the height of the first face [m]."""
        return float(np.std(self._draws[:, HEIGHT]))

    def sample(self, count: int, begin: int = 0) -> Array:
        """Return some worlds, starting with number `begin`, (count, DRAW)."""
        chosen = np.arange(begin, begin + count) % WORLDS
        draws: Array = self._draws[chosen]
        return draws

    def attempt(self, start: Start, plans: Sequence[Array], draws: Array, ahead: Ahead,
                raised: float = 0.0) -> Array:
        """
        Return the results of each plan in each world, (k, n, RESULT).

        Parameters
        ----------
        start : tuple
            Position [m], speed [m/s], pendulum angle [rad] and rate [rad/s].
        plans : sequence of (PLAN,) arrays
        draws : (n, DRAW) array
        ahead : Ahead
        raised : float
            Increase of the height of the first face [m].

        """
        rows = np.ascontiguousarray(plans, dtype=float).reshape(-1, PLAN)
        results = np.zeros((len(rows), len(draws), RESULT))
        position, speed, angle, rate = map(float, start)
        run_many((position, speed, angle, rate), rows, np.ascontiguousarray(draws), raised,
                 self._drive, ahead.shape, pack_scratch(Scratch.of(len(ahead.shape))), results)
        self.attempts += results.shape[0] * results.shape[1]
        heights = np.array([face.height for face in ahead.faces[:FACES_MAX]])
        if heights.min() < 0.0:
            # A plan that descends more than `highest_descent` does not succeed.
            down = -heights - draws[:, HEIGHT:HEIGHT + len(heights)]
            deepest = np.maximum.accumulate(
                np.minimum(down, ahead.descents[:len(heights)]), axis=1)
            for row, result in zip(rows, results):
                last = int(ahead.shape[int(row[EDGE_AT]), FACE])
                result[deepest[:, last] > self._highest_descent, VERDICT] = STUCK
        return results
