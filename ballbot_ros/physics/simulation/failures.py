# SPDX-License-Identifier: Apache-2.0
"""Failure messages of a run, and the energy balance that detects finite but wrong states."""
import math

from ballbot_ros.errors import ConfigurationError, SimulationError
from ballbot_ros.jit import compiled
from ballbot_ros.physics.mechanics.contact import (
    contact_table, first_segment, ground_height, spring_energy)
from ballbot_ros.physics.mechanics.equations import kinetic_energy, potential_energy
from ballbot_ros.physics.model.parameters import Parameters
from ballbot_ros.physics.model.state import CONTACT_LOSS, JOINT_LOSS, MOTOR_WORK, X, Y
from ballbot_ros.physics.model.terrain import Array, TANGENT_X
from ballbot_ros.physics.simulation.solver import Solver
from ballbot_ros.physics.solvers.registry import METHODS
from ballbot_ros.physics.solvers.values import BUDGET_EXCEEDED, PENETRATED, STEP_TOO_SMALL

# Part of the energy in play that may be missing before a run is stopped. An accurate run misses
# a millionth; a step beyond the limit of stability soon misses more than there is.
LEDGER_BOUND = 0.05
ROUNDING = 1e-9  # of energies that cancel

NAMES = ('ball_angle', 'pendulum_angle', 'x', 'y', 'ball_rate', 'pendulum_rate', 'velocity_x',
         'velocity_y', 'contact_loss', 'friction_loss', 'rolling_loss', 'joint_loss',
         'motor_work')


# What the ledger of a state holds [J]: kinetic and potential energy, that in the springs of the
# contacts; lost to dampers and frictions, and work of the motor, since the start.  A plain tuple:
# it goes to Python and back, see `solvers.values.Packed`.
Energy = tuple[float, float, float, float, float]


@compiled
def energy_of(state: Array, values: tuple[float, ...], ground: Array, contacts: Array) -> Energy:
    """Return the energy of a state; `values` of the parameters, `contacts` to work in."""
    parameters = Parameters(*values)
    lost = 0.0
    for item in range(CONTACT_LOSS, JOINT_LOSS + 1):
        lost += state[item]
    return (kinetic_energy(state, parameters), potential_energy(state, parameters),
            spring_energy(state, parameters, ground, contacts), lost, state[MOTOR_WORK])


@compiled
def worst_gap(states: Array, first: Energy, play: float, values: tuple[float, ...],
              ground: Array, contacts: Array) -> tuple[float, int, float]:
    """
    Return the largest gap of the ledger over the energy in play, where, and that energy.

    Parameters
    ----------
    states : (n, 13) array
    first : Energy
        At the start of the run.
    play : float
        Largest energy that has been in play so far [J]; see `Trajectory.energy_in_play`.
    values : tuple of float
        Of the parameters: recognised sooner than a named tuple.

    """
    worst, where = 0.0, 0
    kinetic0, potential0, contact0, lost0, work0 = first
    floor = 0.0
    for part in first:
        floor += ROUNDING * abs(part)
    for row in range(len(states)):
        kinetic, potential, contact, lost, work = energy_of(
            states[row], values, ground, contacts)
        play = max(play, kinetic, abs(potential - potential0), abs(contact), abs(lost - lost0),
                   abs(work - work0))
        gap = abs(kinetic + potential + contact + lost - work
                  - (kinetic0 + potential0 + contact0 + lost0 - work0))
        # A gap that is no number is one without bound.
        ratio = gap / max(play, floor) if gap > 0.0 else (0.0 if gap == 0.0 else math.inf)
        if ratio > worst:
            worst, where = ratio, row
        if worst > LEDGER_BOUND:
            break
    return worst, where, play


