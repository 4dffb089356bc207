# SPDX-License-Identifier: Apache-2.0
"""
Adaptive integration that locates every kink of the contact law.

Steps are chosen by the estimated local error.  Each is taken with a frozen mode (see `modes`);
where the mode ends within the step, the end is located on the dense output and the next step
starts there in the new mode.  So the order is preserved through impacts, lift-offs and the onset
of slip, unlike with fixed steps.

It has three parts, a file each: a *step* (`dormand_prince`, `rodas5p`), the *controller* of step
size and method, and *events*.  Where the ground exerts no force and the law of the motor has a
closed form, the ball flies to its next touch in one step without error (`flight`).
"""
import math

from ballbot_ros.jit import compiled, outlined
from ballbot_ros.physics.mechanics.contact import ContactMode, features_within
from ballbot_ros.physics.mechanics.equations import System
from ballbot_ros.physics.mechanics.modes import contact_count, find_mode, smooth_contacts
from ballbot_ros.physics.model.robot import Parameters
from ballbot_ros.physics.model.state import X
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.solvers import dormand_prince, values
from ballbot_ros.physics.solvers.controller import (
    accepted, after_event, chosen, clear_distance, DAMPS, end_step, error_length,
    FASTEST_SHRINKING, prepare_dense, rejected, shortened, shortest, smallest_step, started, step,
    stiffness_seen, unavoidable, with_step)
from ballbot_ros.physics.solvers.dense import interpolate, motion_at, prepare_ledger, write_rows
from ballbot_ros.physics.solvers.events import CROWD, first_event, LOOKS, rated, STUCK
from ballbot_ros.physics.solvers.flight import (
    fly_to_touch, has_closed_form, is_released, SHORT_FLIGHT)
from ballbot_ros.physics.solvers.values import (
    AUTOMATIC, BUDGET_EXCEEDED, EVALUATIONS, EventRate, EVENTS, FINISHED, MOTION, NOT_FINITE,
    NOTHING, Options, outcome_of, Output, Packed, packed, PAUSED, REJECTED, SEARCH, Status,
    STEP_TOO_SMALL, STEPS, unpack_call, WIDTH, Workspace)

STAGES = dormand_prince.STAGES  # right-hand sides of an explicit step
PASSED = 100.0      # deviation of a step from its initial rates that is accepted [tolerances]
FREE_FEATURES = 32  # of the ground: a search among that many counts as one right-hand side


@compiled
def too_small(error: float, method: int, mode: ContactMode) -> int:
    """Return the outcome of a run below its smallest step, FINISHED if it can continue."""
    if error == math.inf:
        return NOT_FINITE
    damps = smooth_contacts(mode) and (method == AUTOMATIC or DAMPS[method])
    return FINISHED if damps else STEP_TOO_SMALL


@outlined
def skips_transient(used: float, smallest: float, tolerance: float, parameters: Parameters,
                    workspace: Workspace) -> bool:
    """
    Return whether to repeat a step [s] that contains an event with a shorter step.

    L-stable steps may skip a fast transient and still end correctly; then the dense output does
    not start with the initial rates, and its event times are wrong.
    """
    work, statistics, dense = workspace.work, workspace.statistics, values.DENSE
    for i in range(MOTION):
        work[values.ERROR + i] = (work[dense + WIDTH + i] + work[dense + 2 * WIDTH + i]
                                  - used * work[values.F0 + i])
    if used <= smallest or error_length(
            work[values.ERROR:], parameters) <= PASSED * tolerance:
        return False
    statistics[STEPS] -= 1
    statistics[REJECTED] += 1
    return True


@compiled
def find_event(time: float, state: Array, used: float, distance: float, system: System,
               workspace: Workspace) -> float:
    """Return theta of the first event within a step; see `events.first_event`."""
    first, behind = features_within(
        state[X], system.parameters.radius + distance, system.ground)
    workspace.statistics[SEARCH] += (
        STAGES * contact_count(workspace.mode) + LOOKS * (behind - first)) // FREE_FEATURES
    return first_event(time, used, first, behind, system, workspace)


