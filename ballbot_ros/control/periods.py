# SPDX-License-Identifier: Apache-2.0
"""
Many control periods at once: law (11) sampled and held, the motor's line, the full model.

The same as a `plant.Plant` that a `PendulumController` drives, to the bit, but in one call into
compiled code: a study of the closed loop runs the ten periods between two observations in it.
"""
import math
from typing import Tuple

from ballbot_ros.jit import compiled, unlocked
from ballbot_ros.physics.mechanics.laws import available_torque, limited, position_torque
from ballbot_ros.physics.model.parameters import Actuator, Parameters, System, TORQUE
from ballbot_ros.physics.model.state import (
    BALL_RATE, PENDULUM_ANGLE, PENDULUM_RATE, VELOCITY_X, X, Y)
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.solvers.integrate import integrate
from ballbot_ros.physics.solvers.values import (
    FINISHED, Options, Output, PackedWorkspace, status_at, unpacked)

# Number of the first period, how many, length of each [s].
Span = Tuple[int, int, float]
# Set angle [rad], more of it per missing speed [rad s/m], set speed [m/s], largest such angle
# [rad]; from which position on [m] there is another set angle [rad].
Script = Tuple[float, float, float, float, float, float]
# Gains of law (11), gravity torque and torque limit; then the four of `Robot.motor_line`.
Drive = Tuple[float, float, float, float, float, float, float, float]

# Columns of what is watched, a row for each straight piece of a face: both ends [m], whether it
# is touched, horizontal speed towards it at the last touch [m/s], and the period after which.
AX, AY, BX, BY, TOUCHED, TOUCH_SPEED, TOUCH_PERIOD = range(7)

APART = 0.03  # a ball that was farther off than this touches anew [m]


# Which periods, set angles, law and motor, system, options, state (13,), what is watched (n, 7),
# output without rows, workspace.
Call = Tuple[Span, Script, Drive, Tuple[Tuple[float, ...], Array],
             Tuple[float, float, int, int, bool, bool], Array, Array,
             Tuple[Array, float, float, int], PackedWorkspace]


@compiled
def gap_to(piece: Array, x: float, y: float) -> Tuple[float, bool]:
    """Return how far a point is from a piece of a face [m], and whether on its lower side."""
    along_x, along_y = piece[BX] - piece[AX], piece[BY] - piece[AY]
    share = ((x - piece[AX]) * along_x + (y - piece[AY]) * along_y) / (
        along_x * along_x + along_y * along_y)
    share = min(max(share, 0.0), 1.0)
    near_x, near_y = piece[AX] + share * along_x, piece[AY] + share * along_y
    below = x < piece[BX] if along_y > 0.0 else x > piece[AX]
    return math.hypot(near_x - x, near_y - y), below


@compiled
def watch_touches(watched: Array, before: float, state: Array, radius: float, period: int) -> None:
    """Note which pieces of faces the ball has come to touch from below, and how fast."""
    for row in range(len(watched)):
        piece = watched[row]
        gap, below = gap_to(piece, state[X], state[Y])
        if gap > radius + APART:
            piece[TOUCHED] = 0.0
            continue
        towards = before if piece[BY] > piece[AY] else -before
        if gap <= radius and below and towards > 0.0 and piece[TOUCHED] == 0.0:
            piece[TOUCHED] = 1.0
            piece[TOUCH_SPEED] = towards
            piece[TOUCH_PERIOD] = period


@compiled
def scripted_angle(state: Array, script: Script) -> float:
    """Return the set angle of the pendulum [rad]."""
    angle, gain, speed, lean, swing_position, swing_angle = script
    if state[X] >= swing_position:
        return swing_angle
    missing: float = speed - state[VELOCITY_X]
    return min(max(angle + gain * missing, -lean), lean)


@unlocked
def advance_periods(call: Call) -> Tuple[int, int, float]:
    """
    Advance a state in place by some control periods.

    Returns
    -------
    outcome : int
        FINISHED, or why it could not go on; see `solvers.values`.
    done : int
        Periods.
    torque : float
        In the last period [N m].

    """
    span, script, drive, packed, solving, state, watched, rows, arrays = call
    first, count, period = span
    kp, kd, gravity_torque, most, stall, back, supply, maximum = drive
    parameters, ground = Parameters(*packed[0]), packed[1]
    options, output = Options(*solving), Output(*rows)
    workspace = unpacked(arrays)
    torque = 0.0
    for number in range(first, first + count):
        wanted = limited(position_torque(state[PENDULUM_ANGLE], state[PENDULUM_RATE],
                                         scripted_angle(state, script), kp, kd,
                                         gravity_torque), most)
        lowest, highest = available_torque(
            state[PENDULUM_RATE] - state[BALL_RATE], stall, back, supply, maximum)
        torque = min(max(wanted, lowest), highest)
        system = System(parameters, ground,
                        Actuator(TORQUE, torque, 0.0, 0.0, 0.0, maximum, 0.0, 0.0))
        before = state[VELOCITY_X]
        after = integrate(status_at(number * period), number * period + period, state, system,
                          options, output, workspace)
        if after.outcome != FINISHED:
            return after.outcome, number - first, torque
        watch_touches(watched, before, state, parameters.radius, number + 1)
    return FINISHED, count, torque