class Ledger:
    """
    The energy balance of a run, for periodic checks.

    Parameters
    ----------
    parameters : Parameters
    ground : (n, 7) array
        See `Terrain.profile`.
    state : (13,) array
        At the start.

    """

    def __init__(self, parameters: Parameters, ground: Array, state: Array) -> None:
        """Open it."""
        self._fixed = parameters[:], ground, contact_table(len(ground))
        self._first = energy_of(state, *self._fixed)
        self._play = max(self._first[0], abs(self._first[2]))

    def missing(self, states: Array) -> tuple[float, int]:
        """
        Look at the next states of the run, an (n, 13) array.

        Returns
        -------
        missing : float
            Energy from or to nowhere since the start, over the energy in play; the worst.
        where : int
            Number of that state; the first that is beyond `LEDGER_BOUND`.

        """
        worst, where, self._play = worst_gap(states, self._first, self._play, *self._fixed)
        return float(worst), int(where)


class OutOfBalance(SimulationError):
    """A run is finite, but energy has come from nowhere or gone there."""


def out_of_balance(time: float, missing: float, solver: Solver) -> OutOfBalance:
    """Return the error of a run whose energy ledger does not close."""
    remedy = (f'use a smaller step than {solver.step:g} s (solver), the adaptive method,'
              if METHODS[solver.method].fixed else
              f'use a smaller tolerance than {solver.tolerance:g} m')
    return OutOfBalance(
        time, f'the energy ledger misses {100.0 * missing:.3g} % of the energy in play',
        f'{remedy} or softer gains, a softer contact_stiffness or a larger slip_threshold')


def check_start(time: float, state: Array, radius: float, ground: Array) -> None:
    """
    Refuse a start with the centre of the ball under the ground.

    Raises
    ------
    SimulationError

    """
    below = ground_height(ground, state[X])
    if state[Y] <= below:
        slope = ground[first_segment(ground, state[X])]
        raise SimulationError(
            time, f'the centre of the ball starts under the ground at x = {state[X]:.4g} m, with '
            f'y = {state[Y]:.4g} m', 'raise y of the start (initial): with y = '
            f'{below + radius / slope[TANGENT_X]:.9g} m the ball touches the ground there')


def check_work(solver: Solver, steps: int) -> None:
    """
    Refuse a fixed-step run that would exceed its work budget.

    Raises
    ------
    ConfigurationError

    """
    needed = steps * METHODS[solver.method].evaluations
    if needed > solver.work_budget:
        raise ConfigurationError(
            f'solver: {steps} steps of {solver.step:g} s take {needed} function evaluations, more '
            f'than the work_budget of {solver.work_budget}; raise it, use a longer step, or the '
            'adaptive method')


def failure(outcome: int, time: float, vector: Array, solver: Solver) -> SimulationError:
    """Return the error that explains how a run ended."""
    shorter = f'use a smaller step than {solver.step:g} s (solver), the adaptive method, or '
    if not METHODS[solver.method].fixed:
        shorter = f'use a smaller tolerance than {solver.tolerance:g} m (solver), or '
    if outcome == PENETRATED:
        return SimulationError(
            time, f'the centre of the ball is under the ground at x = {vector[X]:.4g} m',
            f'raise contact_stiffness, lower the speed of the impact, or {shorter}softer gains')
    if outcome == STEP_TOO_SMALL:
        return SimulationError(
            time, 'the adaptive step became too small to go on',
            f'raise the tolerance above {solver.tolerance:g} m, use softer gains or a '
            'larger slip_threshold')
    if outcome == BUDGET_EXCEEDED:
        return SimulationError(
            time, f'the work budget of {solver.work_budget} function evaluations is used up',
            'raise work_budget (solver), take steps of one length (rk4), raise the tolerance '
            f'above {solver.tolerance:g} m, or use a larger slip_threshold, softer gains '
            'or a softer contact_stiffness; where the ball sinks in deep, raise '
            'contact_stiffness instead')
    names = [name for name, value in zip(NAMES, vector) if not math.isfinite(value)]
    return SimulationError(
        time, f'{" and ".join(names) or "the state"} stopped being finite',
        f'{shorter}softer gains')
