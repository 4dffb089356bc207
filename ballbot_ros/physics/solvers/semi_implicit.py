# SPDX-License-Identifier: Apache-2.0
"""
Semi-implicit Euler with fixed steps, as in game engines.

Of order 1, with one evaluation per step; keeps the energy of an undamped spring within a bound.
"""
from ballbot_ros.jit import compiled, outlined
from ballbot_ros.physics.mechanics.equations import derivative
from ballbot_ros.physics.model.parameters import System
from ballbot_ros.physics.model.state import COORDINATES, SIZE
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.solvers.fixed_step import end_stretch, moved, outcome_of, stretches
from ballbot_ros.physics.solvers.values import (
    FINISHED, named, Packed, PAUSED, Workspace)

ORDER = 1
EVALUATIONS = 1  # of the right-hand side, for each step


@compiled
def step(time: float, state: Array, size: float, system: System, workspace: Workspace) -> None:
    """Advance `state` in place by one step."""
    rates = workspace.rates
    derivative(time, state, system, workspace.mode.contacts, rates)
    for i in range(COORDINATES, SIZE):
        state[i] += size * rates[i]
    # The coordinates follow with the new velocities; this is what keeps springs bounded.
    for i in range(COORDINATES):
        state[i] += size * state[COORDINATES + i]


@outlined
def advance(call: Packed) -> Packed:
    """Advance a state in place; see the contract in `solvers`."""
    status, end, state, system, options, output, workspace = named(call)
    start, count, steps = stretches(status, end, options, output)
    filled, size = status.filled, options.step
    for stretch in range(filled, count):
        # Times are counted from the start, so that they carry no accumulated rounding.
        begin = start + stretch * steps * size
        if filled >= output.pause:
            return moved(status, PAUSED, begin, filled)
        for done in range(steps):
            step(begin + done * size, state, size, system, workspace)
            outcome = outcome_of(state, system)
            if outcome != FINISHED:
                return moved(status, outcome, begin + (done + 1) * size, filled)
        filled = end_stretch(begin + steps * size, state, steps, EVALUATIONS, system, output,
                             filled, workspace)
    return moved(status, FINISHED, start + count * steps * size, filled)
