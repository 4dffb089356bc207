# SPDX-License-Identifier: Apache-2.0
"""The rising faces of a terrain, and the outcome of a run at each of them."""
from dataclasses import dataclass, replace
import math
from typing import Optional

import numpy as np

from ballbot_ros.crossing.rules import is_over
from ballbot_ros.floors.floor import distance_to_segment
from ballbot_ros.physics.model.terrain import Array, Terrain
from ballbot_ros.physics.simulation.trajectory import Trajectory
from ballbot_ros.results.resolved import resolved

# Lower faces are roughness, not obstacles [m].
LEAST_HEIGHT = 1e-3

# A smaller slope is a ramp, on which the ball rolls up without an impact.
LEAST_SLOPE = math.tan(math.radians(30.0))

# A shallow piece shorter than this many radii, as on top of a round cord, belongs to the face.
PIECE_LENGTH_MIN = 0.05


@dataclass(frozen=True)
class FaceMeeting:
    """A rising face of the terrain, and its first contact with a ball from the left."""

    x: float  # of the foot of the face [m]
    height: float  # from foot to top [m]
    touch_time: Optional[float] = None  # [s], at most 1 ms after the first touch; None without one
    touch_speed: Optional[float] = None  # of the centre just before the first touch [m/s]
    passed: bool = False  # the centre passed the top, with the contact below it


def faces_of(terrain: Terrain, radius: float, endless: bool = True) -> list[Array]:
    """
    Return the vertices of every face of at least `LEAST_HEIGHT`, from left to right.

    Pieces that are short relative to the radius [m] of the ball are not slopes.
    """
    return terrain.faces(LEAST_SLOPE, LEAST_HEIGHT, PIECE_LENGTH_MIN * radius, endless=endless)


def rising_faces(terrain: Terrain, radius: float) -> list[Array]:
    """Return the vertices of every rising face of `faces_of` that ends."""
    return [face for face in faces_of(terrain, radius, endless=False) if face[-1, 1] > face[0, 1]]


def meet_faces(trajectory: Trajectory) -> list[FaceMeeting]:
    """Return each rising face with its outcome, independent of the output step."""
    meetings = watch_faces(trajectory)
    for piece in resolved(trajectory):
        for meeting in meetings:
            meeting.take(piece)
    return [meeting.result for meeting in meetings]


def watch_faces(trajectory: Trajectory) -> list['FaceWatch']:
    """Return an observer of the first contact with each rising face."""
    radius = trajectory.model.robot.ball_radius
    return [FaceWatch(vertices, radius)
            for vertices in rising_faces(trajectory.model.terrain, radius)]


class FaceWatch:
    """Finds the first contact of the ball with a face; `result` describes the run so far."""

    def __init__(self, vertices: Array, radius: float):
        self._vertices, self._radius = vertices, radius
        self._foot_x, self._foot_y = vertices[0].tolist()
        self._top_x, self._top_y = vertices[-1].tolist()
        self.result = FaceMeeting(self._foot_x, self._top_y - self._foot_y)
        self._at_start, self._beyond = True, False

    def take(self, piece: Trajectory) -> None:
        """Process the next part of the run."""
        x, y = piece['x'], piece['y']
        if self._at_start:
            # A ball that starts beyond the face does not meet it.
            self._at_start, self._beyond = False, bool(x[0] >= self._top_x)
        if self._beyond or self.result.passed:
            return
        first = 0
        if self.result.touch_time is None:
            near = np.flatnonzero((x > self._foot_x - self._radius) & (x < self._top_x)
                                  & (y > self._foot_y))
            gap = np.min([distance_to_segment(x[near], y[near], *part) for part in zip(
                self._vertices, self._vertices[1:])], axis=0) - self._radius
            touching = near[gap < 0.0]
            if not len(touching):
                return
            first = int(touching[0])
            before = max(first - 1, 0)
            self.result = replace(
                self.result, touch_time=float(piece['time'][first]), touch_speed=math.hypot(
                    piece['velocity_x'][before], piece['velocity_y'][before]))
        over = is_over(x[first:], y[first:], self._top_x, self._top_y, self._radius)
        self.result = replace(self.result, passed=bool(over.any()))
