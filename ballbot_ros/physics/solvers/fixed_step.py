# SPDX-License-Identifier: Apache-2.0
"""Common parts of fixed-step solvers: number of steps, and end conditions of a run."""
import math

from ballbot_ros.jit import compiled
from ballbot_ros.physics.mechanics.contact import ground_height
from ballbot_ros.physics.mechanics.equations import is_finite
from ballbot_ros.physics.model.parameters import System
from ballbot_ros.physics.model.state import X, Y
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.solvers.dense import write_row
from ballbot_ros.physics.solvers.values import (
    EVALUATIONS, FINISHED, NOT_FINITE, Options, Output, Packed, packed, PENETRATED, Status,
    STEPS, Workspace)


@compiled
def stretches(status: Status, end: float, options: Options,
              output: Output) -> tuple[float, int, int]:
    """
    Return the start time of a run, its number of intervals, and the steps of each.

    A row of the output ends each interval; without output there is one interval.
    """
    if len(output.rows) == 0:
        return status.time, 1, int(math.floor((end - status.time) / options.step + 0.5))
    every = int(math.floor(output.interval / options.step + 0.5))
    steps = int(math.floor((end - output.begin) / options.step + 0.5))
    return output.begin, steps // every, every


@compiled
def moved(status: Status, outcome: int, time: float, filled: int) -> Packed:
    """Return the status of a run that has come to another time."""
    return packed(Status(outcome, time, filled, status.controller, status.rate, status.has_mode,
                         status.ready, status.may_fly, status.before))


@compiled
def outcome_of(state: Array, system: System) -> int:
    """Return whether a run can go on from a state, FINISHED if so."""
    if not is_finite(state):
        return NOT_FINITE
    return PENETRATED if state[Y] <= ground_height(system.ground, state[X]) else FINISHED


@compiled
def end_stretch(time: float, state: Array, steps: int, evaluations: int, system: System,
                output: Output, filled: int, workspace: Workspace) -> int:
    """Count the steps of a stretch, write its row, and return how many rows are filled."""
    workspace.statistics[STEPS] += steps
    workspace.statistics[EVALUATIONS] += steps * evaluations
    if filled < len(output.rows):
        write_row(output, filled, time, state, system.actuator)
        return filled + 1
    return filled
