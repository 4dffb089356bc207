# SPDX-License-Identifier: Apache-2.0
"""
The loop of the fixed-step methods: number of steps, end conditions of a run, output.

A method supplies its step, see `loop_of`.
"""
import math
from typing import Callable

from ballbot_ros.jit import compiled, outlined, with_globals
from ballbot_ros.physics.mechanics.equations import System
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.solvers.dense import write_row
from ballbot_ros.physics.solvers.values import (
    EVALUATIONS, FINISHED, outcome_of, Packed, packed, PAUSED, Status, STEPS, unpack_call,
    Workspace)

# ``step(time, state, size, system, workspace)`` advances a state in place.
Step = Callable[[float, Array, float, System, Workspace], None]


@compiled
def moved(status: Status, outcome: int, time: float, filled: int) -> Packed:
    """Return the status of a run that has reached another time."""
    return packed(Status(outcome, time, filled, status.controller, status.rate, status.has_mode,
                         status.ready, status.may_fly, status.before))


def loop_of(step: Step, evaluations: int) -> Callable[[Packed], Packed]:
    """
    Return the `advance` of a fixed-step method; see the contract in `solvers`.

    Parameters
    ----------
    step : kernel
        See `Step`.
    evaluations : int
        Right-hand sides per step.

    """
    return outlined(with_globals(_advance, step, step=step, evaluations=evaluations))


def _advance(call: Packed) -> Packed:
    """Advance a state in place by the `step` of a method."""
    status, end, state, system, options, output, workspace = unpack_call(call)
    filled, size = status.filled, options.step
    # A row of the output ends each interval; without output there is one interval.
    start, count, steps = status.time, 1, int(math.floor((end - status.time) / size + 0.5))
    if len(output.rows) > 0:
        start, steps = output.begin, int(math.floor(output.interval / size + 0.5))
        count = int(math.floor((end - start) / size + 0.5)) // steps
    for stretch in range(filled, count):
        # Times are computed from the start, so that rounding does not accumulate.
        begin = start + stretch * steps * size
        if filled >= output.pause:
            return moved(status, PAUSED, begin, filled)
        for done in range(steps):
            step(begin + done * size, state, size, system, workspace)  # type: ignore  # noqa: F821
            outcome = outcome_of(state, system.ground)
            if outcome != FINISHED:
                return moved(status, outcome, begin + (done + 1) * size, filled)
        workspace.statistics[STEPS] += steps
        workspace.statistics[EVALUATIONS] += steps * evaluations  # type: ignore  # noqa: F821
        if filled < len(output.rows):
            write_row(output, filled, begin + steps * size, state, system.actuator)
            filled += 1
    return moved(status, FINISHED, start + count * steps * size, filled)
