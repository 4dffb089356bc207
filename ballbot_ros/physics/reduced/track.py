# SPDX-License-Identifier: Apache-2.0
"""
The way of the ball's centre along one feature of the ground.

The centre of a rolling ball follows the offset curve of the ground: a straight line above a
segment, an arc about a convex vertex.  With the dent p of the contact the distance is
d = R - p, and both are one case::

    n, t      normal out of the ground and tangent to its right, t = (n_y, -n_x)
    way       along t from the start of the segment [m], or the angle of n from the vertical
              towards +x about the vertex [rad]
    n' = W t  with the turning rate W = v_t / d about a vertex, 0 above a segment
"""
import math
from typing import Any

from ballbot_ros.compiled import compiled
from ballbot_ros.physics.terrain import (
    EDGE_FRICTION, SURFACE_FRICTION, TANGENT_X, TANGENT_Y, VERTEX_X, VERTEX_Y)

# A track is an array. ROUGHNESS is the coefficient of friction; the last four are for `rolling`.
(TURNING, ORIGIN_X, ORIGIN_Y, ALONG_X, ALONG_Y, ROUGHNESS, LEAST_X, MOST_X, SLIP_ANSWER,
 DENT_ANSWER, QUICKEST, PERIOD) = range(12)
TRACK_COLUMNS = 12


@compiled
def lay_track(feature: int, ground: Any, track: Any) -> None:
    """
    Describe a feature of the ground, a segment or a convex vertex; numbered as in `modes`.

    LEAST_X and MOST_X say where the next vertices of the ground lie: a ball whose centre is
    more than its radius away from both touches nothing else.
    """
    segment = feature // 2
    last = len(ground) - 2
    track[TURNING] = float(feature % 2)
    origin = segment + feature % 2
    track[ORIGIN_X], track[ORIGIN_Y] = ground[origin, VERTEX_X], ground[origin, VERTEX_Y]
    track[ALONG_X], track[ALONG_Y] = ground[segment, TANGENT_X], ground[segment, TANGENT_Y]
    if feature % 2 == 1:
        track[ROUGHNESS] = ground[origin, EDGE_FRICTION]
        track[LEAST_X] = track[MOST_X] = ground[origin, VERTEX_X]
        return
    track[ROUGHNESS] = ground[segment, SURFACE_FRICTION]
    track[LEAST_X] = ground[segment, VERTEX_X] if segment > 0 else -math.inf
    track[MOST_X] = ground[segment + 1, VERTEX_X] if segment < last else math.inf


@compiled
def normal_at(way: float, track: Any) -> tuple:
    """Return the normal above a point of the track."""
    if track[TURNING] > 0.0:
        return math.sin(way), math.cos(way)
    return -track[ALONG_Y], track[ALONG_X]


@compiled
def place(x: float, y: float, track: Any) -> tuple:
    """Return way, distance and normal of a centre."""
    away_x, away_y = x - track[ORIGIN_X], y - track[ORIGIN_Y]
    if track[TURNING] > 0.0:
        distance = math.sqrt(away_x * away_x + away_y * away_y)
        return math.atan2(away_x, away_y), distance, away_x / distance, away_y / distance
    normal_x, normal_y = -track[ALONG_Y], track[ALONG_X]
    return (away_x * normal_y - away_y * normal_x, away_x * normal_x + away_y * normal_y,
            normal_x, normal_y)


@compiled
def centre(way: float, distance: float, normal_x: float, normal_y: float, track: Any) -> tuple:
    """Return the centre at a distance above a point of the track."""
    along = 0.0 if track[TURNING] > 0.0 else way
    return (track[ORIGIN_X] + along * normal_y + distance * normal_x,
            track[ORIGIN_Y] - along * normal_x + distance * normal_y)
