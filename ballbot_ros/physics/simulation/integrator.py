# SPDX-License-Identifier: Apache-2.0
"""A method with the arrays that it works in, for one robot on one ground."""
from typing import Optional

from ballbot_ros.jit import direct
from ballbot_ros.physics.model.parameters import Actuator, Parameters
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.simulation.solver import Solver
from ballbot_ros.physics.solvers.registry import METHODS
from ballbot_ros.physics.solvers.values import (
    EVALUATIONS, NO_OUTPUT, Options, Output, SEARCH, Status, status_of, Workspace)


class Integrator:
    """
    What advances states; one for each thread.

    Parameters
    ----------
    parameters : Parameters
    ground : (n, 7) array
        See `Terrain.profile`.
    solver : Solver
    flight : bool
        Whether to fly in closed form, where the method may.

    Attributes
    ----------
    workspace : Workspace
        Overwritten at each call, but for its statistics, which add up.

    """

    def __init__(self, parameters: Parameters, ground: Array, solver: Solver,
                 flight: bool = False) -> None:
        """Allocate the workspace once."""
        self._parameters, self._ground, self._solver = parameters[:], ground, solver
        self._method = METHODS[solver.method]
        self._flight = flight and self._method.flies
        self.workspace = Workspace.of(len(ground))
        self._workspace = self.workspace.plain

    @property
    def work(self) -> int:
        """Return the right-hand sides that all calls have taken."""
        statistics = self.workspace.statistics
        return int(statistics[EVALUATIONS] + statistics[SEARCH])

    def advance(self, actuator: Actuator, state: Array, status: Status, end: float,
                output: Output = NO_OUTPUT, budget: Optional[int] = None) -> Status:
        """
        Advance a state in place.

        Parameters
        ----------
        actuator : Actuator
        state : (13,) array
        status : Status
            Of the state: ``Status(FINISHED, time)`` where a run begins.
        end : float
            [s]
        output : Output, optional
            Rows to fill.
        budget : int, optional
            Where the `work` ends the run; by default the work budget of the solver from here.

        """
        solver = self._solver
        if budget is None:
            budget = self.work + solver.work_budget
        options = Options(
            solver.tolerance, solver.step, self._method.steps, budget, self._flight)
        return status_of(direct(self._method.advance)((
            status.plain, end, state, (self._parameters, self._ground, actuator[:]), options[:],
            output[:], self._workspace)))
