# SPDX-License-Identifier: Apache-2.0
"""
The verdict on one case.

GOOD      finite, the energy balance closes, and a stricter run agrees at all samples
CHAOTIC   the same up to the horizon that the run reports, or a loop reported as unstable
REFUSED   an error of this package with the quantity and a remedy
UNCONFIRMED   the stricter run exceeds its work budget, and agrees up to that point
WRONG     any other result
"""
from dataclasses import dataclass, replace
import math
import time

from cases import BUDGET, make_case
import numpy as np

from ballbot_ros.control import growth_rate, is_stable
from ballbot_ros.errors import ConfigurationError, SimulationError
from ballbot_ros.physics import simulate, State
from ballbot_ros.physics.model.actuation import Actuator, position_torque, TORQUE, velocity_torque
from ballbot_ros.physics.simulation.run import FINEST_TOLERANCE, run_once

GOOD, CHAOTIC, REFUSED, UNCONFIRMED, WRONG = (
    'good', 'chaotic', 'refused', 'unconfirmed', 'WRONG')
ACCURACY = 1e-4        # asked for, of the radius
RESIDUAL = 0.05        # largest accepted energy residual, that of the package
FIXED = 0.1            # of the radius, and of the path: what fixed steps may be off
STRICTER = 1.0 / 30.0  # times the tolerance, for the run that confirms
SLOW = 30.0  # [s] of processor time: a case that takes longer hangs
LOOP = 1e-3            # times the accuracy: the tolerance of a sampled loop


@dataclass(frozen=True)
class Verdict:
    """What is said of a case."""

    name: str
    seed: int
    verdict: str
    why: str = ''
    residual: float = 0.0  # largest of the run, over the reference energy
    seconds: float = 0.0


def judge(name, seed, make=make_case):
    """Run a case, as it is made, and return the verdict."""
    begin = time.process_time()
    residual = 0.0
    try:
        case = make(name, seed)
        verdict, why, residual = {'accurate': accurate, 'fixed': fixed, 'loop': loop}[
            case.judged](case)
    except SimulationError as error:
        explained = math.isfinite(error.time) and error.quantity and error.remedy
        verdict, why = REFUSED if explained else WRONG, f'{error}'
    except ConfigurationError as error:
        verdict, why = REFUSED, f'{error}'
    except Exception as error:  # noqa: BLE001 - any other kind is what is looked for
        verdict, why = WRONG, f'{type(error).__name__}: {error}'
    seconds = time.process_time() - begin
    if seconds > SLOW:
        verdict, why = WRONG, f'takes {seconds:.0f} s; {why}'
    return Verdict(name, seed, verdict, why, residual, seconds)


def accuracy_of(case):
    """Return the accuracy to be asked for [m]."""
    return min(max(ACCURACY * case.model.robot.ball_radius, 1e-9), 0.1)


def unsound(run):
    """Return what is wrong with a trajectory by itself, and its energy residual."""
    if not np.isfinite(run.rows).all():
        return 'not finite', math.inf
    gap = float(np.max(np.abs(run.energy_residual)))
    gap = gap / run.energy_in_play if gap > 0.0 else 0.0
    return f'energy residual of {100.0 * gap:.3g} %' if not gap <= RESIDUAL else '', gap


def apart(one, other, until):
    """Return the largest distance of two runs up to a time [m]."""
    count = min(len(one), len(other))
    held = one['time'][:count] <= until
    return float(np.max(np.hypot(one['x'][:count] - other['x'][:count],
                                 one['y'][:count] - other['y'][:count])[held]))


def accurate(case):
    """Judge a run that was asked for an accuracy."""
    accuracy, output_step = accuracy_of(case), case.output_step or 0.02 * case.duration
    run = simulate(case.model, case.start, case.actuation, case.duration, output_step,
                   accuracy=accuracy)
    fault, residual = unsound(run)
    if fault:
        return WRONG, fault, residual
    said = run.assurance
    verdict = GOOD if said.complete else CHAOTIC
    if said.tolerance <= FINEST_TOLERANCE:
        return verdict, f'horizon {said.horizon:.3g} s', residual
    strict = replace(case.model, solver=replace(
        case.model.solver_in_use, tolerance=max(FINEST_TOLERANCE, STRICTER * said.tolerance),
        work_budget=10 * case.model.solver_in_use.work_budget))
    why = ''
    try:
        check = simulate(strict, case.start, case.actuation, case.duration, output_step)
    except SimulationError as error:
        verdict, why = UNCONFIRMED, f'a stricter run does not confirm it: {error}'
        if error.reason != 'over_budget':
            return WRONG, why, residual
        check = error.trajectory
    gap = apart(run, check, said.horizon)
    if not gap <= accuracy:
        return WRONG, f'{gap:.3g} m off, said {accuracy:.3g} m', residual
    return verdict, why, residual


