# SPDX-License-Identifier: Apache-2.0
"""How a run can fail, in words; and the energy ledger that finds out nonsense that is finite."""
import math
from typing import Any

from ballbot_ros.compiled import compiled
from ballbot_ros.errors import ConfigurationError, SimulationError
from ballbot_ros.physics.mechanics.contact import spring_energy
from ballbot_ros.physics.mechanics.equations import (
    CONTACT_LOSS, JOINT_LOSS, kinetic_energy, MOTOR_WORK, potential_energy, X, Y)
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.solvers.adaptive import METHODS as ADAPTIVE
from ballbot_ros.physics.solvers.embedded import SPENT, STALLED
from ballbot_ros.physics.solvers.fixed_step import SUNK

# Part of the energy in play that may be missing before a run is stopped. An accurate run misses
# a millionth; a step beyond the limit of stability soon misses more than there is.
LEDGER_BOUND = 0.05
ROUNDING = 1e-9  # of energies that cancel

NAMES = ('ball_angle', 'pendulum_angle', 'x', 'y', 'ball_rate', 'pendulum_rate', 'velocity_x',
         'velocity_y', 'contact_loss', 'friction_loss', 'rolling_loss', 'joint_loss',
         'motor_work')


@compiled
def energy_parts(state: Any, robot: Any, ground: Any, table: Any) -> tuple:
    """Return kinetic, potential and contact energy, all that is lost, and the motor's work."""
    lost = 0.0
    for item in range(CONTACT_LOSS, JOINT_LOSS + 1):
        lost += state[item]
    return (kinetic_energy(state, robot), potential_energy(state, robot),
            spring_energy(robot, ground, table, state[X], state[Y]), lost, state[MOTOR_WORK])


@compiled
def worst_gap(states: Any, first: Any, play: float, robot: Any, ground: Any,
              table: Any) -> tuple:
    """
    Return the largest gap of the ledger over the energy in play, where, and that energy.

    Parameters
    ----------
    states : (n, 13) array
    first : tuple
        What `energy_parts` says of the start of the run.
    play : float
        Largest energy that has been in play so far [J]; see `Trajectory.energy_in_play`.

    """
    worst, where = 0.0, 0
    floor = 0.0
    for part in first:
        floor += ROUNDING * abs(part)
    for row in range(len(states)):
        parts = energy_parts(states[row], robot, ground, table)
        play = max(play, parts[0], abs(parts[1] - first[1]), abs(parts[2]),
                   abs(parts[3] - first[3]), abs(parts[4] - first[4]))
        gap = abs(parts[0] + parts[1] + parts[2] + parts[3] - parts[4]
                  - (first[0] + first[1] + first[2] + first[3] - first[4]))
        # A gap that is no number is one without bound.
        ratio = gap / max(play, floor) if gap > 0.0 else (0.0 if gap == 0.0 else math.inf)
        if ratio > worst:
            worst, where = ratio, row
        if worst > LEDGER_BOUND:
            break
    return worst, where, play


class Ledger:
    """
    The energy of a run, to be looked at now and then.

    Parameters
    ----------
    model : Model
    state : (13,) array
        At the start.
    table : array
        Room for the contacts.

    """

    def __init__(self, model: Any, state: Array, table: Array):
        """Open it."""
        self._fixed = model.numbers, model.profile, table
        self._first = energy_parts(state, *self._fixed)
        self._play = max(self._first[0], abs(self._first[2]))

    def missing(self, states: Array) -> tuple:
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


def out_of_balance(time: float, missing: float, model: Any) -> OutOfBalance:
    """Return the error of a run whose energy ledger does not close."""
    solver = model.solver
    way = (f'use a smaller tolerance than {solver.tolerance:g} m'
           if solver.method in ADAPTIVE else
           f'use a smaller step than {solver.step:g} s (solver), the adaptive method,')
    return OutOfBalance(
        time, f'the energy ledger misses {100.0 * missing:.3g} % of the energy in play', f'{way} '
        'or softer gains, a softer contact_stiffness or a larger slip_threshold')


def check_work(model: Any, steps: int) -> None:
    """
    Refuse a run with steps of one length that would take more than its work budget.

    Raises
    ------
    ConfigurationError

    """
    solver = model.solver
    needed = steps * (4 if solver.method == 'rk4' else 1)
    if needed > solver.work_budget:
        raise ConfigurationError(
            f'solver: {steps} steps of {solver.step:g} s take {needed} right-hand sides, more '
            f'than the work_budget of {solver.work_budget}; raise it, use a longer step, or the '
            'adaptive method')


def failure(ending: int, time: float, vector: Array, model: Any) -> SimulationError:
    """Return the error that explains how a run ended."""
    if ending == SUNK:
        return SimulationError(
            time, f'the centre of the ball is under the ground at x = {vector[X]:.4g} m',
            'raise contact_stiffness, lower the speed of the impact, or use a smaller step than '
            f'{model.solver.step:g} s (solver) or softer gains')
    if ending == STALLED:
        return SimulationError(
            time, 'the adaptive step became too small to go on',
            f'raise the tolerance above {model.solver.tolerance:g} m, use softer gains or a '
            'larger slip_threshold')
    if ending == SPENT:
        return SimulationError(
            time, f'the work budget of {model.solver.work_budget} right-hand sides is used up',
            'raise work_budget (solver), take steps of one length (rk4), raise the tolerance '
            f'above {model.solver.tolerance:g} m, or use a larger slip_threshold, softer gains '
            'or a softer contact_stiffness')
    names = [name for name, value in zip(NAMES, vector) if not math.isfinite(value)]
    return SimulationError(
        time, f'{" and ".join(names) or "the state"} stopped being finite',
        f'use a smaller step than {model.solver.step:g} s (solver), the adaptive method, or '
        'softer gains')
