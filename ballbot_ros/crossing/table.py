# SPDX-License-Identifier: Apache-2.0
"""
Crossings as rows of numbers, of which one call of compiled code runs any number.

Preparing one in Python takes as long as running it; as columns, a thousand are as quickly
prepared as one.  What they work in is made once for each thread.
"""
from threading import local
from typing import Any, NamedTuple

import numpy as np

from ballbot_ros.config.columns import table
from ballbot_ros.crossing.attempt import attempt, Course, Crossing, OVER, VERTICES
from ballbot_ros.crossing.rules import Rules, Site
from ballbot_ros.crossing.search import find
from ballbot_ros.jit import compiled, direct, row_reader, unlocked
from ballbot_ros.physics.mechanics.contact import IntArray
from ballbot_ros.physics.model.actuation import Actuation
from ballbot_ros.physics.model.contact_options import ContactOptions
from ballbot_ros.physics.model.parameters import Parameters, read_actuator, read_parameters, System
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.state import SIZE
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.solvers.values import Output, Packed, unpacked, Workspace

TOLERANCE = 1e-7  # of a step that is tried [m]
NEVER = 2**62  # rows of output that would interrupt a run
BUDGET = 50_000_000  # right-hand sides of one attempt; they take seconds

# Columns of the results of steps that were tried ...
PASSES, SCORE, TRIED = range(3)  # whether, by how much [m2/s2], outcome
# ... and of highest steps; see `search.find`.
LOW, HIGH, ERROR, FINE, FOUND = range(5)

# Arrays of `Crossing`: state, before, last, spent, rows of the output, workspace.
PackedDesk = tuple[Array, Array, Array, IntArray, Array, Packed]


read_course = row_reader(Course)
# Where the fields of each begin in a row.
PARAMETERS = len(Course._fields)
ACTUATOR = PARAMETERS + len(Parameters._fields)


@compiled
def crossing_of(row: Array, ground: Array, desk: PackedDesk) -> Crossing:
    """Return the crossing of a row, on its ground (4, 7), with the arrays of a desk."""
    state, before, last, spent, rows, workspace = desk
    return Crossing(
        read_course(row, 0),
        System(read_parameters(row, PARAMETERS), ground, read_actuator(row, ACTUATOR)),
        BUDGET, state, before, Output(rows, 0.0, 1.0, NEVER), unpacked(workspace), spent, last)


@unlocked
def try_rows(rows: Array, grounds: Array, heights: Array, tolerance: float, results: Array,
             desk: PackedDesk) -> None:
    """
    Try a step with each crossing.

    Parameters
    ----------
    rows : array
        Fields of Course, Parameters and Actuator, one behind the other.
    grounds : (n, 4, 7) array
        Written: the heights.
    heights : (n,) array
        [m]
    tolerance : float
        See `attempt`.
    results : (n, 3) array
        Written.
    desk : PackedDesk

    """
    for i in range(len(rows)):
        verdict, score, outcome = attempt(
            heights[i], tolerance, crossing_of(rows[i], grounds[i], desk))
        results[i, PASSES] = 1.0 if verdict == OVER else 0.0
        results[i, SCORE] = score
        results[i, TRIED] = outcome


@unlocked
def find_rows(rows: Array, grounds: Array, accuracy: float, results: Array,
              desk: PackedDesk) -> None:
    """
    Find the highest step of each crossing to an accuracy [m].

    Parameters
    ----------
    results : (n, 5) array
        Written.
    rows, grounds, desk
        See `try_rows`.

    """
    for i in range(len(rows)):
        crossing = crossing_of(rows[i], grounds[i], desk)
        crossing.spent[:] = 0
        low, high, error, tolerance, outcome = find(accuracy, crossing)
        results[i, LOW], results[i, HIGH], results[i, ERROR] = low, high, error
        results[i, FINE], results[i, FOUND] = tolerance, outcome


class Desk(local):
    """What a thread works with; what the last attempt left there explains how it ended."""

    def __init__(self) -> None:
        """Make the arrays of a thread."""
        self.state, self.last = np.zeros(SIZE), np.zeros(2)
        self.spent = np.zeros(2, dtype=np.int64)
        self.packed: PackedDesk = (
            self.state, np.zeros(SIZE), self.last, self.spent, np.zeros((0, 2 + SIZE)),
            Workspace.of(VERTICES).plain)


DESK = Desk()


class Crossings(NamedTuple):
    """Any number of crossings, in the way that the kernels read them."""

    rows: Array  # (n, ...), see `try_rows`
    grounds: Array  # (n, 4, 7)

    @classmethod
    def of(cls, number: int, robot: Robot, speed: Any, pendulum_angle: Any, actuation: Actuation,
           site: Site, rules: Rules, options: ContactOptions = ContactOptions()) -> 'Crossings':
        """
        Return a table of `number` crossings.

        Parameters
        ----------
        number : int
        robot, actuation, site, rules
            Already checked, also for consistency; their values may be columns.
        speed, pendulum_angle : float or column
            [m/s], [rad]
        options : ContactOptions

        """
        numbers = (*rules.course(speed, pendulum_angle), *Parameters.of(robot, options),
                   *actuation.actuators(robot, 0.0, pendulum_angle))
        return cls(table(numbers, number), site.grounds(robot, number))

    def tried(self, heights: Array, tolerance: float) -> Array:
        """Return what became of a step of some height [m] each; see `try_rows`."""
        results = np.empty((len(self.rows), 3))
        direct(try_rows)(*self, heights, tolerance, results, DESK.packed)
        return results

    def found(self, accuracy: float) -> Array:
        """Return the highest steps to an accuracy [m]; see `find_rows`."""
        results = np.empty((len(self.rows), 5))
        direct(find_rows)(*self, accuracy, results, DESK.packed)
        return results
