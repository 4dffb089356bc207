# SPDX-License-Identifier: Apache-2.0
"""
Step size control and choice of the method, as an immutable value.

Two methods of order 5 alternate.  The explicit one is much cheaper while accuracy limits the
step; where stability limits it, because friction or a contact is stiff, an L-stable implicit one
takes longer steps.  The steps themselves detect stiffness: a mode with a contact starts with
implicit steps, whose Jacobian shows whether they pay off; the last stages of the explicit method
show when it is at its stability limit, and then an occasional implicit step is tried.
"""
import math

import numpy as np

from ballbot_ros.jit import by_number, compiled
from ballbot_ros.physics.mechanics.contact import first_segment
from ballbot_ros.physics.model.robot import Parameters
from ballbot_ros.physics.model.state import (
    BALL_ANGLE, BALL_RATE, PENDULUM_ANGLE, PENDULUM_RATE, VELOCITY_X, VELOCITY_Y, X)
from ballbot_ros.physics.model.terrain import Array, TANGENT_X, TANGENT_Y, VERTEX_X
from ballbot_ros.physics.solvers import dormand_prince, rodas5p
from ballbot_ros.physics.solvers.values import AUTOMATIC, Options, SMALLEST_STEP, StepController

FIRST_STEP = 1e-4       # [s]
LONGEST_STEP = 0.25     # [s]: does not skip a motion that starts from rest
LONG_STEP_GROWTH = 1.5       # growth limit of longer steps: does not skip a later motion
LARGEST_DISTANCE = 0.25  # radii per step, more on empty ground: does not skip a feature
UNLIMITED_DISTANCE = 1e6               # radii per step on an infinite floor

REPEATED = 0.9          # additional safety factor of a step that was rejected
SAFETY = 0.9            # relative to the step that would just be accurate enough
FASTEST_GROWTH, FASTEST_SHRINKING = 5.0, 0.1  # of a step
MEMORY = 0.01           # [s]: minimum time by which errors of velocity are multiplied

AT_LIMIT = 0.6          # stiffness from which stability limits an explicit step
STEADY = 1.0            # stiffness to which an explicit step grows: a longer one is rejected
STIFFNESS_COUNT = 8           # of a step at AT_LIMIT, less in proportion for a shorter step
# Cost of an implicit step in explicit steps; with 0.5, runs took 3 % less time, but three more of
# 200,011 extreme runs were wrong.
IMPLICIT_COST = 1.4
FIRST_TRIAL, LAST_TRIAL = 16, 256  # stiffness count that triggers an implicit step
BITS_OF_ONE = 0x3FF0000000000000  # the bits of the floating-point number 1, as an integer

# The steps of the adaptive method, see `physics.solvers`.  To add one, add its file, and its name
# here, which is also that of the method that takes only this step.
STEP_METHODS = {'explicit': dormand_prince, 'implicit': rodas5p}
EXPLICIT, IMPLICIT = range(2)  # between which the method `adaptive` alternates
DAMPS = np.array([item.DAMPS for item in STEP_METHODS.values()])

step = by_number('step', STEP_METHODS.values())
prepare_dense = by_number('prepare_dense', STEP_METHODS.values())
end_step = by_number('end_step', STEP_METHODS.values())


@compiled
def error_length(errors: Array, parameters: Parameters) -> float:
    """
    Return estimated errors of a state as one length, at the rim of the ball [m].

    Angles are multiplied by the radius; velocities by the contact duration, in which an error of
    velocity becomes one of position, but at least by `MEMORY`.
    """
    duration = max(MEMORY, contact_step(parameters))
    worst, total = 0.0, 0.0
    for i in range(VELOCITY_Y + 1):
        length = abs(errors[i]) * (duration if i >= BALL_RATE else 1.0)
        if i in (BALL_ANGLE, PENDULUM_ANGLE, BALL_RATE, PENDULUM_RATE):
            length *= parameters.radius
        total += length
        worst = max(worst, length)
    return worst if total < math.inf else math.inf  # max() would ignore a NaN


@compiled
def smallest_step(time: float) -> float:
    """Return the smallest useful step [s]."""
    return SMALLEST_STEP * max(1.0, abs(time))


@compiled
def time_width(time: float) -> float:
    """Return the time resolution of events [s]; for long runs, that of rounding."""
    return max(1e-13, 4e-16 * time)


