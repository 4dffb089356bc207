# SPDX-License-Identifier: Apache-2.0
"""
Success probability of a crossing for each particle, from attempts with the full model.

An attempt with a particle's robot gives a score, which decreases with the height of the step and
is zero where the ball just crosses (see `crossing.attempt`).  Its derivatives with respect to
height and touch speed agree within a few per cent for all particles, and are computed for the mean
one.  With the standard deviations of height and speed the score gives a probability.

A likely success contains little information.  The speed past the face measures the reserve: the
score is the square of a speed, which is compared with the measured one.
"""
import math
from typing import NamedTuple, Optional, Tuple

import numpy as np
from numpy.typing import ArrayLike

from ballbot_ros.crossing.attempt import LEAST
from ballbot_ros.crossing.max_step_height import (
    ACTUATOR, Crossings, OUTCOME, PARAMETERS, ROLLED, SCORE)
from ballbot_ros.crossing.rules import held_at, Rules, Site
from ballbot_ros.decision.learning.outcomes import Outcome
from ballbot_ros.decision.learning.particles import (
    EDGE_FRICTION, HEIGHT_BIAS, Particles, SURFACE_FRICTION)
from ballbot_ros.physics.model.actuation import Actuation, Actuator
from ballbot_ros.physics.model.robot import (
    ContactOptions, Parameters, Robot, with_parameters)
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.solvers.values import FINISHED

# Local error per step of an attempt [m], and its maximum function evaluations and time [s].
SOLVER_TOLERANCE, EVALUATIONS_MAX, ATTEMPT_TIME_MAX = 1e-4, 200_000, 1.5
# Steps of the finite differences of the score: height [m] and fraction of the speed.
HEIGHT_STEP, SPEED_STEP = 0.002, 0.05
# Minimum touch speed of a usable outcome [m/s].
TOUCH_SPEED_MIN = 0.1
# Uncertain fraction of the slip past the face.
SLIP_FRACTION = 0.4
# Fraction of the outcomes that the model does not explain: a person pushed the ball, or the sensor
# mistook another object for the step.
OUTLIER_FRACTION = 0.05
# Standard deviations: speeds at the touch and past the face [m/s], and the maximum step height of
# a robot with known parameters [m].
SPEED_SD, PASSED_SD, MODEL_SD = 0.02, 0.04, 0.0005


class Touching(NamedTuple):
    """Conditions of a touch, for which a probability is computed."""

    height: float  # measured [m]
    height_sd: float  # without the bias [m]
    speed: float  # [m/s]
    angle: float  # of the pendulum at the touch [rad]
    set_angle: float  # of law (11) from then on [rad]
    slope: float = 0.0  # of the ground before the step [rad]

    @classmethod
    def of(cls, outcome: Outcome) -> 'Touching':
        """Return the conditions of the touch of an outcome."""
        plan, set_angle = outcome.plan, outcome.held_angle
        if plan is not None and math.isfinite(plan.swing_position):
            set_angle = plan.swing_angle
        return cls(outcome.height, outcome.height_sd, outcome.touch_speed, outcome.touch_angle,
                   set_angle, outcome.slope)


