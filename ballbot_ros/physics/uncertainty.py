# SPDX-License-Identifier: Apache-2.0
"""
Robots that may all be the one at hand: numbers drawn from the ranges that are given for them.

Numbers are drawn evenly and independently, but for one thing: where the masses of ball and
pendulum are both uncertain, their sum stays, for it is what a balance tells (and the paper
prints) while the split is not.
"""
from dataclasses import replace
from typing import Dict, List, Sequence, Tuple

import numpy as np
from scipy.stats import qmc

from ballbot_ros.physics.robot import Robot


def uncertain(robot: Robot, sources: Sequence[str] = ('derived',)) -> Dict[
        str, Tuple[float, float]]:
    """
    Return the ranges of the numbers of a robot that come from some sources.

    Parameters
    ----------
    robot : Robot
    sources : sequence of str
        See `Provenance`; numbers of the motor are left out.

    Returns
    -------
    dict of str to (low, high)
        By field name, SI.

    """
    return {name: (item.low, item.high) for name, item in robot.provenance.items()
            if item.source in sources and '.' not in name
            and item.low is not None and item.high is not None and item.low < item.high}


def draw(robot: Robot, count: int, seed: int = 0,
         sources: Sequence[str] = ('derived',)) -> List[Robot]:
    """
    Draw robots from the ranges of the uncertain numbers; Sobol's sequence, scrambled.

    Raises
    ------
    ConfigurationError
        If numbers of the ranges contradict each other.

    """
    ranges = uncertain(robot, sources)
    both = {'ball_mass', 'pendulum_mass'} <= set(ranges)
    names = [name for name in ranges if not (both and name == 'ball_mass')]
    if not names:
        return [robot] * count
    # A power of two keeps the sequence balanced; more than asked for are thrown away.
    power = max(0, int(np.ceil(np.log2(count))))
    points = qmc.Sobol(len(names), seed=seed).random_base2(power)[:count]
    low, high = np.array([ranges[name] for name in names]).T
    robots = []
    for values in (low + points * (high - low)).tolist():
        change = dict(zip(names, values))
        if both:
            change['ball_mass'] = robot.total_mass - change['pendulum_mass']
        robots.append(replace(robot, **change))
    return robots
