# SPDX-License-Identifier: Apache-2.0
"""
Goals that somebody sets: drive to a place, cross the step ahead.

A goal does not drive: it says how far the decision is followed, and ends in rest.  Time is that
of the motion.
"""
from dataclasses import dataclass, replace
from enum import Enum
import math
from typing import Optional, Protocol

from ballbot_ros.decision.outcomes import Outcome
from ballbot_ros.decision.plan import Plan, Strategy
from ballbot_ros.decision.values import Decision, Kind, Motion, Reason
from ballbot_ros.errors import RefusedError

# The ball rests when it has been slower than this [m/s] for so long [s].
RESTING, RESTS_AFTER = 0.03, 0.5
# A decision that does not go on, or sees no step, is believed after this time [s].
BELIEVED_AFTER = 1.5
# Without so much progress [m] in such a time [s] the ball does not get on.
PROGRESS, PATIENCE = 0.03, 6.0
LONGEST = 3600.0  # timeout [s]
# A ball behind an edge needs so much room to stop without rolling back over it [m].
BEHIND = 0.5


class Ending(str, Enum):
    """How a goal ended; named as in the actions."""

    REACHED = 'reached'
    CROSSED = 'crossed'
    BLOCKED = 'blocked'
    REFUSED = 'refused'
    CANCELED = 'canceled'
    E_STOP = 'e_stop'
    TIMED_OUT = 'timed_out'
    LOST = 'lost'
    NO_STEP = 'no_step'


@dataclass(frozen=True)
class GoalEnd:
    """
    How a goal ended.

    Attributes
    ----------
    ending : Ending
    message : str
        One sentence.

    """

    ending: Ending
    message: str


class Goal(Protocol):
    """What `Goals` needs of a goal."""

    def carry(self, planned: Decision, motion: Motion) -> Decision:
        """Return what is carried out of a decision."""

    def update(self, planned: Decision, motion: Motion,
               outcome: Optional[Outcome]) -> Optional[GoalEnd]:
        """Return how the goal has ended, None as long as it has not."""

    def cancel(self) -> None:
        """Stop; the goal ends at rest."""


def committed(decision: Decision) -> bool:
    """Return whether a decision crosses a step that the ball cannot stop before any more."""
    return decision.kind is Kind.CROSS and (
        decision.reason is Reason.COMMITTED or decision.contact_since is not None)


def stopping(planned: Decision, why: str, place: float = math.inf,
             speed: float = 0.0) -> Decision:
    """Return the stop in place of a decision: at a place [m], or else as soon as possible."""
    return replace(planned, kind=Kind.STOP, reason=Reason.GOAL, set_speed=speed, explanation=why,
                   plan=Plan(Strategy.STOP, speed=speed, stop_position=place))


class GoalWatch:
    """
    Watches the ball for a goal: rest, progress, the time that is left, and a stop on the way.

    Parameters
    ----------
    start : Motion
    timeout : float
        [s]

    Attributes
    ----------
    end : GoalEnd or None
        With which the goal will end as soon as the ball rests.

    """

    def __init__(self, start: Motion, timeout: float):
        """Begin to watch."""
        self._timeout, self._deadline = timeout, start.stamp + timeout
        self._moving = self._going = start.stamp  # last seen so
        self._anchor = start.position, start.stamp
        self.end: Optional[GoalEnd] = None

    def cancel(self) -> None:
        """Have the ball stop because somebody asks for it."""
        self.end = GoalEnd(Ending.CANCELED, 'canceled: the ball was stopped')

    def carry(self, planned: Decision) -> Optional[Decision]:
        """Return the stop that is on, or the crossing that is too late to stop."""
        if committed(planned):
            return planned
        return None if self.end is None else stopping(planned, f'Stopping: {self.end.message}')

    def update(self, going: bool, motion: Motion, aim: str) -> Optional[GoalEnd]:
        """
        Return the end, once the ball rests.

        Parameters
        ----------
        going : bool
            Whether the decision goes on.
        motion : Motion
        aim : str
            That is named where it is not reached.

        """
        now = motion.stamp
        if abs(motion.speed) > RESTING:
            self._moving = now
        if going:
            self._going = now
        if abs(motion.position - self._anchor[0]) > PROGRESS:
            self._anchor = motion.position, now
        if self.end is None and now > self._deadline:
            self.end = GoalEnd(Ending.TIMED_OUT, f'{aim} took more than {self._timeout:g} s')
        return self.end if self.rests(motion) else None

    def rests(self, motion: Motion) -> bool:
        """Return whether the ball has been at rest for a while."""
        return motion.stamp - self._moving >= RESTS_AFTER

    def refused(self, motion: Motion) -> bool:
        """Return whether the ball rests because the decision does not go on."""
        return self.rests(motion) and motion.stamp - self._going >= BELIEVED_AFTER

    def stuck(self, motion: Motion) -> bool:
        """Return whether the ball has not got on for long."""
        return motion.stamp - self._anchor[1] >= PATIENCE


def checked_timeout(timeout: float, default: float) -> float:
    """Return the timeout of a goal [s]; 0 takes the default."""
    if not 0.0 <= timeout <= LONGEST:
        raise RefusedError(f'timeout must be 0 to {LONGEST:g} s, got {timeout:g}')
    return timeout or default


class Goals:
    """
    One goal at a time, and rest after it until somebody asks to go on.

    Parameters
    ----------
    waiting : bool
        Whether the ball stands until there is a goal.

    Attributes
    ----------
    goal : Goal or None
    waiting : bool

    """

    def __init__(self, waiting: bool = False):
        """Start without a goal."""
        self.goal: Optional[Goal] = None
        self.waiting = waiting

    def begin(self, goal: Goal) -> None:
        """Take a goal; raises `RefusedError` while there is one."""
        if self.goal is not None:
            raise RefusedError('another goal is under way: cancel it first')
        self.goal, self.waiting = goal, True

    def go_on(self) -> None:
        """Do without goals what the decision says."""
        if self.goal is not None:
            raise RefusedError('a goal is under way: cancel it first')
        self.waiting = False

    def end(self) -> None:
        """Forget the goal at once."""
        self.goal = None

    def carry(self, planned: Decision, motion: Motion) -> Decision:
        """Return what is carried out of a decision."""
        if self.goal is not None:
            return self.goal.carry(planned, motion)
        if self.waiting and not committed(planned):
            return stopping(planned, 'Standing: waiting for a goal, or to be told to go on')
        return planned

    def update(self, planned: Decision, motion: Motion,
               outcome: Optional[Outcome]) -> Optional[GoalEnd]:
        """Return how the goal has ended, if it just has."""
        end = None if self.goal is None else self.goal.update(planned, motion, outcome)
        if end is not None:
            self.goal = None
        return end
