# SPDX-License-Identifier: Apache-2.0
"""
Robots that may all be the one at hand: numbers drawn from the ranges that are given for them.

Numbers are drawn evenly and independently, but for one thing: where the masses of ball and
pendulum are both uncertain, their sum stays, for it is what a balance measures (and the paper
prints) while the split is not.
"""
from typing import Dict, List, Mapping, Tuple, TypeVar

import numpy as np
from scipy.stats import qmc

from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.studies.parameters import with_parameters

MASSES = ('pendulum_mass', 'ball_mass')
Ends = TypeVar('Ends')


def ranges(robot: Robot) -> Dict[str, Tuple[float, float]]:
    """Return the low and high ends of the numbers that have a range, by field name, SI."""
    return {name: (item.low, item.high) for name, item in robot.provenance.items()
            if item.low is not None and item.high is not None}


def uncertain(robot: Robot) -> Dict[str, Tuple[float, float]]:
    """Return the `ranges` of derived numbers, see `Provenance`, but those of the motor."""
    return {name: (low, high) for name, (low, high) in ranges(robot).items()
            if robot.provenance[name].source == 'derived' and '.' not in name and low < high}


def independent(found: Mapping[str, Ends]) -> Dict[str, Ends]:
    """Return uncertain numbers without the ball mass, where the pendulum mass stands for both."""
    return {name: ends for name, ends in found.items()
            if name != 'ball_mass' or 'pendulum_mass' not in found}


def changed(robot: Robot, values: Mapping[str, float]) -> Robot:
    """
    Return a robot with other parameters, see `with_parameters`.

    Where both masses are uncertain and one is changed, the other takes up the difference.
    """
    change = dict(values)
    given = [name for name in MASSES if name in values]
    if len(given) == 1 and set(MASSES) <= set(ranges(robot)):
        other, = set(MASSES) - set(given)
        change[other] = robot.total_mass - values[given[0]]
    return with_parameters(robot, change)


def draw(robot: Robot, count: int, seed: int = 0) -> List[Robot]:
    """
    Draw robots from the ranges of the uncertain numbers; Sobol's sequence, scrambled.

    Raises
    ------
    ConfigurationError
        If numbers of the ranges contradict each other.

    """
    free = independent(uncertain(robot))
    if not free:
        return [robot] * count
    # A power of two keeps the sequence balanced; more than asked for are thrown away.
    power = max(0, int(np.ceil(np.log2(count))))
    points = qmc.Sobol(len(free), seed=seed).random_base2(power)[:count]
    low, high = np.array(list(free.values())).T
    return [changed(robot, dict(zip(free, values)))
            for values in (low + points * (high - low)).tolist()]
