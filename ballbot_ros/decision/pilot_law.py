# SPDX-License-Identifier: Apache-2.0
"""
From an order and the motion to the set angle of the pendulum: what the ball does every 20 ms.

The `Pilot` runs this on the robot, a rollout inside its kernel; so a plan is tried as it will be
driven.  All functions are pure and compiled; see `control.speed_law` for the law below them.
"""
import math
from typing import NamedTuple

from ballbot_ros.compiled import compiled
from ballbot_ros.control.speed_law import (
    estimated_slope, holding_angle, Numbers, speed_law_step, SpeedState, stopping_speed)

# The numbers of an `Order`.
PlainOrder = tuple[float, float, float, float, float, float, float, float, float, float]

# More lean than what holds a slope, so that the ball can be moved there, too [rad].
BEYOND_HOLDING = 0.3

# Faster than this above what stops in time, braking takes all the lean there is [m/s].
TOO_FAST = 0.03


class Order(NamedTuple):
    """What to do until further notice; positions along the odometry axis."""

    forward: float = 0.0  # fastest forward [m/s]
    backward: float = 0.0  # fastest backward [m/s]
    stop: float = math.inf  # where to stand [m]; infinite for nowhere
    swing: float = math.inf  # where the pendulum swings, and the speed does not matter [m]
    swing_angle: float = 0.0  # set angle there [rad]
    edge: float = -math.inf  # where the swing ends [m]
    after: float = 0.0  # speed behind the edge [m/s]
    lean: float = 0.7  # largest lean [rad]
    emergency_lean: float = 1.4  # to brake with and to hold slopes [rad]
    reaction: float = 0.1  # until a set angle acts, beside the lag of law (11) [s]


@compiled
def allowed_speed(position: float, slope: float, order: Order, law: Numbers) -> float:
    """Return the speed to drive at where the ball is, negative for backwards [m/s]."""
    forward = order.forward if position < order.edge or order.edge == -math.inf else order.after
    if not math.isfinite(order.stop):
        return forward
    gap = order.stop - position
    if gap >= 0.0:
        return min(forward, stopping_speed(gap, slope, order.lean, order.reaction, law))
    return -min(order.backward, stopping_speed(-gap, -slope, order.lean, order.reaction, law))


@compiled
def pilot_step(state: SpeedState, position: float, speed: float, pendulum_angle: float,
               order: PlainOrder, period: float, law: Numbers) -> tuple[SpeedState, float]:
    """
    Return the next state, and the set angle for law (11) [rad].

    Parameters
    ----------
    state : SpeedState
        Of the speed law; see `speed_law_start`.
    position, speed : float
        Of the centre of the ball [m], [m/s].
    pendulum_angle : float
        Absolute [rad], NaN where it is not measured.
    order : PlainOrder
        See `Order`.
    period : float
        Since the last step [s].
    law : Numbers
        Of a `SpeedLaw`.

    """
    own = Order(*order)
    slope = estimated_slope(state, law)
    set_speed = allowed_speed(position, slope, own, law)
    lean = own.lean
    holding = holding_angle(slope, law)
    if math.isnan(holding) or math.isfinite(own.stop) and abs(speed) > abs(set_speed) + TOO_FAST:
        lean = own.emergency_lean
    else:
        lean = min(max(lean, abs(holding) + BEYOND_HOLDING), own.emergency_lean)
    later, set_angle = speed_law_step(state, speed, pendulum_angle, set_speed, lean, period, law)
    if own.swing <= position < own.edge:
        # On the step the ball is held up by its face: that is no slope.
        set_angle = own.swing_angle
        later = (speed, state[1], later[2], later[3], state[4], set_angle)
    return later, set_angle
