# SPDX-License-Identifier: Apache-2.0
"""
Time the search for the maximum step height: one, all curves of Figs 5, 6 and 8, many threads.

MuJoCo, if installed, performs the same search at equal error; see search_race.py.
"""
import math
import os
from statistics import median

import numpy as np
from reference_search import highest_step
from search_race import race, spent

from ballbot_ros.crossing import held_at, max_step_height, max_step_heights, rolling
from ballbot_ros.physics import Actuation, load_robot

SPEEDS = np.linspace(0.2, 1.2, 21)
REPEATS = 15


def curves():
    """Yield robot and actuation of each curve of Figs 5, 6 and 8."""
    gimball = load_robot('gimball')
    yield load_robot('shellball'), Actuation()
    yield gimball, Actuation()
    for angle in (0.0, math.pi / 2, math.pi):
        yield gimball, held_at(angle)
    yield gimball, rolling(gimball)


def measure():
    """Yield name, unit, values and target of each measurement; negative targets are minima."""
    gimball = load_robot('gimball')

    def one():
        return max_step_height(gimball, 0.6)

    def all_curves(threads=None):
        return [item for robot, actuation in curves()
                for item in max_step_heights(robot, SPEEDS, actuation, threads=threads)]
    one()
    all_curves()
    yield 'one height to 0.05 mm, GimBall free, 0.6 m/s', 'ms', [
        1e3 * spent(one) for _ in range(REPEATS)], 0.3
    yield 'the same, reference method', 'ms', [
        1e3 * spent(lambda: highest_step(gimball, 0.6)) for _ in range(REPEATS)], None
    # Interleaved, so that both have the same load of the machine.
    cores = os.cpu_count() or 1
    times = [(spent(lambda: all_curves(1)), spent(all_curves)) for _ in range(REPEATS)]
    yield 'Figs 5, 6, 8: 6 curves of 21 speeds', 's', [many for _, many in times], 1.0
    yield 'the same, one thread', 's', [alone for alone, _ in times], None
    yield f'times quicker with {cores} threads', 'x', [alone / many for alone, many in times], None
    found = all_curves()
    yield 'largest reported error', 'mm', [1e3 * max(item.error for item in found)], 0.05
    yield 'attempts per height', '', [median(item.attempts for item in found)], None
    yield from race(gimball)
