# SPDX-License-Identifier: Apache-2.0
"""
The steps that `integrate` chooses from: an explicit and an implicit method, by one contract.

See `solvers` for the contract; numba compiles no table of functions, so each function of the
contract has a branch here.
"""
from ballbot_ros.jit import compiled
from ballbot_ros.physics.model.parameters import System
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.solvers import dormand_prince, rodas5p
from ballbot_ros.physics.solvers.values import Workspace

STAGES = dormand_prince.STAGES  # right-hand sides of an explicit step


@compiled
def take_step(implicit: bool, time: float, state: Array, size: float, ready: int, system: System,
              workspace: Workspace) -> float:
    """Take a step and return its stiffness."""
    if implicit:
        return rodas5p.step(time, state, size, ready, system, workspace)
    return dormand_prince.step(time, state, size, ready, system, workspace)


@compiled
def prepare_dense(implicit: bool, size: float, workspace: Workspace) -> None:
    """Compute the coefficients of the dense output of the last step."""
    if implicit:
        rodas5p.prepare_dense(size, workspace)
    else:
        dormand_prince.prepare_dense(size, workspace)


@compiled
def end_step(implicit: bool, workspace: Workspace) -> int:
    """Return what is ready for a step that begins where the last one ends."""
    if implicit:
        return rodas5p.end_step(workspace)
    return dormand_prince.end_step(workspace)
