# SPDX-License-Identifier: Apache-2.0
"""
The classical Runge-Kutta method with fixed steps.

Of order 4 between the kinks of the contact law, of order 1 across them.
"""
from ballbot_ros.jit import compiled
from ballbot_ros.physics.mechanics.equations import derivative, System
from ballbot_ros.physics.model.state import SIZE
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.solvers import values
from ballbot_ros.physics.solvers.values import WIDTH, Workspace

EVALUATIONS = 4  # of the right-hand side, for each step


@compiled
def step(time: float, state: Array, size: float, system: System, workspace: Workspace) -> None:
    """Advance `state` in place by one step."""
    work, mode, first = workspace.work, workspace.mode, values.STAGES
    probe, k1, k2 = work[values.PROBE:], work[first:], work[first + WIDTH:]
    k3, k4 = work[first + 2 * WIDTH:], work[first + 3 * WIDTH:]
    derivative(time, state, system, mode, k1)
    for i in range(SIZE):
        probe[i] = state[i] + 0.5 * size * k1[i]
    derivative(time + 0.5 * size, probe, system, mode, k2)
    for i in range(SIZE):
        probe[i] = state[i] + 0.5 * size * k2[i]
    derivative(time + 0.5 * size, probe, system, mode, k3)
    for i in range(SIZE):
        probe[i] = state[i] + size * k3[i]
    derivative(time + size, probe, system, mode, k4)
    for i in range(SIZE):
        state[i] += size / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i])
