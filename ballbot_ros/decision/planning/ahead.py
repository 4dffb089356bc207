# SPDX-License-Identifier: Apache-2.0
"""The terrain ahead, from a profile: its shape for rollouts, and plans across its faces."""
from dataclasses import dataclass, field, replace
import math
from typing import List, Sequence, Tuple

import numpy as np

from ballbot_ros.crossing.rules import sink_depth
from ballbot_ros.decision.perception.ground_profile import GroundProfile
from ballbot_ros.decision.planning.situation import Situation
from ballbot_ros.decision.planning.stop_line import LINE_MARGIN
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.decision.values import After, Face, Profile, Strategy
from ballbot_ros.physics.model.terrain import Array

# Maximum number of faces that are planned together; a plan ends before the next one.
FACES_MAX = 8
# A face that the ball could touch nearer than this behind the last edge requires a stop [m].
BRAKING_DISTANCE = 1.5
# Maximum duration of a contact with a step [s].
CONTACT_TIME_MAX = 3.0
# Faces that are farther apart than this are planned one by one [m].
FACE_SEPARATION = 1.0
# A swing is held until the centre is past the edge by this [m].
SWING_END_DISTANCE = 0.01
# Margins of position and height, in standard deviations.
SIGMAS = 2.0
# The shape extends this far behind the ball, and this far beyond the known ground [m].
GROUND_EXTENSION = 4.0


@dataclass(frozen=True)
class End:
    """Where a plan may end: behind a face."""

    faces: int  # number of crossed faces
    vertex: int  # last vertex of its face in the shape
    position: float  # of that vertex [m]
    passed: float  # position at which the centre has certainly passed it [m]
    following: int = 0  # vertex of the foot of the next face; the last vertex without one
    after: After = After.CRUISE  # STOP before a near face


@dataclass(frozen=True, eq=False)
class Ahead:
    """The ground ahead."""

    # (n, 5) vertices of the ground: position and height above the floor below the ball [m], number
    # of the last face before it or at it, -1 for none, and the fractions of the deviations of
    # height and position of that face that apply to it.
    shape: Array
    faces: Tuple[Face, ...]  # at most `FACES_MAX`, and the next one
    ends: Tuple[End, ...]  # from near to far; none if the first face is a drop
    slope: float  # below the ball, positive uphill [rad]
    slope_sd: float  # [rad]
    touch: float  # position of the centre at the touch of the first face [m]
    room_to: float  # stop limit of the centre: the end of the known or assumed ground [m]
    known: bool  # whether that ground is known, not assumed
    # (n,) how far the ball can sink behind each face: limited in a trench, infinite
    # elsewhere [m].
    descents: Array

    def length(self, end: End) -> float:
        """Return the distance from the first face to an end [m]."""
        return end.position - self.faces[0].position


@dataclass(frozen=True)
class Candidate:
    """A plan relative to the faces, so that it follows updates of their positions."""

    strategy: Strategy
    speed: float  # of the approach [m/s]
    swing: float = -math.inf  # distance before the touch at which the pendulum swings [m]
    angle: float = 0.0  # of the swing [rad]
    back: float = 0.0  # distance before the touch at which it starts from rest [m]; 0 for here
    # Distance from the first face to the end of the plan [m]; it follows the estimates.
    length: float = field(default=0.0, compare=False)

    def end(self, ahead: Ahead) -> End:
        """Return its end: the nearest one to that for which it was planned."""
        return min(ahead.ends, key=lambda end: abs(ahead.length(end) - self.length))


def faces_ahead(profile: Profile, position: float) -> Tuple[Face, ...]:
    """Return the faces whose foot is ahead of a position, on observed floor."""
    return tuple(face for face in profile.faces
                 if position < face.position <= profile.seen_to)[:FACES_MAX + 1]


def passed(face: Face) -> float:
    """Return the position at which the centre has certainly passed a face [m]."""
    # A step down may be farther away than observed; a step up lifts the ball.
    later = SIGMAS * face.position_sd if face.height < 0.0 else 0.0
    return face.position + max(face.run, 0.0) + SWING_END_DISTANCE + later


def look_ahead(situation: Situation, faces: Sequence[Face], radius: float,
               tuning: DecisionTuning, line: float = math.inf, kept: bool = False) -> Ahead:
    """
    Return the terrain ahead of the ball.

    Parameters
    ----------
    situation : Situation
        Situation with finite values.
    faces : sequence of Face
        At least one face, see `faces_ahead`.
    radius : float
        Radius of the ball [m].
    tuning : DecisionTuning
        Ground is assumed behind an edge as far as `unseen_room`; a step down that is higher than
        `highest_descent` is a drop, others are planned like steps up.
    line : float
        Stop line of other obstacles than faces [m].
    kept : bool
        Whether plans are already evaluated: then a step down is a drop only if it certainly
        exceeds `highest_descent`.

    """
    profile, position, slope = situation.profile, situation.motion.position, situation.slope
    floor = GroundProfile(profile.points, slope)
    seen = bool(profile.points)
    rows: List[Tuple[float, float, int, float, float]] = [
        (position - GROUND_EXTENSION, -GROUND_EXTENSION * math.tan(slope), -1, 0.0, 0.0)]
    here, level = position, 0.0
    ends: List[End] = []
    feet: List[int] = []
    descents = np.full(len(faces), math.inf)
    last, falls = -math.inf, False
    for index, face in enumerate(faces):
        foot = max(face.position, here)
        for x, rise in floor.bends(here, foot):
            rows.append((x, level + rise, index - 1, 1.0, 1.0))
        level += floor.rise(here, foot)
        feet.append(len(rows))
        rows.append((foot, level, index, 0.0, 1.0))
        level += face.height
        here = foot + max(face.run, 0.0)
        rows.append((here, level, index, 1.0, 1.0))
        if index + 1 < len(faces) and faces[index + 1].height > 0.0:
            # The ball sinks into a trench until it touches both edges, or to the level behind it.
            other = faces[index + 1]
            descents[index] = max(sink_depth(radius, other.position + other.run - foot),
                                  -face.height - other.height)
        doubt = SIGMAS * face.height_sd
        falls = falls or min(-face.height, descents[index]) > tuning.highest_descent + (
            doubt if kept else -doubt)
        if falls or index == FACES_MAX or index > 0 and foot - last > FACE_SEPARATION:
            continue
        if ends and foot - last < radius:
            ends.pop()  # a ball cannot stop between closer edges
        last = here
        ends.append(End(index + 1, len(rows) - 1, here, max(here, passed(face))))
    known = seen and profile.seen_to > here + radius
    seen_to = max(profile.seen_to if seen else here, here + tuning.unseen_room)
    for x, rise in floor.bends(here, seen_to):
        rows.append((x, level + rise, len(faces) - 1, 1.0, 1.0))
    level += floor.rise(here, seen_to)
    rows.append((seen_to, level, len(faces) - 1, 1.0, 1.0))
    last = seen_to + GROUND_EXTENSION
    rows.append((last, level + floor.rise(seen_to, last), len(faces) - 1, 1.0, 1.0))
    for number, end in enumerate(ends):
        if end.faces < len(faces):
            room = faces[end.faces].position - radius - end.position
            ends[number] = replace(end, following=feet[end.faces], after=(
                After.STOP if room < BRAKING_DISTANCE else After.CRUISE))
        else:
            ends[number] = replace(end, following=len(rows) - 1)
    return Ahead(
        np.array(rows), tuple(faces), tuple(ends), slope, situation.slope_sd,
        faces[0].touch(radius, slope), min(seen_to - radius - LINE_MARGIN, line), known, descents)
