# SPDX-License-Identifier: Apache-2.0
"""Sine and cosine of an angle from those of one nearby: within a step they are needed often."""
import math

from ballbot_ros.jit import compiled

# So far the series below are exact to rounding: the short ones, which most steps need, and the
# long ones [rad].
CLOSE, NEARBY = 0.05, 0.5

Direction = tuple[float, float]       # sine and cosine of an angle
Turned = tuple[float, float, float]   # an angle [rad] and its direction


@compiled
def turned_by(angle: float) -> Turned:
    """Return an angle [rad] with its direction."""
    return angle, math.sin(angle), math.cos(angle)


@compiled
def direction_near(angle: float, start: Turned) -> Direction:
    """
    Return sine and cosine of an angle [rad], quickly where it is near one that is known.

    By the series of sine and cosine of the difference, and their theorems of addition.
    """
    known, sine, cosine = start
    ahead = angle - known
    square = ahead * ahead
    # In pairs, which do not wait for each other; the sums that wait for all come last.
    if square < CLOSE * CLOSE:
        bent = (-1 / 6 + square * (1 / 120)) + (square * square) * (-1 / 5040)
        back = (-1 / 2 + square * (1 / 24)) + (square * square) * (
            -1 / 720 + square * (1 / 40320))
    elif square < NEARBY * NEARBY:
        fourth = square * square
        bent = (-1 / 6 + square * (1 / 120)) + fourth * (
            (-1 / 5040 + square * (1 / 362880)) + fourth * (
                -1 / 39916800 + square * (1 / 6227020800)))
        back = (-1 / 2 + square * (1 / 24)) + fourth * (
            (-1 / 720 + square * (1 / 40320)) + fourth * (
                (-1 / 3628800 + square * (1 / 479001600)) + fourth * (-1 / 87178291200)))
    else:
        return math.sin(angle), math.cos(angle)
    along, across = cosine * ahead, sine * ahead
    return ((sine + along) + square * (along * bent + sine * back),
            (cosine - across) + square * (cosine * back - across * bent))
