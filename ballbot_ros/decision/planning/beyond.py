# SPDX-License-Identifier: Apache-2.0
"""What lies behind a face, and how steep the ground ahead gets."""
from dataclasses import dataclass
import math
from typing import Optional, Tuple

from ballbot_ros.crossing.rules import touch_distance
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.decision.values import Face, Profile

# Down by less than this is an uneven floor, more is a drop [m].
SMALLEST_DROP = 0.005

# The centre stays this far before what it must not reach [m].
KEPT_OFF = 0.03

# Less than this of the ground behind an edge is none that is seen [m].
GLIMPSE = 0.1

# Slopes are those over such a length [m]; noise of less makes slopes of its own.
SLOPE_LENGTH = 0.2

# Steeper than this is no slope but a face, which is judged as one [rad].
FACE_SLOPE = 0.35


@dataclass(frozen=True)
class Beyond:
    """
    What lies behind a face.

    Attributes
    ----------
    edge : float
        The last edge of faces that are taken in one go [m]: those that lead back to the floor
        before the first one.
    room : float
        For the centre, behind that edge [m].
    known : bool
        Whether something is known to end the room; otherwise no more is seen.
    trouble : str
        What ends the room.

    """

    edge: float
    room: float
    known: bool
    trouble: str


def beyond(profile: Profile, face: Face, radius: float, passable: float,
           tuning: DecisionTuning) -> Beyond:
    """
    Return what lies behind a face.

    Parameters
    ----------
    profile : Profile
    face : Face
        That is to be crossed.
    radius : float
        Of the ball [m].
    passable : float
        Height of steps that are crossed with what is left of the speed [m].
    tuning : DecisionTuning
        Its `unseen_room` is taken for granted.

    """
    edge, level = face.position + max(0.0, face.run), face.height
    known = profile.seen_to if profile.points else -math.inf
    # Where some of it is seen, something ends the sight there.
    taken = edge + tuning.unseen_room if known < edge + GLIMPSE else known
    end, trouble = taken, ''
    for other in profile.faces:
        if other.position <= face.position or other.number == face.number:
            continue
        at = other.position - KEPT_OFF - tuning.sigma_margin * other.position_sd
        if other.height > passable:
            at -= touch_distance(radius, other.height)
            what = 'a wall' if other.height >= radius else f'{1e3 * other.height:.0f} mm more'
        elif level + other.height < -SMALLEST_DROP:
            what = f'a drop of {-1e3 * other.height:.0f} mm'
        else:
            level += other.height
            # Down again at once, as behind a door-sill: one thing to cross.
            if other.height < -SMALLEST_DROP and other.position - edge < tuning.unseen_room:
                edge = other.position + touch_distance(radius, -other.height)
                end = known if known >= edge + GLIMPSE else edge + tuning.unseen_room
            continue
        if at < end:
            end, trouble = at, what
        break
    return Beyond(edge, max(0.0, end - edge), bool(trouble), trouble or 'what is not seen')


def steep_ahead(profile: Profile, position: float,
                steepest: float) -> Optional[Tuple[float, float]]:
    """
    Return where the ground ahead gets steeper than can be held, and its slope, or None.

    Parameters
    ----------
    profile : Profile
    position : float
        Of the ball's centre [m].
    steepest : float
        [rad]

    Returns
    -------
    (float, float) or None
        Position [m] and slope, positive uphill [rad].

    """
    points = profile.points
    for index, (x, z) in enumerate(points):
        if x < position:
            continue
        far = next(((u, w) for u, w in points[index + 1:] if u - x >= SLOPE_LENGTH), None)
        if far is None:
            return None
        if any(x - 0.01 <= face.position <= far[0] + 0.01 for face in profile.faces):
            continue
        slope = math.atan2(far[1] - z, far[0] - x)
        if steepest < abs(slope) < FACE_SLOPE:
            return x, slope
    return None
