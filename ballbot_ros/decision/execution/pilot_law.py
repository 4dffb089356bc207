# SPDX-License-Identifier: Apache-2.0
"""
Compute the set angle of the pendulum from an order and the motion, every 20 ms.

The `Pilot` runs this on the robot, and a rollout runs it in its kernel, so that a plan is executed
as simulated.  All functions are pure and compiled; they use `control.speed_law`.
"""
import math
from typing import NamedTuple

from ballbot_ros.control.speed_law import (
    estimated_slope, FURTHEST, holding_angle, Numbers, place_law_step, speed_law_step, SpeedLaw,
    SpeedState, stopping_speed)
from ballbot_ros.jit import compiled

# The fields of an `Order`.
PlainOrder = tuple[float, float, float, float, float, float, float, float, float, float]

# Lean in addition to the lean that holds the ball on a slope, to move it there [rad].
EXCESS_LEAN = 0.3
# Braking uses the full lean if the speed exceeds the stopping speed by more than this [m/s].
SPEED_EXCESS_MAX = 0.03
# Braking with full lean ends below this speed [m/s].
EASING_SPEED = 0.3


class Order(NamedTuple):
    """Order for the pilot, until the next one; positions along the odometry axis."""

    lean: float  # largest lean [rad]
    emergency_lean: float  # for braking and holding on slopes [rad]
    reaction: float  # delay of a set angle [s]
    forward: float = 0.0  # fastest forward [m/s]
    backward: float = 0.0  # fastest backward to `stop` [m/s]
    # Stop position [m]; infinite for none, -infinite for as soon as possible.
    stop: float = math.inf
    swing: float = math.inf  # start of the swing, from which the speed is not controlled [m]
    swing_angle: float = 0.0  # set angle there [rad]
    edge: float = -math.inf  # end of the swing [m]
    after: float = 0.0  # speed behind the edge [m/s]


@compiled
def enough_lean(position: float, speed: float, slope: float, order: Order,
                law: Numbers) -> float:
    """Return the largest lean for a slope, or for a stop too near for the usual lean [rad]."""
    holding = holding_angle(slope, law)
    if math.isnan(holding):
        return order.emergency_lean
    gap = order.stop - position
    if math.isfinite(gap):
        # In the direction of motion.
        towards = stopping_speed(gap, slope, order.lean, order.reaction, law) if speed > 0.0 \
            else stopping_speed(-gap, -slope, order.lean, order.reaction, law)
        if abs(speed) > towards + SPEED_EXCESS_MAX:
            return order.emergency_lean
    return min(max(order.lean, abs(holding) + EXCESS_LEAN), order.emergency_lean)


@compiled
def pilot_step(state: SpeedState, position: float, speed: float, order: PlainOrder,
               period: float, law: Numbers) -> tuple[SpeedState, float]:
    """
    Return the next state, and the set angle for law (11) [rad]; no pendulum angle is measured.

    Parameters
    ----------
    state : SpeedState
        State of the speed law; see `speed_law_start`.
    position, speed : float
        Position and speed of the centre of the ball [m], [m/s].
    order : PlainOrder
        See `Order`.
    period : float
        Time since the last step [s].
    law : Numbers
        Fields of a `SpeedLaw`.

    """
    own = Order(*order)
    lean = enough_lean(position, speed, estimated_slope(state, law), own, law)
    if own.stop == -math.inf:
        later, set_angle = speed_law_step(
            state, speed, math.nan, 0.0, own.emergency_lean, period, law)
        if abs(speed) > EASING_SPEED:
            # Full lean, without the estimated slope: at an edge the estimate is wrong.
            braking, numbers = -math.copysign(own.emergency_lean, speed), SpeedLaw(*law)
            lead = max(numbers.lag / numbers.swing_time - 1.0, 0.0)
            set_angle = braking + lead * (braking - later.angle) + later.shortfall
            set_angle = min(max(set_angle, -FURTHEST), FURTHEST)
            later = SpeedState(later.speed, later.resistance, later.angle, later.predicted,
                               later.shortfall, set_angle)
    elif math.isfinite(own.stop):
        gap = own.stop - position
        later, set_angle = place_law_step(
            state, speed, math.nan, gap, own.forward if gap > 0.0 else own.backward, lean,
            period, law)
    else:
        set_speed = own.after if -math.inf < own.edge <= position else own.forward
        later, set_angle = speed_law_step(
            state, speed, math.nan, set_speed, lean, period, law)
    if own.swing <= position < own.edge:
        # On the step, its face supports the ball: the estimated slope must not change.
        set_angle = own.swing_angle
        later = SpeedState(speed, state.resistance, later.angle, later.predicted,
                           state.shortfall, set_angle)
    return later, set_angle
