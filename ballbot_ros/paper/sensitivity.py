# SPDX-License-Identifier: Apache-2.0
"""Sensitivity of the maximum step height: uncertain numbers, design, ground behind the step."""
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ballbot_ros.paper.cases import Case, step_height, step_heights
from ballbot_ros.physics.model.robot import MOTOR, ROBOT
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.model.uncertainty import changed, draw, independent, ranges
from ballbot_ros.studies.progress import ignore, Progress, tracked

COARSE = 1e-4  # accuracy of heights that only shade a map [m]
WHAT_IF = 0.1  # part by which numbers without a range are changed

# Numbers that a what-if leaves alone: gravity is known, and the slip threshold is a means.
KNOWN = ('gravity', 'slip_threshold')


class Bar(NamedTuple):
    """Effect of one parameter of a robot on the maximum step height."""

    name: str
    unit: str
    low: float  # ends of the range
    high: float
    height_low: float  # highest step there [m]
    height_high: float
    uncertain: bool  # has a range in the robot's file; False for a what-if


def sensitivity(case: Case, speed: float, progress: Progress = ignore) -> list[Bar]:
    """
    Return the effect of each parameter, from the largest to the smallest.

    Uncertain numbers go to the ends of their ranges, all others that are not 0 up and down by
    a tenth.  The motor counts only where the law of actuation is a voltage, and the lateral axis
    never: the step is met in the plane of the pendulum.
    """
    robot = case.robot
    found = ranges(robot)
    known = {name: span for name, span in independent(found).items()
             if not name.startswith('steering.')
             and (case.actuation.law == 'voltage' or not name.startswith('motor.'))}
    what_if = [name for name in ROBOT
               if name not in (*found, *KNOWN) and getattr(robot, name) > 0.0]
    spans = [(name, low, high, True) for name, (low, high) in known.items()]
    spans += [(name, (1.0 - WHAT_IF) * getattr(robot, name), (1.0 + WHAT_IF)
               * getattr(robot, name), False) for name in what_if]
    bars = []
    for name, low, high, uncertain in tracked(spans, progress):
        at_low, at_high = (step_height(case._replace(robot=changed(robot, {name: value})), speed)
                           for value in (low, high))
        unit = {**ROBOT, **MOTOR}[name]['unit']
        bars.append(Bar(name, '' if unit == '1' else unit, low, high, at_low, at_high, uncertain))
    return sorted(bars, key=lambda bar: -abs(bar.height_high - bar.height_low))


def sampled_heights(case: Case, speeds: Array, samples: int, seed: int = 0,
                    progress: Progress = ignore) -> Array:
    """
    Return the highest step at each speed of robots drawn from the ranges, a row each [m].

    See `uncertainty.draw`.
    """
    return np.array([step_heights(case._replace(robot=robot), speeds)
                     for robot in tracked(draw(case.robot, samples, seed), progress)])


def design_map(case: Case, speed: float, lengths: Array, masses: Array,
               progress: Progress = ignore) -> Array:
    """
    Return the highest step for other pendulums in the same ball, a row for each mass [m].

    At one collision speed [m/s]; `lengths` [m] and `masses` [kg] are those of the pendulum.
    """
    def height(mass: float, length: float) -> float:
        robot = replace(case.robot, pendulum_mass=mass, pendulum_length=length)
        return step_height(case._replace(robot=robot), speed, COARSE)
    return np.array([[height(mass, length) for length in lengths.tolist()]
                     for mass in tracked(masses.tolist(), progress)])


def heights_on_slopes(case: Case, speeds: Array, slopes: Array, progress: Progress = ignore
                      ) -> Array:
    """
    Return the highest step where the ground behind it slopes, a row for each slope [m].

    At some collision speeds [m/s]; slopes [rad] are positive uphill.
    """
    return np.array([
        step_heights(case._replace(site=replace(case.site, slope_behind=slope)), speeds)
        for slope in tracked(slopes.tolist(), progress)])
