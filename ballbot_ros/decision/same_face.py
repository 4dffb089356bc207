# SPDX-License-Identifier: Apache-2.0
"""
Whether a face that is seen now is the one that the ball touched, where odometry may slip.

A ball that spins at the foot of a step seems to roll through it, and the step comes up again
ahead, under another number.  A second edge behind the first looks the same at first glance.  What
tells them apart: the step moves along with the odometry, the second edge stays where it is.
"""
from dataclasses import astuple, dataclass
import math
from typing import Optional, Tuple

from ballbot_ros.crossing.rules import touch_distance
from ballbot_ros.decision.profile import Face, Profile

# Faces of one kind: their heights differ by no more, in part and in m.
ALIKE, ALIKE_WITHIN = 0.3, 0.008
# A face that came up again is no farther ahead than where the ball touches it, and this [m].
NEAR = 0.05
# After so much odometry a face must have moved with it by this part, or it is another one [m].
LOOKED, MOVED = 0.05, 0.3


@dataclass(frozen=True)
class Doubt:
    """
    A face that may be the one that was touched, come up again.

    Attributes
    ----------
    number : int
    place : float
        Where it was first seen [m].
    odometry : float
        Where the ball was then [m].
    settled : bool
        It is another one.

    """

    number: int
    place: float
    odometry: float
    settled: bool = False


def come_up_again(touched: Face, known: Tuple[int, ...], doubt: Optional[Doubt],
                  position: float, seen: Profile,
                  radius: float) -> Tuple[Optional[Face], Optional[Doubt]]:
    """
    Look for a face that was touched, still ahead.

    Parameters
    ----------
    touched : Face
    known : tuple of int
        Numbers of the faces that were known at the touch; of these, only the one that was
        touched can be it.
    doubt : Doubt or None
        What was returned last.
    position : float
        Of the centre [m].
    seen : Profile
    radius : float
        Of the ball [m].

    Returns
    -------
    face : Face or None
        What is, or may be, the touched one.
    doubt : Doubt or None

    """
    for item in seen.faces:
        if item.position <= position:
            continue
        if item.number == touched.number:
            return item, doubt
        near = item.position - position < touch_distance(radius, touched.height) + NEAR
        if item.number in known or not near or not alike(item, touched):
            continue
        if doubt is None or doubt.number != item.number:
            doubt = Doubt(item.number, item.position, position)
        rolled = position - doubt.odometry
        if rolled > LOOKED and abs(item.position - doubt.place) < MOVED * rolled:
            doubt = Doubt(item.number, item.position, position, settled=True)
        return (None if doubt.settled else item), doubt
    return None, doubt


def alike(one: Face, other: Face) -> bool:
    """Return whether two faces are of one height, as far as can be told."""
    return abs(one.height - other.height) <= max(ALIKE * abs(other.height), ALIKE_WITHIN)


def sane(profile: Profile) -> bool:
    """Return whether all numbers of the faces are finite, and none is absurd."""
    return all(all(map(math.isfinite, astuple(face))) and abs(face.height) < 10.0
               and face.position_sd >= 0.0 and face.height_sd >= 0.0 for face in profile.faces)
