# SPDX-License-Identifier: Apache-2.0
"""Deviation of simpler models from the full one over speed, and the cost of each."""
from itertools import count
from statistics import median
from time import perf_counter
from typing import Callable, NamedTuple

import numpy as np

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.paper import rigid_impact
from ballbot_ros.paper.cases import Case, step_height
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.studies import comparators
from ballbot_ros.studies.progress import ignore

DEVIATION_LEVELS = (1e-3, 3e-3, 1e-2)  # requested deviations of the height [m]


class Comparator(NamedTuple):
    """A simpler model of the maximum step height."""

    name: str
    source: str
    height: Callable[[Case, float], float]  # case and speed [m/s] -> [m]
    applies: Callable[[Case], bool] = lambda case: True


COMPARATORS = (
    Comparator('quasi-static', 'eq. (1), Halme', lambda case, _: comparators.quasi_static(
        case.robot), lambda case: case.robot.has_pendulum),
    Comparator('energy', 'Kolacinski, Quinn', lambda case, speed: comparators.energy(
        case.robot, speed), lambda case: not case.held),
    Comparator('energy, held pendulum', 'derived', lambda case, speed:
               comparators.energy_with_held_pendulum(case.robot, speed, case.pendulum_angle),
               lambda case: case.held),
    Comparator('plastic impulse', 'textbook', lambda case, speed: comparators.plastic_impulse(
        case.robot, speed)),
    Comparator('plastic impulse, held pendulum', 'derived', lambda case, speed:
               comparators.plastic_impulse_with_held_pendulum(
                   case.robot, speed, case.pendulum_angle), lambda case: case.held),
    Comparator('impulse, free pendulum', 'derived', lambda case, speed:
               comparators.free_pendulum_impulse(case.robot, speed, case.pendulum_angle),
               lambda case: case.swings),
    Comparator('impacts and flight', 'Kane, Levinson; Hartl', lambda case, speed:
               rigid_impact.impact_with_restitution(case.robot, speed)),
)


class Curve(NamedTuple):
    """Heights of one model."""

    name: str
    source: str
    heights: Array  # (n,) [m]
    cost: float  # median wall time of one height [s]


class Comparison(NamedTuple):
    """The full model and all simpler models that apply, at the same speeds [m/s]."""

    speeds: Array
    full: Curve
    others: tuple[Curve, ...]


def compare(case: Case, speeds: Array,
            progress: Callable[[int], None] = ignore) -> Comparison:
    """
    Compute the maximum step height by every model that applies, at collision speeds [m/s].

    The progress is the number of completed heights.  Raises `ConfigurationError` for an actuation
    other than a free pendulum or one held by law (11): the simpler models do not cover others.
    """
    if case.actuation.law not in ('free', 'position'):
        raise ConfigurationError(
            'the simpler models require a pendulum that is free or held by law (11), not one '
            f'under the law {case.actuation.law!r}', 'not_a_choice', 'law')
    done = count(1)

    def curve(name: str, source: str, height: Callable[[Case, float], float]) -> Curve:
        heights, times = [], []
        height(case, float(speeds[0]))  # excludes compilation and loading
        for speed in speeds.tolist():
            begin = perf_counter()
            heights.append(height(case, speed))
            times.append(perf_counter() - begin)
            progress(next(done))
        return Curve(name, source, np.array(heights), median(times))

    full = curve('full model', 'eqs. (4) to (13)', step_height)
    return Comparison(speeds, full, tuple(
        curve(item.name, item.source, item.height)
        for item in COMPARATORS if item.applies(case)))


def count_heights(case: Case, speeds: int) -> int:
    """Return the number of heights that `compare` computes."""
    return speeds * (1 + sum(item.applies(case) for item in COMPARATORS))


def spans(speeds: Array, inside: Array) -> list[tuple[float, float]]:
    """
    Return the ranges of consecutive speeds for which `inside` is true.

    >>> spans(np.array([0.2, 0.4, 0.6, 0.8]), np.array([True, True, False, True]))
    [(0.2, 0.4), (0.8, 0.8)]
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(int), [0]])))
    return [(float(speeds[begin]), float(speeds[end - 1]))
            for begin, end in zip(edges[::2], edges[1::2])]
