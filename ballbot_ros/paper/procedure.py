# SPDX-License-Identifier: Apache-2.0
"""
The procedure of the paper's tests: for each step, the highest speed that does not pass.

"Rolling tests for the given step height are repeated until the maximum no-pass velocity has been
found.  Then the step height is increased 5 mm and the procedure repeats."  As experimenters do:
raise the setting by a large factor until the ball passes, then lower it by a small factor after
each pass and raise it after each no-pass, for a number of rolls.
"""
import math
from typing import Iterable, Iterator, NamedTuple, Sequence

import numpy as np

from ballbot_ros.paper.test_bench import Bench, Roll
from ballbot_ros.physics.model.robot import Robot

HEIGHTS = tuple(0.005 * number for number in range(1, 12))  # 5 to 55 mm [m]
FINE_ROLLS = 12
ATTEMPTS_MAX = 3  # at the highest setting, after which the test ends


class Threshold(NamedTuple):
    """Result of the rolls at one step: measured speeds, NaN without such a roll."""

    step_height: float  # [m]
    rolls: int
    highest_no_pass: float  # [m/s]
    lowest_pass: float  # [m/s]


def run_tests(bench: Bench, robot: Robot, heights: Sequence[float] = HEIGHTS, seed: int = 0,
              fine_rolls: int = FINE_ROLLS) -> Iterator[Roll]:
    """
    Yield the rolls of a test at steps of increasing heights [m], in chronological order.

    The same seed of the scatter gives the same rolls; `fine_rolls` is the number of rolls about
    the threshold of each step.  Raises `ConfigurationError` if the robot cannot be driven on this
    bench.
    """
    setting = bench.lowest
    for number, height in enumerate(heights):
        # One generator per step: an additional roll at one step does not change those at others.
        chance = np.random.default_rng([seed, number])
        at_top = 0
        while True:
            roll = bench.roll(robot, height, setting, chance)
            yield roll
            if roll.passed:
                break
            at_top += setting == bench.highest
            if at_top == ATTEMPTS_MAX:
                return
            setting = min(setting * bench.coarse, bench.highest)
        for _ in range(fine_rolls):
            setting *= 1.0 / bench.fine if roll.passed else bench.fine
            setting = min(max(setting, bench.lowest), bench.highest)
            roll = bench.roll(robot, height, setting, chance)
            yield roll


def true_thresholds(rolls: Iterable[Roll]) -> list[Threshold]:
    """Return `find_thresholds` by the speeds at the touch, which the sensors do not measure."""
    return find_thresholds(roll._replace(measured_speed=roll.touch_speed) for roll in rolls)


def find_thresholds(rolls: Iterable[Roll]) -> list[Threshold]:
    """Return the result for each step, by increasing height."""
    by_height: dict[float, list[Roll]] = {}
    for roll in rolls:
        by_height.setdefault(roll.step_height, []).append(roll)
    found = []
    for height, group in sorted(by_height.items()):
        # A roll that did not reach the sensors has no measured speed.
        failed, passed = ([roll.measured_speed for roll in group if roll.passed == wanted
                           and math.isfinite(roll.measured_speed)] for wanted in (False, True))
        found.append(Threshold(height, len(group), max(failed, default=math.nan),
                               min(passed, default=math.nan)))
    return found
