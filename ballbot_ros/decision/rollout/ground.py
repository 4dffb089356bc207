# SPDX-License-Identifier: Apache-2.0
"""
The ground of one draw, filled by a kernel: what was seen, moved by what may be wrong with it.

A *shape* holds what was seen, a row per vertex: x and z [m], the number of the face that it
belongs to or that lies before it (-1 for none), the share of that face's height that it carries,
and the share of the shift of that face that it follows.
"""
import math

from ballbot_ros.decision.rollout import layout
from ballbot_ros.decision.rollout.layout import FACES, HEIGHT, PLACE, SLOPE
from ballbot_ros.jit import compiled
from ballbot_ros.physics.model.terrain import (
    Array, EDGE_FRICTION, SURFACE_FRICTION, TANGENT_X, TANGENT_Y, TURN, VERTEX_X, VERTEX_Y)

SHAPE_X, SHAPE_Z, FACE, HEIGHT_SHARE, PLACE_SHARE = range(5)

# Two vertices that a draw would put upon each other stay this far apart [m].
APART = 1e-6


@compiled
def fill_ground(shape: Array, draw: Array, raised: float, here: float, ground: Array) -> None:
    """
    Write the ground of a draw.

    Parameters
    ----------
    shape : (n, 5) array
        See the module.
    draw : (DRAW,) array
        See `layout`.
    raised : float
        Added to the height of the first face [m].
    here : float
        Where the ball is [m]: a slope that is steeper than seen begins there.
    ground : (n, 7) array
        Overwritten, as `Terrain.profile` gives it.

    """
    count = len(shape)
    before = -math.inf
    for i in range(count):
        face = int(shape[i, FACE])
        x, z = shape[i, SHAPE_X], shape[i, SHAPE_Z]
        for j in range(min(face + 1, FACES)):
            share = shape[i, HEIGHT_SHARE] if j == face else 1.0
            z += share * draw[HEIGHT + j]
            if j == 0:
                z += share * raised
        if 0 <= face < FACES:
            x += shape[i, PLACE_SHARE] * draw[PLACE + face]
        x = max(x, before)
        z += math.tan(draw[SLOPE]) * (x - here)
        if i > 0 and x == before and abs(z - ground[i - 1, VERTEX_Y]) < APART:
            x += APART
        ground[i, VERTEX_X], ground[i, VERTEX_Y] = x, z
        ground[i, SURFACE_FRICTION] = draw[layout.SURFACE_FRICTION]
        ground[i, EDGE_FRICTION] = draw[layout.EDGE_FRICTION]
        before = x
    # Both ends go on for ever and so must not be vertical.
    ground[0, VERTEX_X] = min(ground[0, VERTEX_X], ground[1, VERTEX_X] - APART)
    ground[count - 1, VERTEX_X] = max(ground[count - 1, VERTEX_X],
                                      ground[count - 2, VERTEX_X] + APART)
    write_tangents(ground)


@compiled
def write_tangents(ground: Array) -> None:
    """Write the tangents of all segments, and the turns of all vertices."""
    count = len(ground)
    for i in range(count - 1):
        along = ground[i + 1, VERTEX_X] - ground[i, VERTEX_X]
        up = ground[i + 1, VERTEX_Y] - ground[i, VERTEX_Y]
        length = math.sqrt(along * along + up * up)
        ground[i, TANGENT_X], ground[i, TANGENT_Y] = along / length, up / length
    ground[0, TURN] = ground[count - 1, TURN] = 0.0
    for i in range(1, count - 1):
        ground[i, TURN] = (ground[i - 1, TANGENT_X] * ground[i, TANGENT_Y]
                           - ground[i - 1, TANGENT_Y] * ground[i, TANGENT_X])
