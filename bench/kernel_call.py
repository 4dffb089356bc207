# SPDX-License-Identifier: Apache-2.0
"""Our adaptive method, called directly: one call of the kernel is one run."""
import math

import numpy as np

from ballbot_ros.jit import direct
from ballbot_ros.physics.model.state import X, Y
from ballbot_ros.physics.simulation.solver import METHODS
from ballbot_ros.physics.solvers.values import (
    EVALUATIONS, FINISHED, NO_OUTPUT, Options, Status, Workspace)

COARSEST = 1e-3  # of `simulation.solver` [m]


class Ours:
    """
    Runs of one case of `precision_scenes`.

    With `flight`, the flight phases use the closed form.  With `ledger`, the energy balance is
    computed, which peers do not do.
    """

    def __init__(self, case, flight=True, ledger=False):
        model, method = case.model, METHODS['adaptive']
        actuator = case.actuation.actuator(model.robot, 0.0, case.start.joint_angle)
        self.kernel, self.duration = method.advance, case.duration
        self.options = Options(1e-9, model.solver_in_use.step, method.steps, 2**62, flight,
                               ledger)
        self.workspace = Workspace.of(len(model.profile))
        self.system = model.parameters[:], model.profile, actuator[:]
        self.start, self.state = np.array(case.start[1:]), np.array(case.start[1:])
        self.begin, self.arrays = Status(FINISHED, 0.0).plain, self.workspace.plain
        self.tolerance = 0.0

    def evaluations(self):
        """Return the number of right-hand sides of a run with the last tolerance."""
        self.workspace.statistics[:] = 0
        self(self.tolerance)
        return int(self.workspace.statistics[EVALUATIONS])

    def __call__(self, tolerance):
        """Run, and return the end position; NaN for a tolerance out of range."""
        if tolerance > COARSEST:
            return math.nan, math.nan
        if tolerance != self.tolerance:
            self.options, self.tolerance = self.options._replace(tolerance=tolerance), tolerance
            self.advance = direct(self.kernel)
        self.state[:] = self.start
        self.advance((self.begin, self.duration, self.state, self.system, self.options[:],
                      NO_OUTPUT[:], self.arrays))
        return self.state[X], self.state[Y]
