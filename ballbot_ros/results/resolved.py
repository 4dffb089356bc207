# SPDX-License-Identifier: Apache-2.0
"""A run with samples that resolve contacts and extremes."""
import math
from typing import Iterator

import numpy as np

from ballbot_ros.physics.simulation.solver import Integrator
from ballbot_ros.physics.simulation.trajectory import Trajectory
from ballbot_ros.physics.solvers.values import FINISHED, Output, Status

EVENT_STEP = 1e-3  # largest sampling period for events and extremes [s]
BLOCK_ROWS = 2000       # rows of a piece: bounds the memory of a long run


def resolved(run: Trajectory) -> Iterator[Trajectory]:
    """
    Yield a run in pieces whose samples are at most `EVENT_STEP` apart.

    The last sample of a piece is the first of the next one.  A run of a scene with a larger output
    step is integrated again from its samples; without a scene the samples are returned unchanged.
    """
    gap = run.scene.run.output_step if run.scene is not None else 0.0
    solver = run.model.solver_in_use
    parts = round(gap / solver.step) if solver.fixed else math.ceil(gap / EVENT_STEP - 1e-9)
    if gap <= EVENT_STEP * (1.0 + 1e-9) or len(run) < 2 or not np.isfinite(run.rows).all():
        yield run
        return
    start = run.state(0)
    actuator = run.scene.actuation.actuator(run.model.robot, start.time, start.joint_angle)
    integrator = Integrator(run.model.parameters, run.model.profile, solver)
    samples = max(1, BLOCK_ROWS // parts)
    for first in range(0, len(run) - 1, samples):
        given = run.rows[first:first + samples + 1]
        rows = np.empty((1 + parts * (len(given) - 1), given.shape[1]))
        rows[0], step = given[0], gap / parts
        integrator.workspace.statistics[:] = 0
        status = integrator.advance(
            actuator, given[0, 1:-1].copy(), Status(FINISHED, given[0, 0]),
            given[0, 0] + (len(rows) - 1) * step, Output(rows[1:], given[0, 0], step))
        yield Trajectory(run.model, rows if status.outcome == FINISHED else given)
