# SPDX-License-Identifier: Apache-2.0
"""
What the highest step depends on: uncertain numbers, the design, the ground behind the step.

Every study tells its progress as the part that is done, 0 to 1.
"""
from dataclasses import fields, replace
from typing import Callable, NamedTuple, Optional

import numpy as np

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.model.robot import Motor, Robot
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.studies.cases import Case, step_height, step_heights
from ballbot_ros.studies.uncertainty import changed, draw, independent, ranges

COARSE = 1e-4  # accuracy of heights that only shade a map [m]
WHAT_IF = 0.1  # part by which numbers without a range are changed

Progress = Optional[Callable[[float], None]]

# Numbers that a what-if leaves alone: gravity is known, and the slip threshold is a means.
KNOWN = ('gravity', 'slip_threshold')


class Bar(NamedTuple):
    """What one number of a robot does to the highest step."""

    name: str
    unit: str
    low: float  # ends of the range
    high: float
    height_low: float  # highest step there [m]
    height_high: float
    uncertain: bool  # has a range in the robot's file; False for a what-if


def vary(robot: Robot, name: str, value: float) -> Robot:
    """
    Return a robot with another number.

    Parameters
    ----------
    robot : Robot
    name : str
        Of a field, see `uncertainty.changed`, or ``'motor.'`` and a field of the motor.
    value : float

    """
    if not name.startswith('motor.'):
        return changed(robot, {name: value})
    if robot.motor is None:
        raise ConfigurationError(f'robot {robot.name!r} has no motor to change {name} of')
    return replace(robot, motor=replace(robot.motor, **{name[len('motor.'):]: value}))


def sensitivity(case: Case, speed: float, progress: Progress = None) -> list[Bar]:
    """
    Return what each number does, from the largest effect to the smallest.

    Uncertain numbers go to the ends of their ranges, all others that are not 0 up and down by
    a tenth.  The motor counts only where the law of actuation is a voltage.
    """
    robot = case.robot
    found = ranges(robot)
    known = {name: span for name, span in independent(found).items()
             if case.actuation.law == 'voltage' or not name.startswith('motor.')}
    what_if = [item.name for item in fields(robot) if item.metadata.get('kind') is float
               and item.name not in (*found, *KNOWN)
               and getattr(robot, item.name) > 0.0]
    spans = [(name, low, high, True) for name, (low, high) in known.items()]
    spans += [(name, (1.0 - WHAT_IF) * getattr(robot, name), (1.0 + WHAT_IF)
               * getattr(robot, name), False) for name in what_if]
    bars = []
    for number, (name, low, high, uncertain) in enumerate(spans):
        heights = [step_height(case._replace(robot=vary(robot, name, value)), speed)
                   for value in (low, high)]
        bars.append(Bar(name, _unit(name), low, high, heights[0], heights[1], uncertain))
        _tell(progress, (number + 1) / len(spans))
    return sorted(bars, key=lambda bar: -abs(bar.height_high - bar.height_low))


def _unit(name: str) -> str:
    """Return the unit of a number, nothing for a pure one."""
    owner = Motor if name.startswith('motor.') else Robot
    unit = owner.__dataclass_fields__[name.split('.')[-1]].metadata['unit']
    return '' if unit == '1' else str(unit)


def sampled_heights(case: Case, speeds: Array, samples: int, seed: int = 0,
                    progress: Progress = None) -> Array:
    """
    Return the highest step at each speed of robots drawn from the ranges, a row each [m].

    See `uncertainty.draw`.
    """
    rows = []
    for number, robot in enumerate(draw(case.robot, samples, seed)):
        rows.append(step_heights(case._replace(robot=robot), speeds))
        _tell(progress, (number + 1) / samples)
    return np.array(rows)


def design_map(case: Case, speed: float, lengths: Array, masses: Array,
               progress: Progress = None) -> Array:
    """
    Return the highest step for other pendulums in the same ball, a row for each mass [m].

    Parameters
    ----------
    case : Case
        With a pendulum.
    speed : float
        Collision speed [m/s].
    lengths, masses : array
        Of the pendulum [m], [kg].

    """
    found = np.empty((len(masses), len(lengths)))
    for row, mass in enumerate(masses.tolist()):
        for column, length in enumerate(lengths.tolist()):
            robot = replace(case.robot, pendulum_mass=mass, pendulum_length=length)
            found[row, column] = step_height(case._replace(robot=robot), speed, COARSE)
        _tell(progress, (row + 1) / len(masses))
    return found


def heights_on_slopes(case: Case, speeds: Array, slopes: Array, progress: Progress = None
                      ) -> Array:
    """
    Return the highest step where the ground behind it slopes, a row for each slope [m].

    Parameters
    ----------
    case : Case
    speeds : array
        Collision speeds [m/s].
    slopes : array
        Of the ground behind the step, positive uphill [rad].

    """
    rows = []
    for number, slope in enumerate(slopes.tolist()):
        site = replace(case.site, slope_behind=slope)
        rows.append(step_heights(case._replace(site=site), speeds))
        _tell(progress, (number + 1) / len(slopes))
    return np.array(rows)


def _tell(progress: Progress, part: float) -> None:
    """Tell the progress, if someone wants to know."""
    if progress is not None:
        progress(part)
