# SPDX-License-Identifier: Apache-2.0
"""
Learning by robots that differ from the assumptions: predictions before and after attempts.

Virtual robots are drawn from the ranges of a robot file; some have less friction, or a sensor
with a bias.  Each approaches steps up to 10 mm below the maximum step height of the nominal
robot, attempts those with a sufficient predicted probability, and learns.  Then the predictions
for other such steps, with and without learning, are compared with the observed success rates.
"""
from dataclasses import dataclass, replace
from typing import List, Sequence, Tuple

import numpy as np

from ballbot_ros.decision.learning.chances import (
    probability, score_of, SPEED_SD, Touching)
from ballbot_ros.decision.learning.learner import Learner
from ballbot_ros.decision.learning.outcomes import Outcome, Result
from ballbot_ros.decision.learning.particles import Particles
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.model.uncertainty import draw
from ballbot_ros.studies.progress import ignore, Progress

# Deviation of the true robot: factor of both frictions, and bias of the sensor [m].
CASES = {
    'as assumed': (1.0, 0.0),
    'friction 30 % lower': (0.7, 0.0),
    'heights reported 4 mm too low': (1.0, -0.004),
    'heights reported 4 mm too high': (1.0, 0.004),
}
# Steps are at most this much lower than the maximum step height of the nominal robot [m].
HEIGHT_WINDOW = 0.010
SPEEDS, HEIGHTS = (0.45, 1.15), (0.005, 0.065)  # [m/s], [m]
ANGLES = (0.7, 1.5, 2.2)  # held pendulum angles [rad]
HEIGHT_SD = 0.001  # of the measured height, without the bias [m]
ODOMETRY_SD = 0.02  # of the measured speed past the face [m/s]
ROBOT_SEED_OFFSET = 10_000  # seed offset that keeps the robots distinct from the particles
TESTS, REPEATS = 24, 5  # steps, and attempts at each, for the comparison with predictions


@dataclass(frozen=True)
class SuccessRates:
    """Predicted and observed success rates."""

    case: str  # one of `CASES`
    observed: Array  # (n,): fraction of the attempts that crossed, for each step
    before: Array  # (n,): predicted probability
    after: Array


def demanding(robot: Robot, random: np.random.Generator) -> Touching:
    """Draw a step slightly below the maximum step height of a robot."""
    while True:
        angle = float(random.choice(ANGLES))
        touching = Touching(float(random.uniform(*HEIGHTS)), HEIGHT_SD,
                            float(random.uniform(*SPEEDS)), 0.6 * angle, angle)
        higher = touching._replace(height=touching.height + HEIGHT_WINDOW)
        if score_of(robot, touching)[0] > 0.0 >= score_of(robot, higher)[0]:
            return touching


def attempted(robot: Robot, bias: float, touching: Touching,
              random: np.random.Generator) -> Tuple[bool, float]:
    """Return whether a robot with a sensor bias [m] crosses, and its speed past the face [m/s]."""
    noise = random.standard_normal(3)
    height = touching.height - bias + touching.height_sd * noise[0]
    score, passed = score_of(robot, touching._replace(
        height=max(height, 1e-3), speed=touching.speed + SPEED_SD * noise[1]))
    return score > 0.0, max(0.0, passed + ODOMETRY_SD * noise[2])


def study(robot: Robot, robots: int, attempts: int, seed: int = 0,
          cases: Sequence[str] = tuple(CASES), particles: int = 256,
          progress: Progress = ignore) -> List[SuccessRates]:
    """
    Simulate learning with a number of virtual robots, drawn from a robot, for each case.

    Each robot makes `attempts` attempts; `progress` receives the number of finished robots.
    """
    tuning = DecisionTuning()
    found: List[SuccessRates] = []
    for case in cases:
        factor, bias = CASES[case]
        rows: List[Tuple[float, float, float]] = []
        for number, drawn in enumerate(draw(robot, robots, ROBOT_SEED_OFFSET + seed)):
            random = np.random.default_rng([seed, number])
            true = replace(drawn, surface_friction=factor * drawn.surface_friction,
                           edge_friction=factor * drawn.edge_friction)
            prior = Particles.of(robot, tuning.height_bias_sd, particles, number)
            learner, tried = Learner(prior), 0
            while tried < attempts:
                step = demanding(robot, random)
                if probability(learner.particles, step) < tuning.required_probability:
                    continue
                over, passed = attempted(true, bias, step, random)
                learner.take(Outcome(
                    stamp=0.0, result=(Result.OVER if over else Result.STUCK).value, face=1,
                    position=0.0, height=step.height, height_sd=step.height_sd,
                    touch_speed=step.speed, touch_angle=step.angle, held_angle=step.set_angle,
                    passed_speed=passed if over else None))
                learner.advance()
                tried += 1
            for step in (demanding(robot, random) for _ in range(TESTS)):
                observed = np.mean([attempted(true, bias, step, random)[0]
                                    for _ in range(REPEATS)])
                rows.append((float(observed), probability(prior, step),
                             probability(learner.particles, step)))
            progress(len(found) * robots + number + 1)
        found.append(SuccessRates(case, *np.array(rows).T))
    return found


def report_lines(found: Sequence[SuccessRates], attempts: int) -> List[str]:
    """Return lines of a table: of all steps, and of those with a sufficient prediction."""
    required = DecisionTuning().required_probability
    each = f'{"predicted":>9} {"observed":>8}'
    lines = [f'{"":30} {"all steps":^36}   predicted {required:g} or more',
             f'{"":30} {"at first":^18} {f"after {attempts}":^18}   {"at first":^24} '
             f'{f"after {attempts}":^24}',
             f'{"robot and sensor":30} {each} {each}  {each} {"steps":>5} {each} {"steps":>5}']
    for item in found:
        cells = [f'{predicted.mean():9.3f} {item.observed.mean():8.3f}'
                 for predicted in (item.before, item.after)]
        for predicted in (item.before, item.after):
            some = predicted >= required
            cells.append(
                (f'{predicted[some].mean():9.3f} {item.observed[some].mean():8.3f}' if some.any()
                 else f'{"-":>9} {"-":>8}') + f' {np.count_nonzero(some):5d}')
        lines.append(f'{item.case:30} {cells[0]} {cells[1]}  {cells[2]} {cells[3]}')
    return lines
