# SPDX-License-Identifier: Apache-2.0
"""What is impossible about a polyline of the ground, before anything is made of it."""
from typing import Tuple

import numpy as np

from ballbot_ros.decision.values import TerrainObservation
from ballbot_ros.physics.model.terrain import Array

# More points than any camera has in a row are an accident; so is ground this far off [m].
MOST_POINTS, LARGEST = 5000, 1e6

# A sensor that sees so far behind, and less far ahead, does not look ahead [m].
FAR_BEHIND = 0.6

# Floor this far off the bottom of the ball is an error of mounting, and subtracted; more is
# not the floor that the ball stands on [m].
LARGEST_OFFSET = 0.03

# A ball over an edge, or in the air, may be this far above the ground that it saw before [m].
LARGEST_LIFT = 0.3


def fault(observation: TerrainObservation, frame: str) -> str:
    """
    Return what is impossible about an observation, or nothing.

    Parameters
    ----------
    observation : TerrainObservation
        Unchecked, but made of floats.
    frame : str
        In which it must be.

    """
    count = len(observation.x)
    if observation.frame != frame:
        return f'it is in frame {observation.frame[:40]!r}, not in {frame!r}'
    if len(observation.z) != count or len(observation.z_sd) not in (0, count):
        return (f'{count} x have {len(observation.z)} z and {len(observation.z_sd)} standard '
                'deviations')
    if not 2 <= count <= MOST_POINTS:
        return f'it has {count} points, 2 to {MOST_POINTS} are possible'
    return _of_numbers(*arrays(observation),
                       np.array((observation.stamp, observation.x_min, observation.x_max)))


def arrays(observation: TerrainObservation) -> Tuple[Array, Array, Array]:
    """Return x, z and standard deviations, each of shape (n,); 0 for those that are unknown."""
    x, z = np.array(observation.x, dtype=float), np.array(observation.z, dtype=float)
    known = np.array(observation.z_sd, dtype=float) if observation.z_sd else np.zeros(len(x))
    return x, z, known


def _of_numbers(x: Array, z: Array, z_sd: Array, others: Array) -> str:
    """Return what is impossible about arrays of one length, or nothing."""
    largest = [float(np.abs(numbers).max()) for numbers in (x, z, z_sd, others)]
    if not np.isfinite(largest).all():
        return 'a number of it is not finite'
    if max(largest[:3]) > LARGEST or np.abs(others[1:]).max() > LARGEST:
        return f'ground {max(largest[:3]):g} m away is beyond all measure'
    if z_sd.min() < 0.0:
        return f'a standard deviation is negative ({z_sd.min():g} m)'
    steps = np.diff(x)
    if steps.min() < 0.0:
        where = int(np.argmin(steps >= 0.0))
        return f'x falls from {x[where]:g} to {x[where + 1]:g} m at point {where + 1}'
    if not x[0] < x[-1]:
        return 'all its points have the same x'
    low, high = max(x[0], others[1]), min(x[-1], others[2])
    if not low < high:
        return (f'it has seen from x_min {others[1]:g} to x_max {others[2]:g} m, and has points '
                f'from {x[0]:g} to {x[-1]:g} m')
    if high < -low and low < -FAR_BEHIND:
        return (f'it has seen {-low:.2f} m behind the ball and {high:.2f} m ahead: is the sensor '
                'mounted backwards?')
    return ''


def misplaced(x: Array, z: Array, radius: float, known: bool) -> str:
    """
    Return why the ground is not where the ball touches it, or nothing.

    Parameters
    ----------
    x, z : (n,) arrays
        Ground near the ball, relative to its centre [m].
    radius : float
        [m]
    known : bool
        Whether it looks as it did before: then the ball may be in the air.

    """
    nearest = int(np.argmin(np.abs(x)))
    if abs(x[nearest]) > radius:
        return ''  # nothing is seen where it could touch
    below = float(z[nearest])
    if below > 0.0:
        return (f'the ground lies {1e3 * below:.0f} mm above the centre of the ball: is the '
                'sensor upside down, or z not upwards?')
    clearance = float(np.hypot(x, z).min()) - radius
    highest = LARGEST_LIFT if known else LARGEST_OFFSET
    if x[0] > 0.0:
        highest += float(x[0])  # the place of the touch is not seen
    if not -LARGEST_OFFSET <= clearance <= highest:
        return (f'the ground is {1e3 * clearance:.0f} mm from the ball that rests on it, '
                f'{-1e3 * LARGEST_OFFSET:.0f} to {1e3 * highest:.0f} mm are possible: is the '
                'sensor mounted as its frame says?')
    return ''
