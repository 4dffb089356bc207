# SPDX-License-Identifier: Apache-2.0
"""
The order of a state vector: coordinates, rates, then energy gone since the start.

All angles are counter-clockwise positive; see `mechanics.equations` for the picture.
"""
(BALL_ANGLE, PENDULUM_ANGLE, X, Y, BALL_RATE, PENDULUM_RATE, VELOCITY_X, VELOCITY_Y,
 CONTACT_LOSS, FRICTION_LOSS, ROLLING_LOSS, JOINT_LOSS, MOTOR_WORK) = range(13)
SIZE = 13
COORDINATES = 4
