# SPDX-License-Identifier: Apache-2.0
"""One crossing of a route, carried out by the obstacle decision."""
import math
from typing import Callable, Iterable, NamedTuple, Optional, Union

from ballbot_ros.decision import (
    CrossGoal, Decider, Ending, Kind, Knowledge, Motion, Observation, Planner)
from ballbot_ros.navigation.execution import CrossingReport


class CrossingStep(NamedTuple):
    """Set angle of the pendulum for law (11) [rad], and the report at the end of the crossing."""

    set_angle: float
    report: Optional[CrossingReport]


class CrossingDriver:
    """
    Lets a `Decider` drive over the step ahead, as often as a route needs it.

    The decider keeps the learned parameters of the robot from one crossing to the next, and
    discards the terrain: the odometry axis is the line of the crossing.

    Parameters
    ----------
    knowledge : Knowledge
    planner : str or callable
        See `Decider`.

    """

    def __init__(self, knowledge: Knowledge,
                 planner: Union[str, Callable[[Knowledge], Planner]] = 'rollout'):
        self.decider = Decider(knowledge, planner)
        self._goal: Optional[CrossGoal] = None
        self._touched = False

    @property
    def active(self) -> bool:
        """Return whether a crossing is under way."""
        return self._goal is not None

    def end(self) -> None:
        """Drop the crossing; the caller stops the ball."""
        self._goal = None
        self.decider.goals.end()

    def drive(self, motion: Motion, observations: Iterable[Observation]) -> CrossingStep:
        """Begin or continue; `motion` is along the line of the crossing."""
        decider = self.decider
        if self._goal is None:
            decider.reset()
            self._goal, self._touched = CrossGoal(motion, 0.0), False
            decider.goals.begin(self._goal)
        decider.move(motion)
        for observation in observations:
            decider.observe(observation)
        answer = decider.decide()
        if decider.outcome is not None or answer.decision.contact_since is not None:
            self._touched = True
        if decider.end is None:
            return CrossingStep(answer.set_angle, None)
        end, goal, planned = decider.end, self._goal, decider.planned
        self._goal = None
        too_high = planned is not None and planned.kind is Kind.GO_ROUND
        return CrossingStep(answer.set_angle, CrossingReport(
            end.ending is Ending.CROSSED, end.message,
            goal.height if too_high and goal is not None else math.nan, self._touched))