class Chances:
    """Success probability at a step for each particle, computed in portions."""

    def __init__(self, particles: Particles, touching: Touching):
        """Prepare the attempts that `advance` runs."""
        self._touching = touching
        mean = particles.weights @ particles.rows
        friction = np.column_stack([particles.column(name)
                                    for name in (SURFACE_FRICTION, EDGE_FRICTION)])
        # Four additional rows: the mean robot on a higher and a lower step, faster and slower.
        heights = touching.height - particles.column(HEIGHT_BIAS)
        middle = touching.height - particles.mean(HEIGHT_BIAS)
        self._heights = np.maximum(np.concatenate([
            heights, middle + np.array([HEIGHT_STEP, -HEIGHT_STEP, 0.0, 0.0])]), 1e-4)
        self._scores = np.full((len(self._heights), 2), np.nan)
        self._done = 0
        speeds = np.full(len(self._heights), touching.speed)
        speeds[-2:] *= 1.0 + SPEED_STEP, 1.0 - SPEED_STEP
        self._crossings = _crossings(
            particles.robot, touching, speeds, np.vstack([particles.rows, np.tile(mean, (4, 1))]),
            np.vstack([friction, np.tile(particles.weights @ friction, (4, 1))]))

    def advance(self, attempts: Optional[int] = None) -> bool:
        """Run some attempts, all by default; return whether all have been run."""
        number = len(self._scores)
        end = number if attempts is None else min(number, self._done + attempts)
        part = slice(self._done, end)
        self._scores[part] = _scores(
            Crossings(self._crossings.rows[part], self._crossings.grounds[part]),
            self._heights[part])
        self._done = end
        return self._done == number

    def probabilities(self) -> Array:
        """Return the success probability of each particle, (N,); requires all attempts."""
        sigmas = self._scores[:-4, 0] / self._deviation
        over = [0.5 * math.erfc(-value / math.sqrt(2.0)) for value in sigmas.tolist()]
        return np.nan_to_num(np.array(over), nan=0.5)  # for failed attempts

    def likelihood(self, outcome: Outcome) -> Array:
        """Return the likelihood of an outcome under each particle, (N,); requires all attempts."""
        over = self.probabilities()
        if not outcome.crossed:
            return (1.0 - OUTLIER_FRACTION) * (1.0 - over) + 0.5 * OUTLIER_FRACTION
        if outcome.passed_speed is None:
            return (1.0 - OUTLIER_FRACTION) * over + 0.5 * OUTLIER_FRACTION
        # Squares of speeds, like scores; for failed attempts, uniform up to that at the touch.
        scores, speeds = self._scores[:-4].T
        anything = 1.0 / max(self._touching.speed, TOUCH_SPEED_MIN)**2
        # Slip makes odometry faster than the ball; the standard deviation grows with it.
        slip = speeds - np.sqrt(np.maximum(scores, 0.0))
        sd = np.hypot(PASSED_SD, SLIP_FRACTION * slip)
        spread = np.sqrt(self._deviation**2 + (2.0 * speeds * sd)**2 + sd**4)
        density = np.exp(-0.5 * ((outcome.passed_speed**2 - speeds**2) / spread)**2) / (
            spread * math.sqrt(2.0 * math.pi))
        explained = np.where((scores > 0.0) & np.isfinite(density), density, anything)
        likelihood: Array = (
            (1.0 - OUTLIER_FRACTION) * over * explained + OUTLIER_FRACTION * anything)
        return likelihood

    @property
    def _deviation(self) -> float:
        """Return the standard deviation of the scores, for one robot [m2/s2]."""
        higher, lower, faster, slower = np.nan_to_num(self._scores[-4:, 0]).tolist()
        per_height = (lower - higher) / (self._heights[-4] - self._heights[-3])
        per_speed = (faster - slower) / (2.0 * SPEED_STEP * self._touching.speed)
        return max(math.hypot(
            per_height * math.hypot(self._touching.height_sd, MODEL_SD),
            per_speed * SPEED_SD), LEAST)


def _crossings(robot: Robot, touching: Touching, speeds: ArrayLike, rows: Array,
               frictions: Array) -> Crossings:
    """
    Return attempts at speeds [m/s] by robots that differ in parameters and friction.

    Parameters
    ----------
    robot : Robot
        Its motor is that of all robots.
    touching : Touching
    speeds : (n,) array_like
    rows : (n, 17) array
        `Parameters` of each robot.
    frictions : (n, 2) array
        Friction coefficients of surface and edge.

    """
    ground = with_parameters(robot, {SURFACE_FRICTION: frictions[:, 0],
                                     EDGE_FRICTION: frictions[:, 1]})
    crossings = Crossings.of(
        len(rows), ground, speeds, touching.angle,
        held_at(touching.set_angle) if robot.has_pendulum else Actuation(),
        Site(slope_before=touching.slope, slope_behind=touching.slope),
        # Up to the edge: the outcome reports the speed past the face.
        Rules(time_limit=ATTEMPT_TIME_MAX))
    crossings.rows[:, PARAMETERS:ACTUATOR] = rows
    crossings.rows[:, ACTUATOR + Actuator._fields.index('gravity_torque')] = (
        rows[:, Parameters._fields.index('pendulum_moment')]
        * rows[:, Parameters._fields.index('gravity')])
    return crossings


def _scores(crossings: Crossings, heights: Array) -> Array:
    """Return score [m2/s2] and final speed [m/s], (n, 2), at steps; NaN for failed attempts."""
    results = crossings.tried(heights, SOLVER_TOLERANCE, EVALUATIONS_MAX)
    results[results[:, OUTCOME] != FINISHED, SCORE] = np.nan
    return results[:, [SCORE, ROLLED]]


def score_of(robot: Robot, touching: Touching) -> Tuple[float, float]:
    """Return score [m2/s2] and final speed [m/s] of one attempt of a robot."""
    (score, speed), = _scores(_crossings(
        robot, touching, touching.speed, np.array([Parameters.of(robot, ContactOptions())]),
        np.array([[robot.surface_friction, robot.edge_friction]])), np.array([touching.height]))
    return float(score), float(speed)


def probability(particles: Particles, touching: Touching) -> float:
    """Return the probability of crossing a step, as used for learning from the outcome."""
    chances = Chances(particles, touching)
    chances.advance()
    return float(particles.weights @ chances.probabilities())
