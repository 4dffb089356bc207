# SPDX-License-Identifier: Apache-2.0
"""
Robots that may all be the one at hand: numbers drawn from the ranges that are given for them.

Numbers are drawn evenly and independently, but for one thing: where the masses of ball and
pendulum are both uncertain, their sum stays, for it is what a balance measures (and the paper
prints) while the split is not.
"""
from types import SimpleNamespace
from typing import cast, Dict, List, Mapping, Tuple, TypeVar

import numpy as np

from ballbot_ros.physics.model.contact_options import ContactOptions
from ballbot_ros.physics.model.named_parameters import ROBOT, with_parameters
from ballbot_ros.physics.model.parameters import Parameters
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.sobol import sobol
from ballbot_ros.physics.model.terrain import Array

MASSES = ('pendulum_mass', 'ball_mass')
Ends = TypeVar('Ends')
Number = TypeVar('Number', float, Array)


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
    return with_parameters(robot, _with_both_masses(robot, values))


def _with_both_masses(robot: Robot, values: Mapping[str, Number]) -> Dict[str, Number]:
    change = dict(values)
    given = [name for name in MASSES if name in values]
    if len(given) == 1 and set(MASSES) <= set(ranges(robot)):
        other, = set(MASSES) - set(given)
        change[other] = robot.total_mass - values[given[0]]
    return change


def rows_of_parameters(robot: Robot, values: Mapping[str, Array], number: int,
                       options: ContactOptions = ContactOptions()) -> Array:
    """
    Return the `Parameters` of many robots, (number, 15): those of `changed`, but unchecked.

    Parameters
    ----------
    values : mapping of str to (number,) array
        Fields of the robot, SI.

    """
    own = {name: getattr(robot, name) for name in ROBOT}
    own.update(_with_both_masses(robot, values))
    own['total_mass'] = own['ball_mass'] + own['pendulum_mass']
    # The sums and products are the same for arrays; a Robot of each takes a hundred times as long.
    columns = Parameters.of(cast(Robot, SimpleNamespace(**own)), options)
    return np.column_stack([np.broadcast_to(column, number) for column in columns])


def spread_points(dimensions: int, count: int, seed: int) -> Array:
    """Return (count, dimensions) points, evenly in the unit cube; Sobol's sequence, scrambled."""
    # A power of two keeps the sequence balanced; more than asked for are thrown away.
    power = max(0, int(np.ceil(np.log2(count))))
    return sobol(dimensions, power, seed)[:count]


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
    low, high = np.array(list(free.values())).T
    values = low + spread_points(len(free), count, seed) * (high - low)
    return [changed(robot, dict(zip(free, row))) for row in values.tolist()]
