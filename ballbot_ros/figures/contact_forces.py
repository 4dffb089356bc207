# SPDX-License-Identifier: Apache-2.0
"""What the ground does to the ball between one picture and the next, as arrows."""
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.physics.mechanics.contact import contact_table, find_contacts
from ballbot_ros.physics.mechanics.contact_law import contact_force, EDGE, KIND, NORMAL_X, NORMAL_Y
from ballbot_ros.physics.model.state import SIZE, X, Y
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.simulation.trajectory import Trajectory

# Samples looked at for one picture: an impact lasts some milliseconds.
_LOOKS = 40

# Contacts whose normals differ by less are one that has moved [rad].
_SAME = 0.35


class ForceArrow(NamedTuple):
    """The mean force at one contact; `x` and `y` are where on the shell [m], the force in N."""

    x: float
    y: float
    force_x: float
    force_y: float


def mean_forces(run: Trajectory, frames: NDArray[np.int64]) -> list[tuple[ForceArrow, ...]]:
    """
    Return for each frame the mean contact forces since the frame before it.

    A picture of the force at one moment would miss most impacts, or show their peaks by chance.

    Parameters
    ----------
    run : Trajectory
    frames : (n,) array of int
        Numbers of samples, ascending.

    """
    table = contact_table(len(run.model.profile))
    numbers = frames.tolist()
    looks = [np.unique(np.linspace(min(before + 1, last), last, _LOOKS).astype(int))
             for before, last in zip([numbers[0] - 1, *numbers], numbers)]
    return [_mean(run, samples, table) for samples in looks]


def _mean(run: Trajectory, samples: NDArray[np.int64],
          table: Array) -> tuple[ForceArrow, ...]:
    """Return the mean contact forces over some samples, where the ball is at the last of them."""
    model = run.model
    found: list[list[float]] = []  # edge or not, normal, its weight, force
    for state in run.rows[samples, 1:1 + SIZE]:
        count = find_contacts(state[X], state[Y], model.parameters.radius, model.profile, table)
        for row in range(count):
            normal, friction, _ = contact_force(state, model.parameters, table, row)
            edge = float(table[row, KIND] == EDGE)
            normal_x, normal_y = float(table[row, NORMAL_X]), float(table[row, NORMAL_Y])
            # A corner between two contacts counts negatively: it belongs to its neighbours.
            for known in found:
                size = math.hypot(known[1], known[2]) or 1.0
                if known[0] == edge and (known[1] * normal_x + known[2] * normal_y
                                         > size * math.cos(_SAME)):
                    break
            else:
                known = [edge, 0.0, 0.0, 0.0, 0.0]
                found.append(known)
            weight = max(normal, 1e-9)
            known[1] += weight * normal_x
            known[2] += weight * normal_y
            known[3] += normal * normal_x + friction * normal_y
            known[4] += normal * normal_y - friction * normal_x
    x, y, radius = run['x'][samples[-1]], run['y'][samples[-1]], model.parameters.radius
    forces = []
    for _, along_x, along_y, force_x, force_y in found:
        size = math.hypot(along_x, along_y)
        forces.append(ForceArrow(
            float(x - radius * along_x / size), float(y - radius * along_y / size),
            force_x / len(samples), force_y / len(samples)))
    return tuple(forces)
