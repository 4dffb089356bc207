# SPDX-License-Identifier: Apache-2.0
"""Warnings about the results of a run."""
from typing import Iterator, Optional

import numpy as np

from ballbot_ros.physics.simulation.trajectory import Trajectory
from ballbot_ros.physics.solvers.registry import METHODS
from ballbot_ros.results.plausibility import scene_warnings

# Relative energy balance error above which a smaller step is needed.
RESIDUAL = 1e-5

# Share of the time in contact with full sliding that is called sliding all along.
SLIDING_MAX = 0.9

# Penetration, as part of the radius, above which a shell is not a stiff spring.
PENETRATION_MAX = 0.1


def find_warnings(trajectory: Trajectory, expected: int, residual: Optional[float], depth: float,
                  sliding: float) -> Iterator[str]:
    """
    Yield one sentence for each result that needs attention.

    A complete run has the `expected` samples.  `residual` is the energy balance error relative to
    the reference energy, `depth` the largest penetration [m], `sliding` the part of the time in
    contact with full sliding.
    """
    model, assured = trajectory.model, trajectory.assurance
    robot, solver = model.robot, model.solver_in_use
    if trajectory.scene is not None:
        yield from scene_warnings(trajectory.scene)
    finer = (f'a smaller step than {solver.step:g} s' if METHODS[solver.method].fixed
             else f'a smaller tolerance than {solver.tolerance:g} m')
    if assured is not None:
        finer = 'a smaller accuracy'
        if not assured.complete:
            yield (f'the motion is chaotic: the accuracy of {assured.accuracy:g} m holds up to '
                   f'{assured.horizon:.4g} s, and no tolerance takes it further')
    if len(trajectory) < expected:
        yield (f'the run ended early: {len(trajectory)} of {expected} samples, up to '
               f'{trajectory["time"][-1]:g} s')
    if not np.isfinite(trajectory.rows).all():
        yield f'some numbers are not finite; use {finer}'
    elif residual is not None and not residual <= RESIDUAL:
        yield (f'the energy balance error is {residual:.1e} relative to the reference energy '
               f'(good: at most {RESIDUAL:.0e}); use {finer}')
    if depth > PENETRATION_MAX * robot.ball_radius:
        yield (f'the ball sank {1e3 * depth:.3g} mm into the ground, more than '
               f'{PENETRATION_MAX:.0%} of its radius; contact_stiffness is too low for this '
               'impact')
    if sliding > SLIDING_MAX:
        yield (f'the ball slid for {sliding:.0%} of its time in contact, so it never '
               'rolled; start it without slip (initial: speed), drive it less or raise '
               'surface_friction')
    still = np.ptp(trajectory.rows[:, 1:9], axis=0).max() < 1e-6
    if still and len(trajectory) > 1:
        yield 'nothing moved: give the scene an initial speed (initial) or an actuation'
