# SPDX-License-Identifier: Apache-2.0
"""The rising faces of a terrain, and how a run fared at each of them."""
from dataclasses import dataclass
import math
from typing import Optional

import numpy as np

from ballbot_ros.crossing.rules import is_over
from ballbot_ros.physics.model.terrain import Array, Terrain
from ballbot_ros.physics.simulation.trajectory import Trajectory

# Lower ones are roughness, not obstacles [m].
LEAST_HEIGHT = 1e-3

# What rises less steeply is a ramp: a ball rolls up, it does not hit it.
LEAST_SLOPE = math.tan(math.radians(30.0))

# A shallow piece shorter than this many radii, as on top of a round cord, belongs to the face.
SHORT = 0.05


@dataclass(frozen=True)
class FaceMeeting:
    """A rising face of the terrain and the first meeting of the ball, from the left, with it."""

    x: float  # of the foot of the face [m]
    height: float  # from foot to top [m]
    touch_time: Optional[float] = None  # of the first touch [s]; None if there was none
    touch_speed: Optional[float] = None  # of the centre just before the first touch [m/s]
    passed: bool = False  # the centre got past the top, with the contact below it


def rising_faces(terrain: Terrain, radius: float) -> list[Array]:
    """
    Return the vertices of every rising face of at least `LEAST_HEIGHT`, from left to right.

    What is short beside the radius [m] of the ball is not a slope.
    """
    return [face for face in terrain.faces(
        LEAST_SLOPE, LEAST_HEIGHT, SHORT * radius, endless=False) if face[-1, 1] > face[0, 1]]


def meet_faces(trajectory: Trajectory) -> list[FaceMeeting]:
    """Return every rising face with what the ball did there."""
    radius = trajectory.model.robot.ball_radius
    return [_meet(trajectory, vertices, radius)
            for vertices in rising_faces(trajectory.model.terrain, radius)]


def _meet(trajectory: Trajectory, vertices: Array, radius: float) -> FaceMeeting:
    """Return the first meeting with one face."""
    (foot_x, foot_y), (top_x, top_y) = vertices[0].tolist(), vertices[-1].tolist()
    height = top_y - foot_y
    x, y = trajectory['x'], trajectory['y']
    # A start beyond the face, or already in touch with it, is no meeting.
    near = np.flatnonzero((x > foot_x - radius) & (x < top_x) & (y > foot_y))
    touching = near[_distance(x[near], y[near], vertices) < radius]
    if x[0] >= top_x or not len(touching):
        return FaceMeeting(foot_x, height)
    touch = int(touching[0])
    before = max(touch - 1, 0)
    speed = math.hypot(trajectory['velocity_x'][before], trajectory['velocity_y'][before])
    over = is_over(x[touch:], y[touch:], top_x, top_y, radius)
    return FaceMeeting(foot_x, height, float(trajectory['time'][touch]), speed, bool(over.any()))


def _distance(x: Array, y: Array, vertices: Array) -> Array:
    """Return the distance of points from a polyline [m]."""
    nearest = np.full(len(x), np.inf)
    for (start_x, start_y), (dx, dy) in zip(vertices[:-1], np.diff(vertices, axis=0)):
        share = ((x - start_x) * dx + (y - start_y) * dy) / (dx * dx + dy * dy)
        share = np.clip(share, 0.0, 1.0)
        nearest = np.minimum(
            nearest, np.hypot(x - start_x - share * dx, y - start_y - share * dy))
    return nearest
