# SPDX-License-Identifier: Apache-2.0
"""Terrain at the extremes."""
import math

import numpy as np

from ballbot_ros.physics import Terrain


def step_of(draw, radius, decades):
    """Return a step of 1 um to 10 R, up or down."""
    height = decades(draw, 1e-6, 10.0 * radius) * float(draw.choice([-1.0, 1.0]))
    return Terrain.step(height, at=1.2 * radius)


def groove(draw, radius, decades):
    """Return a V-groove, or a wedge, from a hundredth of the radius to ten of them wide."""
    wide = radius * decades(draw, 1e-2, 10.0)
    steep = [wide * math.tan(math.radians(float(draw.uniform(1.0, 85.0)))) for _ in range(2)]
    deep = min(steep) * float(draw.choice([-1.0, 1.0]))
    left = 1.2 * radius
    right = left + wide * (1.0 + min(steep) / max(steep))
    return Terrain([[left - 1.0, 0.0], [left, 0.0], [left + wide, deep], [right, 0.0],
                    [right + 1.0, 0.0]])


def rough(draw, radius, decades):
    """Return ground of 10,000 vertices that are a thousandth of the radius apart, or further."""
    apart = radius * decades(draw, 1e-3, 1.0)
    x = (np.arange(10_000) - 2000) * apart
    y = apart * float(draw.uniform(0.0, 1.0)) * draw.standard_normal(10_000)
    y[:2] = y[-2:] = 0.0
    return Terrain(np.column_stack([x, y]))
