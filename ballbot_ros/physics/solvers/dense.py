# SPDX-License-Identifier: Apache-2.0
"""Sums of stages, the state within a step, and rows of a trajectory."""
from ballbot_ros.compiled import compiled
from ballbot_ros.physics.mechanics.equations import actuator_torque
from ballbot_ros.physics.model.parameters import Actuator
from ballbot_ros.physics.model.state import SIZE
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.solvers.values import Output, Workspace


@compiled
def add_rows(count: int, factors: Array, scale: float, rows: Array, out: Array) -> None:
    """
    Add ``scale * sum(factors[k] * rows[k])`` over the first `count` rows (1 to 7) to `out`.

    A branch for each number of rows: with a loop over them inside the loop over the numbers,
    the sums of a step take as long as all of its mechanics.
    """
    f, w = factors, rows
    if count == 1:
        for i in range(SIZE):
            out[i] += scale * f[0] * w[0, i]
    elif count == 2:
        for i in range(SIZE):
            out[i] += scale * (f[0] * w[0, i] + f[1] * w[1, i])
    elif count == 3:
        for i in range(SIZE):
            out[i] += scale * (f[0] * w[0, i] + f[1] * w[1, i] + f[2] * w[2, i])
    elif count == 4:
        for i in range(SIZE):
            out[i] += scale * (f[0] * w[0, i] + f[1] * w[1, i] + f[2] * w[2, i] + f[3] * w[3, i])
    elif count == 5:
        for i in range(SIZE):
            out[i] += scale * (f[0] * w[0, i] + f[1] * w[1, i] + f[2] * w[2, i] + f[3] * w[3, i]
                + f[4] * w[4, i])
    elif count == 6:
        for i in range(SIZE):
            out[i] += scale * (f[0] * w[0, i] + f[1] * w[1, i] + f[2] * w[2, i] + f[3] * w[3, i]
                + f[4] * w[4, i] + f[5] * w[5, i])
    elif count == 7:
        for i in range(SIZE):
            out[i] += scale * (f[0] * w[0, i] + f[1] * w[1, i] + f[2] * w[2, i] + f[3] * w[3, i]
                + f[4] * w[4, i] + f[5] * w[5, i] + f[6] * w[6, i])


@compiled
def interpolate(theta: float, dense: Array, out: Array) -> None:
    """Write the state at `theta` (0 to 1) of the last step into `out`."""
    rest = 1.0 - theta
    for i in range(SIZE):
        out[i] = dense[0, i] + theta * (dense[1, i] + rest * (
            dense[2, i] + theta * (dense[3, i] + rest * dense[4, i])))


@compiled
def write_row(output: Output, row: int, time: float, state: Array, actuator: Actuator) -> None:
    """Fill one row."""
    output.rows[row, 0] = time
    for i in range(SIZE):
        output.rows[row, 1 + i] = state[i]
    output.rows[row, 1 + SIZE] = actuator_torque(time, state, actuator)


@compiled
def write_rows(output: Output, filled: int, time: float, step: float, reached: float,
               actuator: Actuator, workspace: Workspace) -> int:
    """Fill the rows whose time the last step has passed, and return how many are filled."""
    while (filled < len(output.rows)
           and output.begin + (filled + 1) * output.interval <= reached):
        moment = output.begin + (filled + 1) * output.interval
        interpolate(min((moment - time) / step, 1.0), workspace.dense, workspace.probe)
        write_row(output, filled, moment, workspace.probe, actuator)
        filled += 1
    return filled
