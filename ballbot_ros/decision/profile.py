# SPDX-License-Identifier: Apache-2.0
"""The ground ahead as it is believed to be: what observations were fused into."""
from dataclasses import dataclass
from typing import Optional, Tuple

from ballbot_ros.decision.values import Reason


@dataclass(frozen=True)
class Face:
    """
    Where the ground rises or drops too steeply to be rolled along.

    Attributes
    ----------
    number : int
        Counts the faces met, from 1.
    position : float
        Of its foot, or of its upper edge where it drops, along the odometry axis [m].
    height : float
        [m], negative for a drop.
    position_sd, height_sd : float
        Standard deviations [m].
    run : float
        Its horizontal extent [m]: 0 for a vertical face, more for a bevel or a steep ramp.

    """

    number: int
    position: float
    height: float
    position_sd: float
    height_sd: float
    run: float = 0.0


@dataclass(frozen=True)
class Profile:
    """
    The ground ahead, in odometry coordinates.

    Attributes
    ----------
    stamp : float
        Of the newest observation in it [s].
    faces : tuple of Face
        Ahead of the ball or below it, from near to far.
    points : tuple of (float, float)
        Polyline of the ground: position [m], height above the floor below the ball [m]; empty
        where a sensor sees the next face only.
    seen_from, seen_to : float
        Positions between which the ground is known [m].
    slope, slope_sd : float
        Of the ground below the ball, positive uphill [rad]; NaN where it is not seen.
    points_sd : tuple of float
        Standard deviations of the heights of the points [m].
    gaps : tuple of (float, float)
        Between these positions nothing was seen, though `seen_from` and `seen_to` are around
        them: what edges hide.  The polyline drops there at once to what is seen next [m].
    bias_sd : float
        Part of the deviations of heights that is the same for all faces, and that no number of
        looks brings down [m].
    rejection : Reason or None
        ``BAD_OBSERVATION`` or ``CONTRADICTORY``: do not act on it.
    explanation : str
        Of the rejection.

    """

    stamp: float
    faces: Tuple[Face, ...] = ()
    points: Tuple[Tuple[float, float], ...] = ()
    seen_from: float = float('-inf')
    seen_to: float = float('inf')
    slope: float = float('nan')
    slope_sd: float = float('nan')
    rejection: Optional[Reason] = None
    explanation: str = ''
    points_sd: Tuple[float, ...] = ()
    gaps: Tuple[Tuple[float, float], ...] = ()
    bias_sd: float = 0.0

    @property
    def face(self) -> Optional[Face]:
        """Return the next face."""
        return self.faces[0] if self.faces else None
