# SPDX-License-Identifier: Apache-2.0
"""Detect faces in a single observation, for a ball that turns and cannot fuse observations."""
from typing import Tuple

import numpy as np

from ballbot_ros.decision import TerrainObservation
from ballbot_ros.decision.perception.terrain_tracker import fault
from ballbot_ros.errors import MessageError

# Spacing of samples of the polyline [m]; the height of a face is the difference of the mean
# heights over this number of samples behind and before it.
SPACING, SAMPLES = 0.01, 5
# Height of the lowest face [m], also in standard deviations.
FACE_HEIGHT_MIN, SIGMAS = 0.004, 6.0
# Number of samples whose median rise is attributed to the slope of the ground, e.g. of a ramp.
SLOPE_SAMPLES = 41


def faces_in(observation: TerrainObservation) -> Tuple[Tuple[float, float], ...]:
    """
    Return the distance ahead of the centre and the height of each face, nearest first [m].

    Raises `MessageError` if the observation is invalid.
    """
    x, z = np.array(observation.x), np.array(observation.z)
    if len(x) < 2 * SAMPLES:
        return ()
    wrong = fault(x, z, np.array(observation.z_sd or (0.0,) * len(x)), observation, 'base_link')
    if wrong:
        raise MessageError(wrong, 'bad_observation', 'terrain_observation')
    from scipy import ndimage
    at = np.arange(max(float(x[0]), 0.0), float(x[-1]), SPACING)
    if len(at) <= 2 * SAMPLES:
        return ()
    heights = np.interp(at, x, z)
    sums = np.concatenate([[0.0], np.cumsum(heights)])
    means = (sums[SAMPLES:] - sums[:-SAMPLES]) / SAMPLES
    rises = means[SAMPLES:] - means[:-SAMPLES]
    rises = rises - ndimage.median_filter(rises, SLOPE_SAMPLES, mode='nearest')
    sd = max(observation.z_sd, default=0.0)
    # Samples between two points of the polyline are not independent.
    threshold = max(FACE_HEIGHT_MIN, SIGMAS * sd / np.sqrt(2.0))
    signs = np.where(np.abs(rises) > threshold, np.sign(rises), 0.0)
    found = []
    for face in np.split(np.arange(len(rises)), np.flatnonzero(np.diff(signs)) + 1):
        best = face[np.argmax(np.abs(rises[face]))]
        if signs[best]:
            found.append((float(at[best + SAMPLES]), float(rises[best])))
    return tuple(found)
