# SPDX-License-Identifier: Apache-2.0
"""
Dense output of a step, the energy balance along it, and rows of a trajectory.

The energies of dampers, frictions and motor do not affect the motion, so a step integrates the
motion alone.  The optional energy balance is the integral of these flows along the dense output,
by Gauss-Legendre quadrature with four nodes.
"""
import numpy as np

from ballbot_ros.jit import compiled
from ballbot_ros.physics.mechanics.equations import System
from ballbot_ros.physics.mechanics.modes import mode_derivative
from ballbot_ros.physics.model.actuation import Actuator, actuator_torque
from ballbot_ros.physics.model.state import SIZE
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.solvers import values
from ballbot_ros.physics.solvers.values import MOTION, Output, sum_rows, Workspace

COEFFICIENTS = 5  # of the dense output


def factors_at(theta: float) -> list[float]:
    """Return the factors of the coefficients of the dense output at `theta` (0 to 1)."""
    rest = 1.0 - theta
    return [1.0, theta, theta * rest, theta**2 * rest, theta**2 * rest**2]


def integrals(nodes: Array) -> Array:
    """
    Return the last four coefficients of the integral of a flow, from its values at the nodes.

    The flow is taken as the polynomial through the nodes.
    """
    powers = np.arange(1, 5)
    # Columns: the powers of theta in the factors of d1 to d4, see `interpolate`.
    functions = np.array([[1, 1, 0, 0], [0, -1, 1, 1], [0, 0, -1, -2], [0, 0, 0, 1.0]])
    found: Array = np.linalg.solve(functions, np.linalg.inv(
        nodes[:, None] ** (powers - 1)) / powers[:, None])
    return found


NODES = 0.5 + 0.5 * np.polynomial.legendre.leggauss(4)[0]
INTEGRALS = integrals(NODES)
NODE_FACTORS = np.array([factors_at(node) for node in NODES]).ravel()


@compiled
def motion_at(theta: float, work: Array) -> None:
    """Write the motion at `theta` (0 to 1) of the last step into the row PROBE."""
    rest, at = 1.0 - theta, values.FACTORS
    work[at], work[at + 1], work[at + 2] = 1.0, theta, theta * rest
    work[at + 3] = theta * theta * rest
    work[at + 4] = theta * theta * rest * rest
    sum_rows(work, values.PROBE, values.ZERO, 1.0, work, at, values.DENSE, COEFFICIENTS)


@compiled
def prepare_ledger(time: float, state: Array, step: float, system: System,
                   workspace: Workspace) -> None:
    """Compute the coefficients of the dense output of the ledger, behind those of the motion."""
    work, dense = workspace.work, workspace.dense
    for i in range(MOTION, SIZE):
        dense[0, i] = state[i]
        for k in range(1, COEFFICIENTS):
            dense[k, i] = 0.0
    for node in range(len(NODES)):
        sum_rows(work, values.PROBE, values.ZERO, 1.0, NODE_FACTORS, COEFFICIENTS * node,
                 values.DENSE, COEFFICIENTS)
        mode_derivative(time + NODES[node] * step, workspace.probe, system, workspace.mode,
                        workspace.rates)
        for k in range(1, COEFFICIENTS):
            for i in range(MOTION, SIZE):
                dense[k, i] += step * INTEGRALS[k - 1, node] * workspace.rates[i]


@compiled
def interpolate(theta: float, dense: Array, out: Array) -> None:
    """Write the state at `theta` (0 to 1) of the last step, with its ledger, into `out`."""
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
