# SPDX-License-Identifier: Apache-2.0
"""Values that the decision takes and gives."""
from dataclasses import astuple, dataclass
from enum import Enum
import math
from typing import Optional


class Kind(str, Enum):
    """What to do."""

    CLEAR = 'clear'
    CROSS = 'cross'
    STOP = 'stop'
    GO_ROUND = 'go_round'


class Reason(str, Enum):
    """Why."""

    NOTHING_AHEAD = 'nothing_ahead'
    WITHIN_CURVE = 'within_curve'
    COMMITTED = 'committed'
    TOO_HIGH = 'too_high'
    NO_ROOM = 'no_room'
    TOO_FAST = 'too_fast'
    DROP = 'drop'
    BAD_OBSERVATION = 'bad_observation'
    STALE = 'stale'
    CONTRADICTORY = 'contradictory'


@dataclass(frozen=True)
class StepObservation:
    """
    One look at the floor ahead, as a sensor gave it: nothing is checked yet.

    Attributes
    ----------
    stamp : float
        When it was made [s].
    detected : bool
        Whether there is a step; if not, distance and height are 0.
    distance : float
        Horizontally from the ball's centre to the face of the step [m].
    height : float
        Of the step [m], negative for a drop.
    distance_sd, height_sd : float
        Standard deviations [m], 0 if unknown.

    """

    stamp: float
    detected: bool
    distance: float = 0.0
    height: float = 0.0
    distance_sd: float = 0.0
    height_sd: float = 0.0

    @property
    def finite(self) -> bool:
        """Return whether all its numbers are finite."""
        return all(math.isfinite(number) for number in astuple(self))


@dataclass(frozen=True)
class TrackedStep:
    """
    A step, fused from observations.

    Attributes
    ----------
    number : int
        Counts the steps met, from 1.
    position : float
        Of its face along the odometry axis [m].
    height : float
        [m]
    position_sd, height_sd : float
        Standard deviations [m].

    """

    number: int
    position: float
    height: float
    position_sd: float
    height_sd: float


@dataclass(frozen=True)
class Track:
    """
    What the tracker knows after an observation.

    Attributes
    ----------
    stamp : float
        Of the observation [s].
    step : TrackedStep or None
        The next step; kept where an observation is rejected.
    rejection : Reason or None
        ``BAD_OBSERVATION`` or ``CONTRADICTORY``: do not act on it.
    explanation : str
        Of the rejection.

    """

    stamp: float
    step: Optional[TrackedStep] = None
    rejection: Optional[Reason] = None
    explanation: str = ''


@dataclass(frozen=True)
class Motion:
    """
    Where the ball is and how fast, by odometry.

    Attributes
    ----------
    stamp : float
        Now, on the clock of the observations [s].
    position, speed : float
        Of the ball's centre along its axis of travel [m], [m/s].

    """

    stamp: float
    position: float
    speed: float


@dataclass(frozen=True)
class Decision:
    """
    What to do, why, and with which numbers; NaN where there is no such number.

    Attributes
    ----------
    kind : Kind
    reason : Reason
    set_speed : float
        Speed to drive at [m/s].  With ``GO_ROUND`` only as far as there is room to stop.
    explanation : str
        One sentence for people.
    required_speed : float
        At touch, margins included [m/s].
    reachable_speed : float
        At touch, from here and within all limits [m/s].
    height : float
        Of the step [m].
    height_margin : float
        What could be added to the height, margins included, before the answer is no [m];
        negative by how much it is too high already.
    distance : float
        Ball's centre to the face [m].
    step : int
        Number of the step, 0 for none.
    contact_since : float or None
        When the ball touched the step that it is crossing [s].

    """

    kind: Kind
    reason: Reason
    set_speed: float
    explanation: str
    required_speed: float = math.nan
    reachable_speed: float = math.nan
    height: float = math.nan
    height_margin: float = math.nan
    distance: float = math.nan
    step: int = 0
    contact_since: Optional[float] = None
