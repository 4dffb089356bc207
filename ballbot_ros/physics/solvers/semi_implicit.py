# SPDX-License-Identifier: Apache-2.0
"""
Semi-implicit Euler with fixed steps, as in game engines.

Of order 1, with one evaluation per step; the energy of an undamped spring stays bounded.
"""
from ballbot_ros.jit import compiled
from ballbot_ros.physics.mechanics.equations import derivative, System
from ballbot_ros.physics.model.state import COORDINATES, SIZE
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.solvers import values
from ballbot_ros.physics.solvers.values import Workspace

EVALUATIONS = 1  # of the right-hand side, for each step


@compiled
def apply_rates(state: Array, size: float, rates: Array, count: int) -> None:
    """Advance `count` numbers of a state by their rates, the velocities first."""
    for i in range(COORDINATES, count):
        state[i] += size * rates[i]
    # The coordinates use the new velocities, which keeps the energy of springs bounded.
    for i in range(COORDINATES):
        state[i] += size * state[COORDINATES + i]


@compiled
def step(time: float, state: Array, size: float, system: System, workspace: Workspace) -> None:
    """Advance `state` in place by one step."""
    rates = workspace.work[values.RIGHT:]
    derivative(time, state, system, workspace.mode, rates)
    apply_rates(state, size, rates, SIZE)
