# SPDX-License-Identifier: Apache-2.0
"""
The contact: the full model with the motor of the plant, in steps of the control period.

Semi-implicit steps of 2 ms find the highest step to 0.1 mm on average, half a millimetre at worst
(measured at the published gains over drawn robots), for a third of what finer methods cost: the
height of a step is never known better.
"""
import math

from ballbot_ros.decision.rollout.layout import Drive
from ballbot_ros.decision.rollout.rolling import motor_torque_of
from ballbot_ros.jit import compiled
from ballbot_ros.physics.mechanics.contact import find_contacts
from ballbot_ros.physics.mechanics.contact_law import (
    contact_load, force_and_slip, POINT_X, pressed_sign, sliding_sign)
from ballbot_ros.physics.mechanics.equations import write_rates
from ballbot_ros.physics.mechanics.laws import position_torque
from ballbot_ros.physics.model.parameters import Parameters
from ballbot_ros.physics.model.state import (
    BALL_RATE, COORDINATES, PENDULUM_ANGLE, PENDULUM_RATE, VELOCITY_Y, X, Y)
from ballbot_ros.physics.model.terrain import Array

# The period of the control loop [s]: torque is held that long.
PERIOD = 0.002


@compiled
def torque_of(state: Array, set_angle: float, robot: Parameters, drive: Drive) -> float:
    """Return the torque of law (11) as the motor gives it [N m]."""
    asked = position_torque(
        state[PENDULUM_ANGLE], state[PENDULUM_RATE], set_angle, drive.kp, drive.kd,
        drive.compensated * robot.pendulum_moment * robot.gravity)
    return motor_torque_of(asked, state[PENDULUM_RATE] - state[BALL_RATE], drive)


@compiled
def push(state: Array, torque: float, step: float, robot: Parameters, ground: Array,
         contacts: Array, rates: Array) -> float:
    """Advance a state in place, and return the x of its foremost contact [m]; -inf for none."""
    force_x = force_y = turning = 0.0
    foremost = -math.inf
    for row in range(find_contacts(state[X], state[Y], robot.radius, ground, contacts)):
        force, slip, _ = force_and_slip(state, robot, contacts, row)
        load = contact_load(state, pressed_sign(force, robot), sliding_sign(slip, robot), robot,
                            contacts, row)
        force_x += load[0]
        force_y += load[1]
        turning += load[2]
        foremost = contacts[row, POINT_X]
    write_rates(state, robot, (force_x, force_y, turning, 0.0, 0.0), torque, rates)
    for i in range(COORDINATES, VELOCITY_Y + 1):
        state[i] += step * rates[i]
    for i in range(COORDINATES):
        state[i] += step * state[COORDINATES + i]
    return foremost
