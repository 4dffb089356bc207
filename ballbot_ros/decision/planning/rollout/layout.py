# SPDX-License-Identifier: Apache-2.0
"""
What a rollout reads and writes: rows of numbers, so that many of them are one array.

A *plan row* says what is done, a *draw row* what is so in one of the many worlds that may be
the real one, a *result row* what became of it.
"""
from typing import NamedTuple

import numpy as np

from ballbot_ros.control.speed_law import Numbers
from ballbot_ros.physics.mechanics.contact import contact_table
from ballbot_ros.physics.model.parameters import Parameters
from ballbot_ros.physics.model.state import SIZE
from ballbot_ros.physics.model.terrain import Array

# What became of a rollout.
OVER, STUCK, FALLS = range(3)

# Columns of a plan: positions are those of the ball's centre along the odometry axis.
SPEED = 0         # set speed [m/s]
SWING_AT = 1      # where the pendulum swings [m]; infinite for no swing
SWING_ANGLE = 2   # to this absolute angle [rad], until the ball is past the last edge
START = 3         # where the plan begins, from rest, if that is behind the ball [m]
EDGE = 4          # where the swing ends, and the ball is stopped [m]
EDGE_AT = 5       # number of the vertex of the ground behind which the ball is over
NEXT_AT = 6       # and of the foot of the next face, which it must not meet; the last for none
PLAN = 7

# An obstacle nearer than this behind the last edge requires braking immediately [m].
TIGHT = 1.5

# Columns of a draw. The first are the robot, in the order of `Parameters`.
ROBOT = len(Parameters._fields)
SURFACE_FRICTION = ROBOT  # coefficients of friction
EDGE_FRICTION = ROBOT + 1
SLOPE = ROBOT + 2      # added to the slope of all that lies ahead [rad]
DELAY = ROBOT + 3      # from what is measured to what the motor does [s]
HEIGHT = ROBOT + 4     # deviations of the heights of the first faces [m], ...
FACES = 4              # ... number of faces
PLACE = HEIGHT + FACES  # and deviations of their positions [m]
DRAW = PLACE + FACES

# Columns of a result.
VERDICT = 0
TOUCH_SPEED = 1   # when the ball first touches a face [m/s]; NaN where it does not
TOUCH_ANGLE = 2   # of the pendulum then [rad]
REST = 3          # farthest that the centre gets if it is stopped behind the last edge [m]
TIME = 4          # from now until the verdict [s]
PASSED_SPEED = 5  # when the centre has passed the last edge [m/s]; NaN where it does not
RESULT = 6


class Drive(NamedTuple):
    """How set angles are made and what the motor does with them; plain tuples inside."""

    kp: float  # of law (11) [N m/rad]
    kd: float  # [N m s/rad]
    compensated: float  # 1 where the weight of the pendulum is, 0 otherwise
    limit: float  # of the torque [N m]
    motor_line: tuple[float, float, float, float]  # see `Robot.motor_line`
    law: Numbers  # of the speed law
    lean: float  # see `pilot_law.Order` [rad]
    emergency_lean: float
    reaction: float  # [s]
    cruise: float  # speed behind the last edge [m/s]


class Scratch(NamedTuple):
    """Arrays that a rollout works in; one set for each thread."""

    state: Array  # (13,)
    rates: Array  # (13,)
    ground: Array  # (n, 7), see `Terrain.profile`
    contacts: Array  # see `contact.contact_table`

    @classmethod
    def of(cls, vertices: int) -> 'Scratch':
        """Return arrays for a ground with this number of vertices."""
        return cls(np.zeros(SIZE), np.zeros(SIZE), np.zeros((vertices, 7)),
                   contact_table(vertices))
