# SPDX-License-Identifier: Apache-2.0
"""A goal: cross the step ahead, and rest behind it."""
from enum import Enum
import math
from typing import Optional, Tuple

from ballbot_ros.decision.goals import (
    BEHIND, checked_timeout, Ending, GoalEnd, GoalWatch, stopping)
from ballbot_ros.decision.outcomes import Outcome
from ballbot_ros.decision.values import Decision, Kind, Motion

USUAL_TIMEOUT = 60.0  # [s]


class Phase(str, Enum):
    """What the ball does about a step that it is to cross."""

    APPROACHING = 'approaching'
    CROSSING = 'crossing'
    STOPPING = 'stopping'


class CrossGoal:
    """
    Rest behind the step ahead.

    Parameters
    ----------
    start : Motion
    timeout : float
        [s]

    Attributes
    ----------
    phase : Phase
    height : float
        Of the step, NaN before one was seen [m].
    canceled : bool

    """

    def __init__(self, start: Motion, timeout: float):
        """Set out."""
        self._watch = GoalWatch(start, timeout)
        self._edge: Optional[Tuple[float, int]] = None  # of the step, and its number
        self.phase, self.height, self.canceled = Phase.APPROACHING, math.nan, False

    def cancel(self) -> None:
        """Stop; the goal ends at rest."""
        self.canceled = True
        self._watch.cancel()

    def carry(self, planned: Decision, motion: Motion) -> Decision:
        """Return what is carried out of a decision."""
        stop = self._watch.carry(planned)
        if stop is None and self._sees_none(planned):
            return stopping(planned, 'Standing: no step is in sight')
        return stop or planned

    def _sees_none(self, planned: Decision) -> bool:
        return self._edge is None and planned.kind is Kind.CLEAR and planned.step == 0

    def update(self, planned: Decision, motion: Motion,
               outcome: Optional[Outcome]) -> Optional[GoalEnd]:
        """Return how the goal has ended, None as long as it has not."""
        self._note(planned, motion, outcome)
        none = self._sees_none(planned)
        going = not none and planned.kind not in (Kind.STOP, Kind.GO_ROUND)
        end = self._watch.update(going, motion, 'the step')
        if end is not None:
            return end
        if self._watch.end is None and self._watch.refused(motion):
            return GoalEnd(Ending.NO_STEP, 'no step is in sight') if none \
                else GoalEnd(Ending.REFUSED, planned.explanation)
        return None

    def _note(self, planned: Decision, motion: Motion, outcome: Optional[Outcome]) -> None:
        """Take note of the step, and of how the ball comes on with it."""
        if planned.step and not math.isnan(planned.height) and self._watch.end is None \
                and (self._edge is None or self._edge[1] == planned.step):
            self.height = planned.height  # behind the step, the next one is decided about
        if planned.kind is Kind.CROSS and (
                self._edge is None or self._edge[1] == planned.step):
            plan = planned.plan
            self._edge = (plan.edge if plan is not None and math.isfinite(plan.edge)
                          else motion.position + planned.distance), planned.step
        over = outcome is not None and outcome.got_over
        past = self._edge is not None and motion.position > self._edge[0] + BEHIND \
            and not (planned.kind is Kind.CROSS and planned.step == self._edge[1])
        if (over or past) and self._watch.end is None:
            self._watch.end = GoalEnd(
                Ending.CROSSED, f'over the step of {1e3 * self.height:.0f} mm')
        self.phase = Phase.CROSSING if planned.contact_since is not None else (
            Phase.STOPPING if self._watch.end is not None else Phase.APPROACHING)


def cross_goal(start: Motion, timeout: float) -> CrossGoal:
    """Return a goal from what was asked for; 0 stands for the usual timeout [s]."""
    return CrossGoal(start, checked_timeout(timeout, USUAL_TIMEOUT))
