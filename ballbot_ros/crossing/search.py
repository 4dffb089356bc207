# SPDX-License-Identifier: Apache-2.0
"""
The compiled search for the maximum step height; see `max_step_height` for its use.

It assumes that the ball crosses every step below one that it crosses.
"""
from ballbot_ros.crossing.attempt import attempt, Crossing, LEAST, OVER
from ballbot_ros.jit import compiled, unlocked
from ballbot_ros.physics.solvers.values import FINISHED

# Ends of a bracket, their scores, and the outcome.
Bracket = tuple[float, float, float, float, int]

# The error is twice the width of the bracket; local errors of a step over that width.
WIDTH = 0.5
COARSE, FINE = 1e-1, 1e-2
REFINEMENT = 0.03  # of the tolerances, where both do not agree
FINEST = 1e-13  # tolerance that still means something [m]

# Where the scores point, and a little more: too high a step is wanted, and as near as can be.
BEYOND = 1.02
HIGHEST = 4.0  # step that is tried, over the radius
TOO_FAST = -1  # outcome of a search that finds no step too high, beside those of a run


@compiled
def narrow(low: float, high: float, above: float, below: float, width: float,
           tolerance: float, crossing: Crossing) -> tuple[float, float, int]:
    """
    Narrow a bracket to a width.

    Regula falsi, Illinois variant, with ever longer steps where that is slow.

    Parameters
    ----------
    low, high : float
        A step that is passed, and one that is not [m].
    above, below : float
        Their scores.
    width : float
        [m]

    Returns
    -------
    low, high, outcome
        FINISHED, or how the run ended that could not go on.

    """
    side, reach = 0, 0.9 * width
    while high - low > width:
        gap = high - low
        trial = low + 0.5 * gap
        if gap > 2.0 * reach:
            aimed = low + gap * above / (above - below)
            trial = min(max(aimed, low + reach), high - reach)
        verdict, score, outcome = attempt(trial, tolerance, crossing)
        if outcome != FINISHED:
            return low, high, outcome
        now = 1 if verdict == OVER else -1
        # On the same side again: the far end weighs less. One that was kept a reach away from
        # its end and is on its side yet: the next one goes farther.
        again, side = now == side, now
        short = trial == low + reach if now > 0 else trial == high - reach
        reach = 4.0 * reach if short else 0.9 * width
        if now > 0:
            low, above = trial, score
            below *= 0.5 if again else 1.0
        else:
            high, below = trial, score
            above *= 0.5 if again else 1.0
    return low, high, FINISHED


@compiled
def climb(low: float, above: float, stride: float, tolerance: float,
          crossing: Crossing) -> Bracket:
    """
    Raise the step from a passed one until it is too high.

    Parameters
    ----------
    stride : float
        The first one [m]; the next ones go where the scores point.

    Returns
    -------
    low, high, above, below, outcome
        As of `narrow`; `outcome` may be TOO_FAST.

    """
    least, highest = 0.02 * stride, HIGHEST * crossing.system.parameters.radius
    while True:
        high = min(low + stride, highest)
        verdict, score, outcome = attempt(high, tolerance, crossing)
        if outcome != FINISHED or verdict != OVER:
            return low, high, above, score, outcome
        if high >= highest:
            return low, high, above, score, TOO_FAST
        aimed = BEYOND * stride * score / max(above - score, LEAST)
        low, above = high, score
        stride = max(min(aimed, 4.0 * stride), least)
        least *= 4.0


@compiled
def descend(high: float, below: float, stride: float, tolerance: float,
            crossing: Crossing) -> Bracket:
    """Lower the step from one that is too high until it is passed; returns as `climb` does."""
    while True:
        low = max(high - stride, 0.0)
        if low == 0.0:
            return low, high, crossing.course.speed**2, below, FINISHED
        verdict, score, outcome = attempt(low, tolerance, crossing)
        if outcome != FINISHED or verdict == OVER:
            return low, high, score, below, outcome
        high, below, stride = low, score, 2.0 * stride


@unlocked
def search(width: float, coarse: float, fine: float, guess: float,
           crossing: Crossing) -> Bracket:
    """
    Bracket the highest step with a coarse tolerance and confirm both ends with a fine one.

    Returns
    -------
    low, high : float
        A step that is passed with the fine tolerance, and one that is not [m].
    lowest, highest : float
        Between these is also what the coarse tolerance finds [m].
    outcome : int
        See `narrow` and `climb`.

    """
    low, high, above, below, outcome = climb(
        0.0, crossing.course.speed**2, guess, coarse, crossing)
    if outcome == FINISHED:
        low, high, outcome = narrow(low, high, above, below, width, coarse, crossing)
    lowest, highest = low, high
    if outcome != FINISHED:
        return low, high, lowest, highest, outcome
    # A fine tolerance may move the highest step out of the bracket: then follow it.
    verdict, above = OVER, crossing.course.speed**2
    if low > 0.0:
        verdict, above, outcome = attempt(low, fine, crossing)
    if outcome == FINISHED and verdict == OVER:
        low, high, above, below, outcome = climb(low, above, high - low, fine, crossing)
    elif outcome == FINISHED:
        low, high, above, below, outcome = descend(low, above, width, fine, crossing)
    if outcome == FINISHED:
        low, high, outcome = narrow(low, high, above, below, width, fine, crossing)
    return low, high, min(low, lowest), max(high, highest), outcome


@unlocked
def find(accuracy: float, crossing: Crossing) -> Bracket:
    """
    Bracket the highest step to an accuracy [m], with tolerances as fine as that takes.

    Returns
    -------
    low, high : float
        See `search`.
    error : float
        Above the accuracy where even the finest tolerances do not agree [m].
    tolerance : float
        The finest that it took [m].
    outcome : int
        See `search`.

    """
    width = WIDTH * accuracy
    coarse, fine = COARSE * width, FINE * width
    robot, speed = crossing.system.parameters, crossing.course.speed
    # All energy gone into height; what is higher than the centre is a wall.
    guess = min(speed * speed / (2.0 * robot.gravity), 0.5 * robot.radius)
    while True:
        low, high, lowest, highest, outcome = search(width, coarse, fine, guess, crossing)
        error = (high - low) + (highest - lowest)
        if outcome != FINISHED or error <= accuracy or fine <= FINEST:
            return low, high, error, fine, outcome
        coarse, fine = fine, max(REFINEMENT * fine, FINEST)
