# SPDX-License-Identifier: Apache-2.0
"""
The fixed-step methods, and their loop: number of steps, end conditions of a run, output.

A method is a file with a step (`rk4`, `semi_implicit`); see the contract in `solvers`.
"""
import math

import numpy as np

from ballbot_ros.jit import by_number, outlined
from ballbot_ros.physics.solvers import rk4, semi_implicit
from ballbot_ros.physics.solvers.dense import write_row
from ballbot_ros.physics.solvers.values import (
    EVALUATIONS, FINISHED, outcome_of, Packed, packed, PAUSED, status_at, STEPS, unpack_call)

# To add a method, add its file, and its name here.
FIXED_STEP_METHODS = {'semi_implicit': semi_implicit, 'rk4': rk4}
PER_STEP = np.array([item.EVALUATIONS for item in FIXED_STEP_METHODS.values()])

step = by_number('step', FIXED_STEP_METHODS.values())


@outlined
def advance(call: Packed) -> Packed:
    """Advance a state in place; see the contract in `solvers`."""
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
            return packed(status_at(begin, PAUSED, filled))
        for done in range(steps):
            step(options.method, begin + done * size, state, size, system, workspace)
            outcome = outcome_of(state, system.ground)
            if outcome != FINISHED:
                return packed(status_at(begin + (done + 1) * size, outcome, filled))
        workspace.statistics[STEPS] += steps
        workspace.statistics[EVALUATIONS] += steps * PER_STEP[options.method]
        if filled < len(output.rows):
            write_row(output, filled, begin + steps * size, state, system.actuator)
            filled += 1
    return packed(status_at(start + count * steps * size, FINISHED, filled))
