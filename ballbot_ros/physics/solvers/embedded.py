# SPDX-License-Identifier: Apache-2.0
"""
What the one-step methods with an error estimate share: room to work in, error, interpolation.

A method fills the stages, leaves the new state in the row PROBE and the estimated error of each
number in the row RATES, and prepares the coefficients from which `interpolate` reads any state
within the step.
"""
import math
from typing import Any

from ballbot_ros.compiled import compiled
from ballbot_ros.physics.mechanics.equations import (
    BALL_ANGLE, BALL_RATE, drive_torque, PENDULUM_ANGLE, PENDULUM_RATE, SIZE, VELOCITY_Y)

# Rows of the work array: the derivative at the beginning, eight stages at most, a row for what
# a stage needs in between, five coefficients of the dense output, the state that is tried, and
# for an implicit step the derivative of the rates and the inverted matrix.
BEGIN = 0
RATES = 9
DENSE = 10
PROBE = 15
SLOPES = 16
INVERSE = 30
ROWS = 34

# A run can end like this, too: the step has become too small, or the work budget is used up.
STALLED, SPENT = 3, 4

SMALLEST_STEP = 1e-14  # [s], relative to times above 1 s
MEMORY = 0.01  # [s]: an error of velocity counts at least with this
STABLE = 3.3  # step times rate of the fastest decay where explicit steps begin to diverge


@compiled
def error_length(errors: Any, robot: Any) -> float:
    """
    Return estimated errors of a state as one length, at the rim of the ball [m].

    Angles count with the radius; velocities with the time that a contact lasts, in which an
    error of velocity becomes one of position, and not less after a hard contact.
    """
    duration = max(MEMORY, math.sqrt(robot.mass / robot.stiffness))
    worst = 0.0
    for i in range(VELOCITY_Y + 1):
        part = abs(errors[i]) * (duration if i >= BALL_RATE else 1.0)
        if i in (BALL_ANGLE, PENDULUM_ANGLE, BALL_RATE, PENDULUM_RATE):
            part *= robot.radius
        if not part < math.inf:
            return math.inf  # max() would lose a NaN
        worst = max(worst, part)
    return worst


@compiled
def add_rows(count: int, factors: Any, scale: float, rows: Any, out: Any) -> None:
    """
    Add ``scale * sum(factors[k] * rows[k])`` over the first `count` rows (1 to 7) to `out`.

    A branch for each number of rows: with a loop over them inside the loop over the numbers,
    the sums of a step take as long as all of its mechanics.
    """
    f, w = factors, rows
    if count == 1:
        for i in range(SIZE):
            out[i] += scale * f[0] * w[0, i]
    elif count == 2:
        for i in range(SIZE):
            out[i] += scale * (f[0] * w[0, i] + f[1] * w[1, i])
    elif count == 3:
        for i in range(SIZE):
            out[i] += scale * (f[0] * w[0, i] + f[1] * w[1, i] + f[2] * w[2, i])
    elif count == 4:
        for i in range(SIZE):
            out[i] += scale * (f[0] * w[0, i] + f[1] * w[1, i] + f[2] * w[2, i] + f[3] * w[3, i])
    elif count == 5:
        for i in range(SIZE):
            out[i] += scale * (f[0] * w[0, i] + f[1] * w[1, i] + f[2] * w[2, i] + f[3] * w[3, i]
                + f[4] * w[4, i])
    elif count == 6:
        for i in range(SIZE):
            out[i] += scale * (f[0] * w[0, i] + f[1] * w[1, i] + f[2] * w[2, i] + f[3] * w[3, i]
                + f[4] * w[4, i] + f[5] * w[5, i])
    elif count == 7:
        for i in range(SIZE):
            out[i] += scale * (f[0] * w[0, i] + f[1] * w[1, i] + f[2] * w[2, i] + f[3] * w[3, i]
                + f[4] * w[4, i] + f[5] * w[5, i] + f[6] * w[6, i])


@compiled
def interpolate(part: float, work: Any, out: Any) -> None:
    """Write the state at `part` (0 to 1) of the last step into `out`."""
    rest = 1.0 - part
    for i in range(SIZE):
        out[i] = work[DENSE, i] + part * (work[DENSE + 1, i] + rest * (
            work[DENSE + 2, i] + part * (work[DENSE + 3, i] + rest * work[DENSE + 4, i])))


@compiled
def write_rows(rows: Any, filled: int, begin: float, interval: float, time: float, used: float,
               reached: float, drive: Any, work: Any, probe: Any) -> int:
    """Fill the rows whose time the last step has passed, and return how many are filled."""
    while filled < len(rows) and begin + (filled + 1) * interval <= reached:
        moment = begin + (filled + 1) * interval
        interpolate(min((moment - time) / used, 1.0), work, probe)
        rows[filled, 0] = moment
        for i in range(SIZE):
            rows[filled, 1 + i] = probe[i]
        rows[filled, 1 + SIZE] = drive_torque(moment, probe, drive)
        filled += 1
    return filled
