# SPDX-License-Identifier: Apache-2.0
"""
The approach: a ball that rolls without slip along gentle ground, with law (11) in its motor.

The equations are those of `control.rolling_model`.  The derivative gain makes for a pole of some
hundred per second, so the rate of the pendulum is stepped implicitly, and steps may be ten times
longer.
"""
import math
from typing import NamedTuple

from ballbot_ros.control.rolling_model import rolling_loads, RollingNumbers
from ballbot_ros.decision.planning.rollout.layout import Drive
from ballbot_ros.jit import compiled
from ballbot_ros.physics.mechanics.contact import find_contacts, found_loads
from ballbot_ros.physics.mechanics.contact_law import POINT_X
from ballbot_ros.physics.mechanics.equations import write_rates
from ballbot_ros.physics.mechanics.laws import applied_torque, position_torque
from ballbot_ros.physics.model.parameters import Parameters
from ballbot_ros.physics.model.state import (
    BALL_RATE, PENDULUM_ANGLE, PENDULUM_RATE, VELOCITY_Y, X, Y)
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.solvers.semi_implicit import apply_rates


class Rolling(NamedTuple):
    """The state of a rolling ball."""

    position: float  # of the centre, horizontally [m]
    speed: float  # along the ground [m/s]
    angle: float  # of the pendulum, absolute [rad]
    rate: float  # [rad/s]


@compiled
def roll(now: Rolling, set_angle: float, slope: float, step: float, robot: Parameters,
         drive: Drive) -> Rolling:
    """
    Return the state a step later.

    Parameters
    ----------
    now : Rolling
    set_angle : float
        Of law (11) [rad].
    slope : float
        Of the ground, positive uphill [rad].
    step : float
        [s]
    robot : Parameters
    drive : Drive

    """
    radius = robot.radius - robot.mass * robot.gravity / robot.stiffness
    moment, spin = robot.pendulum_moment, -now.speed / radius
    inertia = robot.ball_inertia + robot.mass * radius * radius
    on_pendulum, on_ball, coupling = rolling_loads(
        now.angle, now.rate, spin, slope, RollingNumbers(
            robot.pendulum_inertia, inertia, moment * radius, moment * robot.gravity,
            robot.joint_friction, robot.rolling_friction, robot.mass * robot.gravity * radius)[:])
    # Both equations without theta1'': share * torque + rest = left * phi''.
    share = 1.0 - coupling / inertia
    rest, left = on_pendulum + coupling / inertia * on_ball, (
        robot.pendulum_inertia - coupling * coupling / inertia)
    weight = drive.compensated * moment * robot.gravity * math.sin(now.angle)
    # The torque at the end of the step: kp (set - phi - h phi'_new) - kd phi'_new + weight.
    fixed = drive.kp * (set_angle - now.angle) + weight
    damping = drive.kd + drive.kp * step
    rate = (now.rate + step * (share * fixed + rest) / left) / (
        1.0 + step * share * damping / left)
    asked = fixed - damping * rate
    torque = applied_torque(asked, now.rate - spin, drive.motor_line, drive.limit)
    if torque != asked:
        rate = now.rate + step * (share * torque + rest) / left
    turned = (rate - now.rate) / step
    speed = now.speed - step * radius * (on_ball - torque + coupling * turned) / inertia
    return Rolling(now.position + 0.5 * step * (now.speed + speed) * math.cos(slope), speed,
                   now.angle + step * rate, rate)


# The period of the control loop [s]: torque is held that long.
PERIOD = 0.002


@compiled
def torque_of(state: Array, set_angle: float, robot: Parameters, drive: Drive) -> float:
    """Return the torque of law (11) as the motor gives it [N m]."""
    asked = position_torque(
        state[PENDULUM_ANGLE], state[PENDULUM_RATE], set_angle, drive.kp, drive.kd,
        drive.compensated * robot.pendulum_moment * robot.gravity)
    return applied_torque(asked, state[PENDULUM_RATE] - state[BALL_RATE], drive.motor_line,
                          drive.limit)


@compiled
def push(state: Array, torque: float, step: float, robot: Parameters, ground: Array,
         contacts: Array, rates: Array) -> float:
    """Advance a state in place, and return the x of its foremost contact [m]; -inf for none."""
    count = find_contacts(state[X], state[Y], robot.radius, ground, contacts)
    loads = found_loads(state, robot, ground, contacts, count)
    write_rates(state, robot, loads, torque, rates)
    apply_rates(state, step, rates, VELOCITY_Y + 1)
    return contacts[count - 1, POINT_X] if count > 0 else -math.inf
