# SPDX-License-Identifier: Apache-2.0
"""
Dense output of a step, the energy balance along it, and rows of a trajectory.

The energies of dampers, frictions and motor do not affect the motion, so a step integrates only
the motion.  The optional energy balance is the integral of these flows along the dense output,
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
from ballbot_ros.physics.solvers.values import MOTION, Output, sum_rows, WIDTH, Workspace

COEFFICIENTS = 5  # of the dense output


def factors_at(theta: float) -> list[float]:
    """Return the factors of the coefficients of the dense output at `theta` (0 to 1)."""
    rest = 1.0 - theta
    return [1.0, theta, theta * rest, theta**2 * rest, theta**2 * rest**2]


def integrals(nodes: Array) -> Array:
    """
    Return the last four coefficients of the integral of a flow, from its values at the nodes.

    The flow is approximated by the polynomial through the nodes.
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
    work, first = workspace.work, values.DENSE
    probe, rates = work[values.PROBE:], work[values.RIGHT:]
    for i in range(MOTION, SIZE):
        work[first + i] = state[i]
        for k in range(1, COEFFICIENTS):
            work[first + WIDTH * k + i] = 0.0
    for node in range(len(NODES)):
        sum_rows(work, values.PROBE, values.ZERO, 1.0, NODE_FACTORS, COEFFICIENTS * node,
                 values.DENSE, COEFFICIENTS)
        mode_derivative(time + NODES[node] * step, probe, system, workspace.mode, rates)
        for k in range(1, COEFFICIENTS):
            for i in range(MOTION, SIZE):
                work[first + WIDTH * k + i] += step * INTEGRALS[k - 1, node] * rates[i]


@compiled
def interpolate(theta: float, work: Array, out: Array) -> None:
    """Write the state at `theta` (0 to 1) of the last step, with its ledger, into `out`."""
    rest = 1.0 - theta
    for i in range(SIZE):
        at = values.DENSE + i
        out[i] = work[at] + theta * (work[at + WIDTH] + rest * (
            work[at + 2 * WIDTH] + theta * (work[at + 3 * WIDTH] + rest * work[at + 4 * WIDTH])))


@compiled
def write_row(output: Output, row: int, time: float, state: Array, actuator: Actuator) -> None:
    """Fill one row of the output."""
    output.rows[row, 0] = time
    for i in range(SIZE):
        output.rows[row, 1 + i] = state[i]
    output.rows[row, 1 + SIZE] = actuator_torque(time, state, actuator)


@compiled
def write_rows(output: Output, filled: int, time: float, step: float, reached: float,
               actuator: Actuator, workspace: Workspace) -> int:
    """Fill the rows whose time the last step has passed; return the number of filled rows."""
    probe = workspace.work[values.PROBE:]
    while (filled < len(output.rows)
           and output.begin + (filled + 1) * output.interval <= reached):
        moment = output.begin + (filled + 1) * output.interval
        interpolate(min((moment - time) / step, 1.0), workspace.work, probe)
        write_row(output, filled, moment, probe, actuator)
        filled += 1
    return filled