@compiled
def clear_distance(x: float, parameters: Parameters, ground: Array) -> float:
    """Return how far along the ground the ball may move in a step, skipping no feature [m]."""
    nearest = UNLIMITED_DISTANCE * parameters.radius
    segment = first_segment(ground, x)
    if segment > 0:
        nearest = x - ground[segment, VERTEX_X]
    if segment < len(ground) - 2:
        nearest = min(nearest, ground[segment + 1, VERTEX_X] - x)
    return max(LARGEST_DISTANCE * parameters.radius, 0.5 * (nearest - 2.0 * parameters.radius))


@compiled
def time_for(distance: float, speed: float, gravity: float) -> float:
    """Return the minimum time for a distance, for a ball that may fall meanwhile [s]."""
    return 2.0 * distance / (speed + math.sqrt(speed * speed + 2.0 * gravity * distance))


@compiled
def shortened(step: float, state: Array, distance: float, count: int, parameters: Parameters,
              ground: Array) -> float:
    """
    Return a step [s], limited to the longest one that misses no contact.

    The ball may move by `distance` along the ground, but towards it only by a fraction of its
    radius.  A ball without contact (`count` is 0) falls: a ball of a millimetre by more than its
    radius in 20 ms.
    """
    segment = first_segment(ground, state[X])
    tangent_x, tangent_y = ground[segment, TANGENT_X], ground[segment, TANGENT_Y]
    along = abs(state[VELOCITY_X] * tangent_x + state[VELOCITY_Y] * tangent_y) + 1e-3
    across = abs(state[VELOCITY_Y] * tangent_x - state[VELOCITY_X] * tangent_y) + 1e-3
    near, falling = LARGEST_DISTANCE * parameters.radius, parameters.gravity if count == 0 else 0.0
    if step * (along + 0.5 * parameters.gravity * step) > distance:
        step = min(step, time_for(distance, along, parameters.gravity))
    if step * (across + 0.5 * falling * step) > near:
        step = min(step, time_for(near, across, falling))
    return step


@compiled
def chosen(now: StepController, method: int, smooth: bool) -> int:
    """
    Return the number of the next step in `STEP_METHODS`, for a method of `Options`.

    One that damps uses a Jacobian, which is complete only if all contacts are `smooth`.
    """
    number = method
    if method == AUTOMATIC:
        number = IMPLICIT if now.implicit or now.on_trial else EXPLICIT
    return number if smooth or not DAMPS[number] else EXPLICIT


@compiled
def started(controller: StepController, count: int, method: int,
            parameters: Parameters) -> StepController:
    """Return the controller at a start, on resuming, or on landing, for `count` contacts."""
    if controller.step > 0.0:
        longest = contact_step(parameters) if count > 0 else math.inf
        return with_step(controller, min(controller.step, longest))
    implicit = count > 0 if method == AUTOMATIC else DAMPS[method]
    step = FIRST_STEP
    if implicit and count > 0:
        step = max(step, min(MEMORY, contact_step(parameters)))
    return StepController(step, implicit, False, step, 0, FIRST_TRIAL)


@compiled
def contact_step(parameters: Parameters) -> float:
    """Return the first step of a contact, its duration over 2 pi [s]."""
    return math.sqrt(parameters.mass / parameters.stiffness)


@compiled
def with_step(now: StepController, step: float) -> StepController:
    """Return the controller with another step [s]."""
    return StepController(step, now.implicit, now.on_trial, now.explicit_step, now.stiff_steps,
                          now.trial_after)


@compiled
def stiffness_seen(now: StepController, stiffness: float, number: int) -> StepController:
    """
    Return the controller after a step, accurate enough or not.

    `stiffness` is the ratio of the step to the longest stable one.  Stiffness also disturbs the
    estimated error of an explicit step, and may keep the steps well below the limit.
    """
    if DAMPS[number]:
        return now
    suspicion = STIFFNESS_COUNT if stiffness > AT_LIMIT else 0
    if 0.0 < stiffness <= AT_LIMIT:  # not NaN
        suspicion = int(STIFFNESS_COUNT * stiffness / AT_LIMIT)
    return StepController(now.step, now.implicit, now.on_trial, now.explicit_step,
                          now.stiff_steps + suspicion, now.trial_after)


