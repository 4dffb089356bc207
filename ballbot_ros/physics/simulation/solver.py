# SPDX-License-Identifier: Apache-2.0
"""
The integration methods by name, the choice of one, its use from Python, and failed runs.

`physics.solvers` describes how to add a method.
"""
from dataclasses import dataclass
import math
from typing import Callable, NamedTuple

import numpy as np

from ballbot_ros.config.fields import Checked, count, quantity, text
from ballbot_ros.errors import ConfigurationError, SimulationError
from ballbot_ros.jit import compiled, direct
from ballbot_ros.physics.mechanics.contact import contact_table
from ballbot_ros.physics.mechanics.equations import energies
from ballbot_ros.physics.model.actuation import Actuator
from ballbot_ros.physics.model.robot import Parameters
from ballbot_ros.physics.model.state import CONTACT_LOSS, JOINT_LOSS, MOTOR_WORK, State, X
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.solvers import fixed_step, integrate, trapezoidal
from ballbot_ros.physics.solvers.controller import STEP_METHODS
from ballbot_ros.physics.solvers.fixed_step import FIXED_STEP_METHODS
from ballbot_ros.physics.solvers.values import (
    AUTOMATIC, BUDGET_EXCEEDED, NO_OUTPUT, Options, Output, Packed, PENETRATED, Status, status_of,
    STEP_TOO_SMALL, Workspace)


class Method(NamedTuple):
    """A method and its description for users."""

    advance: Callable[[Packed], Packed]  # see `solvers`
    evaluations: int = 0  # of the right-hand side per step, for fixed-step methods
    steps: int = AUTOMATIC  # number of its step in FIXED_STEP_METHODS or STEP_METHODS
    flies: bool = False  # whether it may compute flights in closed form
    tolerance: bool = False  # whether it chooses its steps by their error
    step: bool = False  # whether it has a given step, or maximum step

    @property
    def fixed(self) -> bool:
        """Return whether it is a fixed-step method."""
        return not self.tolerance


METHODS: dict[str, Method] = {
    **{name: Method(fixed_step.advance, item.EVALUATIONS, number, step=True)
       for number, (name, item) in enumerate(FIXED_STEP_METHODS.items())},
    'adaptive': Method(integrate.advance, flies=True, tolerance=True),
    **{name: Method(integrate.advance, steps=number, flies=True, tolerance=True)
       for number, name in enumerate(STEP_METHODS)},
    'trapezoidal': Method(trapezoidal.advance, tolerance=True, step=True),
}


MODELS = ('auto', 'full')
# Largest error of position [m]: the default, and the allowed range.
ACCURACY, SMALLEST, LARGEST = 1e-5, 1e-9, 0.1


@dataclass(frozen=True, repr=False)
class Solver(Checked):
    """
    Integrator and its step sizes or tolerance.

    ``semi_implicit`` and ``rk4`` are fixed-step methods.

    ``adaptive`` controls its steps by their estimated local error and locates every event of the
    contact law; it switches between explicit and L-stable implicit steps by cost, and
    ``explicit`` and ``implicit`` use one of the two alone; see `solvers.integrate`.

    ``trapezoidal`` is the rule of the paper, with a maximum step; see `solvers.trapezoidal`.
    """

    method: str = text('integrator', default='rk4', choices=METHODS)
    step: float = quantity(
        's', 'integration step of a fixed-step method; maximum step of trapezoidal',
        default=1e-4, above=0.0, maximum=0.1)
    tolerance: float = quantity(
        'm', 'local error per step of a method that chooses its steps', default=1e-9,
        minimum=1e-14, maximum=1e-3)
    models: str = text(
        'models of an adaptive method: full, always the full model; auto, '
        'flight in closed form where that is exact', default='auto', choices=MODELS)
    work_budget: int = count(
        'function evaluations after which a run is aborted; the default takes some minutes',
        default=10_000_000_000, minimum=1, maximum=10**15)

    @property
    def fixed(self) -> bool:
        """Return whether the method takes fixed steps."""
        return METHODS[self.method].fixed

    @property
    def finer(self) -> str:
        """Return the advice for a more accurate run, ``a smaller step than 0.001 s``."""
        return (f'a smaller step than {self.step:g} s' if self.fixed
                else f'a smaller tolerance than {self.tolerance:g} m')


# Solvers with a name; `paper` is table 1 of the paper.
PRESETS = {'paper': Solver('trapezoidal', step=1e-3, tolerance=1e-9)}


class Integrator:
    """
    Advances states; one for each thread.

    The ground is that of `Terrain.profile`.  Each call overwrites the `workspace`, except its
    statistics, which accumulate: the work budget of the solver applies to them.
    """

    def __init__(self, parameters: Parameters, ground: Array, solver: Solver) -> None:
        self._parameters, self._ground = parameters[:], ground
        method = METHODS[solver.method]
        self._advance = method.advance
        self._options = Options(
            solver.tolerance, solver.step, method.steps, solver.work_budget,
            method.flies and solver.models != 'full')[:]
        self.workspace = Workspace.of(len(ground))
        self._workspace = self.workspace.plain

    def advance(self, actuator: Actuator, state: Array, status: Status, end: float,
                output: Output = NO_OUTPUT) -> Status:
        """
        Advance a state in place.

        Parameters
        ----------
        actuator : Actuator
        state : (13,) array
        status : Status
            Status of the state: ``Status(FINISHED, time)`` at the start of a run.
        end : float
            [s]
        output : Output, optional
            Rows to fill.

        """
        return status_of(direct(self._advance)((
            status.plain, end, state, (self._parameters, self._ground, actuator[:]),
            self._options, output[:], self._workspace)))