def fixed(case):
    """Judge a run with steps of one length against one that was asked for an accuracy."""
    run = simulate(case.model, case.start, case.actuation, case.duration, case.output_step)
    fault, residual = unsound(run)
    if fault:
        return WRONG, fault, residual
    model = replace(case.model, solver=replace(
        case.model.solver_in_use, method='adaptive', work_budget=5 * BUDGET))
    try:
        exact = simulate(model, case.start, case.actuation, case.duration, case.output_step,
                         accuracy=accuracy_of(case))
        horizon = exact.assurance.horizon
    except SimulationError:  # too stiff for it: then much shorter steps have to confirm
        finer = replace(case.model.solver_in_use, step=0.1 * case.model.solver_in_use.step,
                        work_budget=10 * case.model.solver_in_use.work_budget)
        exact = run_once(replace(case.model, solver=finer), case.start, case.actuation,
                         case.duration, case.output_step)
        horizon = case.duration
    length = float(np.sum(np.hypot(np.diff(exact['x']), np.diff(exact['y']))))
    bound = FIXED * max(case.model.robot.ball_radius, length)
    gap = apart(run, exact, horizon)
    if not gap <= bound:
        return WRONG, f'{gap:.3g} m off, bound {bound:.3g} m', residual
    return GOOD if horizon > 0.999 * case.duration else CHAOTIC, '', residual


def sampled(case, tolerance):
    """Return the states at the control periods of a loop."""
    robot, tuning, law = case.model.robot, case.tuning, case.actuation.law
    model = replace(case.model, solver=replace(case.model.solver_in_use, tolerance=tolerance))
    gravity = robot.largest_gravity_torque
    state, states = case.start, [case.start]
    for _ in range(int(case.duration * case.rate)):
        if law == 'position':
            torque = position_torque(
                state.pendulum_angle, state.pendulum_rate, case.actuation.set_angle,
                tuning.position_kp, tuning.position_kd, gravity)
        else:
            torque = velocity_torque(
                state.pendulum_angle, state.joint_rate, 0.0, case.actuation.set_rate,
                tuning.velocity_kp, 0.0, gravity)
        torque = min(max(torque, -tuning.torque_limit), tuning.torque_limit)
        state = model.advance(state, Actuator(TORQUE, torque), 1)
        states.append(state)
    return np.array(states)


def loop(case):
    """
    Judge a law that is closed at a rate; `is_stable` has to say if it diverges.

    It says so of a ball that rolls, and of law (12) with the pendulum hanging.  Where a loop is
    stable then, but slips, flies or swings, two runs may part no more than `growth_rate` explains.
    """
    law = 'hold' if case.actuation.law == 'position' else 'drive'
    stable = is_stable(case.model.robot, case.tuning, law, case.rate)
    accuracy = accuracy_of(case)
    coarse, fine = (
        sampled(case, tolerance * accuracy) for tolerance in (LOOP, LOOP * STRICTER))
    if not np.isfinite(fine).all():
        return WRONG, 'not finite', math.inf
    residual = balance(case.model, fine)
    if not residual <= RESIDUAL:
        return WRONG, f'energy residual of {100.0 * residual:.3g} %', residual
    gaps = np.hypot(*(coarse - fine)[:, 3:5].T)
    if not stable:
        return CHAOTIC, 'the loop is declared unstable', residual
    if np.max(gaps) <= accuracy:
        return GOOD, '', residual
    # The tolerance must grow by this factor; an earlier difference must be explained.
    if amplified(case, law, fine[:np.argmax(gaps > accuracy)]) > math.log(1.0 / LOOP):
        return CHAOTIC, 'the loop is declared unstable where it slips, flies or swings', residual
    return WRONG, f'{np.max(gaps):.3g} m off', residual


def amplified(case, law, states):
    """Return the logarithm of what deviations may have grown by over the states of a loop."""
    robot, total, known = case.model.robot, 0.0, {}
    for state in (State(*row) for row in states.tolist()):
        slip = abs(state.velocity_x + robot.ball_radius * state.ball_rate)
        rolls = state.y < robot.ball_radius and slip < robot.slip_threshold
        # A held pendulum is at its set angle: it counts as stable at any angle.
        angle = 0.0 if law == 'hold' else round(math.remainder(
            state.pendulum_angle, 2.0 * math.pi), 1)
        if (angle, rolls) not in known:
            known[angle, rolls] = max(0.0, growth_rate(
                robot, case.tuning, law, case.rate, 0, (angle,), 0.0, rolls))
        total += known[angle, rolls] / case.rate
    return total


def balance(model, states):
    """Return the largest energy residual over states, over the reference energy."""
    parts = np.array([
        [*model.energies(state), state.dissipated_energy, -state.motor_work]
        for state in (State(*row) for row in states.tolist())])
    parts[:, 1] -= parts[0, 1]
    play = float(np.max(np.abs(parts)))
    gap = float(np.max(np.abs(np.sum(parts, axis=1) - np.sum(parts[0]))))
    return gap / play if gap > 0.0 else 0.0