@compiled
def fifth_root(number: float) -> float:
    """
    Return the fifth root of a positive number, at most 0.7 % too large.

    Read as an integer, a floating-point number is about linear in its logarithm: a fifth of that
    is a first guess, which one step of Newton's method improves.
    """
    bits = np.float64(number).view(np.int64)
    guess = np.int64(bits // 5 + (BITS_OF_ONE - BITS_OF_ONE // 5)).view(np.float64)
    square = guess * guess
    return 0.8 * guess + 0.2 * number / (square * square)


@compiled
def rejected(now: StepController, used: float, error: float, tolerance: float) -> StepController:
    """Return the controller after a step [s] that was not accurate enough."""
    if now.on_trial:
        return StepController(now.explicit_step, now.implicit, False, now.explicit_step,
                              now.stiff_steps, min(2 * now.trial_after, LAST_TRIAL))
    # The error is not finite: try a much shorter step.
    shrink = FASTEST_SHRINKING
    if math.isfinite(error):
        shrink = max(FASTEST_SHRINKING,
                     REPEATED * SAFETY * fifth_root(tolerance / error))
    return with_step(now, used * shrink)


@compiled
def shortest(now: StepController, smallest: float) -> StepController:
    """Return the controller whose next step is the smallest possible [s], and implicit."""
    return StepController(smallest, True, False, smallest, now.stiff_steps, now.trial_after)


@compiled
def unavoidable(used: float, smallest: float, number: int, error: float) -> bool:
    """
    Return whether to accept a step [s] of insufficient accuracy, as no shorter one is possible.

    After an impact the slip passes its threshold in less than the resolution of time.  An
    L-stable step reaches the state after that; the error affects only an instant.
    """
    return DAMPS[number] and used <= smallest and error < math.inf


@compiled
def next_step(now: StepController, used: float, grow: float) -> float:
    """Return the step to try after one that was accepted [s]."""
    # A step shortened by the end, or by the limit, contains little information about the next one.
    step = max(now.step, used * grow) if used < now.step else used * grow
    return min(step, max(LONGEST_STEP, LONG_STEP_GROWTH * used))


@compiled
def accepted(now: StepController, used: float, error: float, number: int, stiffness: float,
             again: bool, options: Options) -> StepController:
    """
    Return the controller after a step that was accurate enough.

    Parameters
    ----------
    used : float
        The step [s].
    error : float
        Its estimated error [m].
    number : int
        See `chosen`.
    stiffness : float
        Ratio of the step to the longest stable explicit one.
    again : bool
        Whether a longer step was rejected before.

    """
    grow = FASTEST_GROWTH
    if error > 0.0:
        grow = min(grow, SAFETY * fifth_root(options.tolerance / error))
    if again:
        grow = min(grow, 1.0)
    elif not (DAMPS[number] or stiffness <= STEADY / FASTEST_GROWTH):
        # An explicit step grows no further than to the longest stable one.
        grow = min(grow, max(1.0, STEADY / stiffness))
    step = next_step(now, used, grow)
    if options.method != AUTOMATIC:
        return with_step(now, step)
    if not DAMPS[number]:
        if now.stiff_steps < now.trial_after:
            return with_step(now, step)
        return StepController(step * (1.5 * IMPLICIT_COST), now.implicit, True, step, 0,
                              now.trial_after)
    # Implicit steps continue while they are longer than explicit ones by more than their cost.
    # While the step still grows at the limit, this cannot be decided yet.
    if grow == FASTEST_GROWTH or step * stiffness > IMPLICIT_COST * used:
        return StepController(step, True, False, now.explicit_step, now.stiff_steps,
                              FIRST_TRIAL)
    return StepController(min(step, now.explicit_step), False, False, now.explicit_step,
                          now.stiff_steps, min(2 * now.trial_after, LAST_TRIAL))


@compiled
def after_event(now: StepController, used: float, count: int, method: int,
                parameters: Parameters) -> StepController:
    """
    Return the controller at the start of a mode with `count` contacts.

    The step that ended at the event [s] is only an upper bound of the next one: a new contact
    changes the motion within the contact duration.
    """
    step = min(now.step, LONGEST_STEP)
    if count > 0:
        step = min(step, max(used, contact_step(parameters)))
    now = with_step(now, step)
    if method != AUTOMATIC or count == 0:
        return now
    # Explicit steps would excite a stiff contact before they detect its stiffness.
    return StepController(now.step, True, now.on_trial, now.step, now.stiff_steps, now.trial_after)
