# SPDX-License-Identifier: Apache-2.0
"""
The smooth pieces (modes) of the contact law, and the events between them.

The forces of eqs. (7)-(10) are piecewise smooth: a contact begins or ends, the damper would
pull, the slip passes the threshold of eq. (9), the motor reaches its limit.  A *mode* stores
the side of the state for each of these conditions.  Within a mode the forces are smooth
formulas without `max`, which extend beyond the end of the mode; that end is a zero of one of
the *guards*, each positive inside.  An integrator that freezes the mode, locates the zero and
restarts there keeps its order.
"""
import math
from typing import NamedTuple

import numpy as np

from ballbot_ros.jit import compiled
from ballbot_ros.physics.mechanics.contact import (
    contact_table, FROZEN, IntArray, loads_of, share_friction,
    write_contact)
from ballbot_ros.physics.mechanics.contact_law import (
    CORNER, FEATURE, KIND)
from ballbot_ros.physics.mechanics.equations import torque_asked, write_rates
from ballbot_ros.physics.model.parameters import System
from ballbot_ros.physics.model.state import PENDULUM_ANGLE, X, Y
from ballbot_ros.physics.model.terrain import Array

# Columns of the signs of a mode: a row per contact in force, see `contact_law`,
# and in the last row:
MOTOR = 0     # sign of the torque where it is at its limit, 0 within
COUNT = 1     # of contacts in force
CORNERS = 2   # among them
COLUMNS = 3


class ContactMode(NamedTuple):
    """The piece of the law that is in force."""

    signs: IntArray  # (2 n + 1, 3), see above
    contacts: Array  # (2 n, 7): the table of its contacts, at the state last looked at

    @classmethod
    def of(cls, vertices: int) -> 'ContactMode':
        """Return an empty mode with room for every contact that a profile can give."""
        return cls(np.zeros((2 * vertices + 1, COLUMNS), dtype=np.int64), contact_table(vertices))


@compiled
def contact_count(mode: ContactMode) -> int:
    """Return how many contacts are in force."""
    return mode.signs[len(mode.signs) - 1, COUNT]


@compiled
def smooth_contacts(mode: ContactMode) -> bool:
    """Return whether no contact of a mode is a CORNER, which changes what its neighbours do."""
    return mode.signs[len(mode.signs) - 1, CORNERS] == 0


@compiled
def write_contacts(state: Array, system: System, mode: ContactMode) -> None:
    """Write the contacts of a mode at a state into its table, whether they touch or not."""
    corners = False
    for row in range(contact_count(mode)):
        write_contact(mode.contacts, row, mode.signs[row, FEATURE], state[X], state[Y],
                      system.parameters.radius, system.ground)
        corners = corners or mode.contacts[row, KIND] == CORNER
    if corners:
        share_friction(mode.contacts, contact_count(mode))


@compiled
def mode_torque(time: float, motion: Array, sine: float, system: System,
                mode: ContactMode) -> float:
    """Return the torque of the motor in a frozen mode [N m]; `sine` is of the pendulum angle."""
    if system.parameters.swing_inertia <= 0.0:
        return 0.0
    saturated = mode.signs[len(mode.signs) - 1, MOTOR]
    if saturated != 0:
        return saturated * system.actuator.limit
    return torque_asked(time, motion, sine, system.actuator)


@compiled
def mode_derivative(time: float, state: Array, system: System, mode: ContactMode,
                    rates: Array) -> None:
    """Write the time derivative of `state` by the formulas of a frozen mode."""
    write_contacts(state, system, mode)
    loads = loads_of(state, system.parameters, system.ground, mode.contacts, mode.signs,
                     contact_count(mode), FROZEN)
    motor = mode_torque(time, state, math.sin(state[PENDULUM_ANGLE]), system, mode)
    write_rates(state, system.parameters, loads, motor, rates)
