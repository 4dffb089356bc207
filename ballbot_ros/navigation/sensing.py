# SPDX-License-Identifier: Apache-2.0
"""Faces in one look at the ground ahead, for a ball that turns and cannot fuse looks."""
from typing import Tuple

import numpy as np

from ballbot_ros.decision import TerrainObservation

# The polyline is sampled at this distance [m]; a face is the difference of the mean heights over
# this many samples before and behind.
SPACING, SAMPLES = 0.01, 5
# Lowest face [m], and its standard deviations of the mean.
FACE_HEIGHT_MIN, SIGMAS = 0.004, 6.0
# Samples whose median is the slope of the ground, such as of a ramp.
SLOPE_SAMPLES = 41


def faces_in(observation: TerrainObservation) -> Tuple[Tuple[float, float], ...]:
    """Return distance ahead of the centre and height of each face, from near to far [m]."""
    x, z = np.array(observation.x), np.array(observation.z)
    if len(x) < 2 * SAMPLES or not (np.isfinite(x).all() and np.isfinite(z).all()):
        return ()
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
    found, index = [], 0
    while index < len(rises):
        if abs(rises[index]) <= threshold:
            index += 1
            continue
        end = index
        while end < len(rises) and abs(rises[end]) > threshold \
                and (rises[end] > 0.0) == (rises[index] > 0.0):
            end += 1
        best = index + int(np.argmax(np.abs(rises[index:end])))
        found.append((float(at[best + SAMPLES]), float(rises[best])))
        index = end
    return tuple(found)