# Energy residual, relative to the energy in play, at which a run is stopped. In an accurate run it
# is a millionth; beyond the stability limit it soon exceeds 1.
LEDGER_BOUND = 0.05
ENERGY_ROUNDING = 1e-9  # of energies that cancel


@compiled
def balance_of(state: Array, parameters: Parameters, ground: Array,
               contacts: Array) -> tuple[float, float, float, float, float]:
    """
    Return the terms of the energy balance [J].

    They are kinetic energy, potential energy, energy of the contact springs, and, since the start,
    dissipated energy and work of the motor.
    """
    kinetic, potential, contact = energies(state, parameters, ground, contacts)
    lost = 0.0
    for item in range(CONTACT_LOSS, JOINT_LOSS + 1):
        lost += state[item]
    return kinetic, potential, contact, lost, state[MOTOR_WORK]


@compiled
def worst_gap(states: Array, start: Array, play: float, values: tuple[float, ...],
              ground: Array, contacts: Array) -> tuple[float, int, float]:
    """
    Return the largest gap of the ledger relative to the energy in play, its row, and that energy.

    `play` is the largest energy that has been in play so far [J], see `Trajectory.energy_in_play`;
    `values` is `Parameters` as a plain tuple, which numba recognises sooner than a named one.
    """
    worst, where, parameters = 0.0, 0, Parameters(*values)
    first = balance_of(start, parameters, ground, contacts)
    kinetic0, potential0, contact0, lost0, work0 = first
    floor = 0.0
    for part in first:
        floor += ENERGY_ROUNDING * abs(part)
    play = max(play, kinetic0, abs(contact0))
    for row in range(len(states)):
        kinetic, potential, contact, lost, work = balance_of(
            states[row], parameters, ground, contacts)
        play = max(play, kinetic, abs(potential - potential0), abs(contact), abs(lost - lost0),
                   abs(work - work0))
        gap = abs(kinetic + potential + contact + lost - work
                  - (kinetic0 + potential0 + contact0 + lost0 - work0))
        # A gap that is NaN counts as infinite.
        ratio = gap / max(play, floor) if gap > 0.0 else (0.0 if gap == 0.0 else math.inf)
        if ratio > worst:
            worst, where = ratio, row
        if worst > LEDGER_BOUND:
            break
    return worst, where, play


class Ledger:
    """The energy balance of a run from a state on, for periodic checks; see `Terrain.profile`."""

    def __init__(self, parameters: Parameters, ground: Array, state: Array) -> None:
        self._fixed = parameters[:], ground, contact_table(len(ground))
        self._start, self._play = state.copy(), 0.0

    def missing(self, states: Array) -> tuple[float, int]:
        """
        Return the largest energy residual since the start at the next states, and its index.

        It is relative to the reference energy; the index is that of its state, of the first one
        beyond `LEDGER_BOUND` if there is one.
        """
        # A contiguous array has the type for which the solvers are compiled.
        worst, where, self._play = worst_gap(
            np.ascontiguousarray(states), self._start, self._play, *self._fixed)
        return float(worst), int(where)


class OutOfBalance(SimulationError):
    """A run is finite, but its energy balance does not close."""


def out_of_balance(time: float, missing: float, solver: Solver) -> OutOfBalance:
    """Return the error of a run whose energy balance does not close."""
    return OutOfBalance(
        time, f'the energy balance error is {100.0 * missing:.3g} % of the reference energy',
        f'use {solver.finer}{" (solver), the adaptive method," if solver.fixed else ""} or softer '
        'gains, a softer contact_stiffness or a larger slip_threshold',
        'unbalanced', 'step' if solver.fixed else 'tolerance')


def check_work(solver: Solver, steps: int) -> None:
    """Raise `ConfigurationError` for a fixed-step run that would exceed its work budget."""
    needed = steps * METHODS[solver.method].evaluations
    if needed > solver.work_budget:
        raise ConfigurationError(
            f'solver: {steps} steps of {solver.step:g} s take {needed} function evaluations, more '
            f'than the work_budget of {solver.work_budget}; raise it, use a longer step, or the '
            'adaptive method', 'out_of_range', 'work_budget')


def failure(outcome: int, time: float, vector: Array, solver: Solver) -> SimulationError:
    """Return the error that explains how a run ended."""
    shorter = f'use {solver.finer} (solver), {"the adaptive method, " if solver.fixed else ""}or '
    if outcome == PENETRATED:
        return SimulationError(
            time, f'the centre of the ball is under the ground at x = {vector[X]:.4g} m',
            f'raise contact_stiffness, lower the speed of the impact, or {shorter}softer gains',
            'penetrated', 'y')
    if outcome == STEP_TOO_SMALL:
        return SimulationError(
            time, 'the adaptive step became too small to continue',
            f'raise the tolerance above {solver.tolerance:g} m, use softer gains or a '
            'larger slip_threshold', 'step_too_small', 'tolerance')
    if outcome == BUDGET_EXCEEDED:
        return SimulationError(
            time, f'the work budget of {solver.work_budget} function evaluations is used up',
            'raise work_budget (solver), use a fixed-step method (rk4), raise the tolerance '
            f'above {solver.tolerance:g} m, or use a larger slip_threshold, softer gains '
            'or a softer contact_stiffness; where the ball sinks in deep, raise '
            'contact_stiffness instead', 'over_budget', 'work_budget')
    names = [name for name, value in zip(State._fields[1:], vector) if not math.isfinite(value)]
    return SimulationError(
        time, f'{" and ".join(names) or "the state"} stopped being finite',
        f'{shorter}softer gains', 'not_finite', names[0] if names else '')