@compiled
def write_end(theta: float, state: Array, number: int, workspace: Workspace,
              ledger: bool) -> int:
    """Write the state at the end of a step, or at the event in it; return the valid data."""
    work = workspace.work
    if ledger:
        interpolate(min(theta, 1.0), work, state)
    if theta <= 1.0:
        motion_at(theta, work)
        for i in range(MOTION):
            state[i] = work[values.PROBE + i]
        workspace.statistics[EVENTS] += 1
        return NOTHING
    for i in range(MOTION):
        state[i] = work[values.END + i]
    return end_step(number, workspace)


@compiled
def integrate(status: Status, end: float, state: Array, system: System, options: Options,
              output: Output, workspace: Workspace) -> Status:
    """Advance a state as `advance` does, inlined in the calling kernel without unused parts."""
    parameters, ground, statistics = system.parameters, system.ground, workspace.statistics
    time, filled, controller, rate = status.time, status.filled, status.controller, status.rate
    has_mode, may_fly, again = status.has_mode, status.may_fly, False
    ready = status.ready if has_mode else NOTHING
    flies, outcome = options.flight and has_closed_form(parameters, system.actuator), FINISHED
    while time < end and outcome == FINISHED:
        if filled >= output.pause:
            outcome = PAUSED
            break
        if not has_mode:
            count = find_mode(time, state, system, workspace.mode)
            if flies and may_fly and is_released(workspace.mode, parameters):
                landed, filled = fly_to_touch(
                    time, state, end, system, output, filled, options.ledger, workspace)
                if landed > time or count == 0:
                    may_fly, time = landed - time >= SHORT_FLIGHT, landed
                    continue
            controller = started(controller, count, options.method, parameters)
            rate, has_mode = EventRate(0, 0, 0), True
        if statistics[EVALUATIONS] + statistics[SEARCH] >= options.budget:
            outcome = BUDGET_EXCEEDED
            break
        smallest, distance = smallest_step(time), clear_distance(state[X], parameters, ground)
        used = shortened(min(max(controller.step, smallest), end - time), state, distance,
                         contact_count(workspace.mode), parameters, ground)
        number = chosen(controller, options.method, smooth_contacts(workspace.mode))
        stiffness, ready = step(number, time, state, used, ready, system, workspace)
        controller = stiffness_seen(controller, stiffness, number)
        error = error_length(workspace.work[values.ERROR:], parameters)
        if not (error <= options.tolerance or unavoidable(used, smallest, number, error)):
            statistics[REJECTED] += 1
            again, on_trial = True, controller.on_trial
            controller = rejected(controller, used, error, options.tolerance)
            if controller.step < smallest and not on_trial:
                outcome = too_small(error, options.method, workspace.mode)
                if outcome != FINISHED:
                    break
                controller = shortest(controller, smallest)
            continue
        statistics[STEPS] += 1
        controller = accepted(controller, used, error, number, stiffness, again, options)
        prepare_dense(number, used, workspace)
        if options.ledger:
            prepare_ledger(time, state, used, system, workspace)
        theta = find_event(time, state, used, distance, system, workspace)
        again = theta <= 1.0 and skips_transient(
            used, smallest, options.tolerance, parameters, workspace)
        if again:
            controller = shortest(controller, FASTEST_SHRINKING * used)
            continue
        rate, theta = rated(rate, theta, time, used)
        reached = min(time + used, end) if theta > 1.0 else time + theta * used
        filled = write_rows(
            output, filled, time, used, reached + smallest, system.actuator, workspace)
        ready = write_end(theta, state, number, workspace, options.ledger)
        if rate.crowded > CROWD:  # a long step does not resolve the events
            controller = with_step(controller, 0.5 * used)
        outcome = outcome_of(state, ground) if rate.stuck <= STUCK else STEP_TOO_SMALL
        time = end if end - reached < smallest else reached
        if outcome == FINISHED and theta <= 1.0:
            count = find_mode(time, state, system, workspace.mode)
            controller = after_event(controller, used, count, options.method, parameters)
            may_fly = may_fly or count > 0
            has_mode = not (flies and may_fly and is_released(workspace.mode, parameters))
    return Status(outcome, time, filled, controller, rate, has_mode, ready, may_fly, 0.0)


@outlined
def advance(call: Packed) -> Packed:
    """Advance a state in place; see the contract in `solvers`."""
    return packed(integrate(*unpack_call(call)))
