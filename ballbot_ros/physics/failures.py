# SPDX-License-Identifier: Apache-2.0
"""How a run can fail, in words; and the energy ledger that finds out nonsense that is finite."""
import math
from typing import Any

from ballbot_ros.compiled import compiled
from ballbot_ros.errors import SimulationError
from ballbot_ros.physics.adaptive import SPENT, STALLED
from ballbot_ros.physics.contact import spring_energy
from ballbot_ros.physics.dynamics import (
    CONTACT_LOSS, JOINT_LOSS, kinetic_energy, MOTOR_WORK, potential_energy, X, Y)
from ballbot_ros.physics.integrators import SUNK
from ballbot_ros.physics.terrain import Array

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
        self._numbers, self._profile, self._table = model.numbers, model.profile, table
        self._first = energy_parts(state, self._numbers, self._profile, table)
        kinetic, _, contact, _, _ = self._first
        self._play = max(kinetic, abs(contact))

    def missing(self, state: Array) -> float:
        """Return the energy from or to nowhere since the start, over the energy in play."""
        parts = energy_parts(state, self._numbers, self._profile, self._table)
        kinetic, potential, contact, lost, work = (
            now - then for now, then in zip(parts, self._first))
        self._play = max(self._play, parts[0], abs(parts[2]), abs(potential), abs(lost),
                         abs(work))
        gap = abs(kinetic + potential + contact + lost - work)
        floor = ROUNDING * sum(map(abs, self._first))
        # A gap that is no number is one without bound.
        return gap / max(self._play, floor) if gap > 0.0 else (0.0 if gap == 0.0 else math.inf)


class OutOfBalance(SimulationError):
    """A run is finite, but energy has come from nowhere or gone there."""


def out_of_balance(time: float, missing: float, model: Any) -> OutOfBalance:
    """Return the error of a run whose energy ledger does not close."""
    solver = model.solver
    way = (f'use a smaller tolerance than {solver.tolerance:g} m'
           if solver.method == 'adaptive' else
           f'use a smaller step than {solver.step:g} s (solver), the adaptive method,')
    return OutOfBalance(
        time, f'the energy ledger misses {100.0 * missing:.3g} % of the energy in play', f'{way} '
        'or softer gains, a softer contact_stiffness or a larger slip_threshold')


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
