# SPDX-License-Identifier: Apache-2.0
"""A goal: drive to a place, and rest there."""
from dataclasses import replace
import math
from typing import Optional

from ballbot_ros.decision.goals import (
    BEHIND, checked_timeout, Ending, GoalEnd, GoalWatch, stopping)
from ballbot_ros.decision.outcomes import Outcome
from ballbot_ros.decision.plan import Plan, Strategy
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.decision.values import Decision, FARTHEST, Kind, Motion
from ballbot_ros.errors import RefusedError

# Slower nobody drives: so fast the ball creeps back where it has rolled too far [m/s].
SLOWEST = 0.1
# Allowed tolerances, and the one that is taken where none is given [m].
FINEST, COARSEST, USUAL = 0.01, 1.0, 0.05
# The usual timeout: so many times what the way takes, and so much more [s].
TIMES, SPARE = 3.0, 20.0
ROUNDING = 1e-6  # [m/s]


class DriveGoal:
    """
    Rest at a place.

    Parameters
    ----------
    start : Motion
    target : float
        On the odometry axis [m].
    speed_limit : float
        [m/s]; infinite for none.
    tolerance : float
        [m]
    timeout : float
        [s]
    radius : float
        Of the ball [m].

    Attributes
    ----------
    canceled : bool

    """

    def __init__(self, start: Motion, target: float, speed_limit: float, tolerance: float,
                 timeout: float, radius: float):
        """Set out."""
        self.target, self._limit, self._tolerance = target, speed_limit, tolerance
        self._radius = radius
        self._watch = GoalWatch(start, timeout)
        self._backward = target < start.position
        self.canceled = False
        self._fast = 0  # step that takes more than the limit
        self._obstacle = ''  # why the ball does not go where the decision would

    def cancel(self) -> None:
        """Stop; the goal ends at rest."""
        self.canceled = True
        self._watch.cancel()

    def carry(self, planned: Decision, motion: Motion) -> Decision:
        """Return what is carried out of a decision."""
        self._obstacle = ''
        stop = self._watch.carry(planned)
        if stop is not None:
            return stop
        why = f'Driving to {self.target:.2f} m, {self.target - motion.position:.2f} m to go'
        speed = min(self._limit, planned.set_speed)
        if self._backward or self.target < motion.position:
            return stopping(planned, why, self.target, speed)
        if planned.kind is Kind.CLEAR:
            return stopping(planned, why, self.target, speed)
        if planned.kind in (Kind.CROSS, Kind.BACK_OFF):
            return self._at_step(planned, motion, why, speed)
        place = planned.plan.stop_position if planned.plan is not None else math.inf
        if self.target < place < math.inf:
            return stopping(planned, why, self.target, speed)
        return replace(planned, set_speed=speed)

    def _at_step(self, planned: Decision, motion: Motion, why: str, speed: float) -> Decision:
        """Return what is carried out of a decision to cross a step, now or after a run-up."""
        plan = planned.plan or Plan(Strategy.CRUISE, speed=planned.set_speed)
        face = motion.position + planned.distance
        edge = plan.edge if math.isfinite(plan.edge) else face
        before = face - self._radius
        # Written so that a required speed that is NaN does not count.
        needed = max(plan.speed, planned.required_speed)
        if self.target <= before:
            return stopping(planned, why, self.target, speed)
        if self.target < edge + BEHIND:
            self._obstacle = (
                f'{self.target:.2f} m is on the step at {face:.2f} m or less than {BEHIND:g} m '
                'behind its edge, where the ball cannot stop')
        elif self._fast == planned.step or needed > self._limit + ROUNDING:
            self._fast = planned.step  # also while a run-up for it is thought of
            self._obstacle = (f'the step at {face:.2f} m takes {needed:.2f} m/s, and '
                              f'{self._limit:g} m/s is the limit')
        else:
            return planned
        return stopping(planned, f'Stopping: {self._obstacle}', before - self._radius, speed)

    def update(self, planned: Decision, motion: Motion,
               outcome: Optional[Outcome]) -> Optional[GoalEnd]:
        """Return how the goal has ended, None as long as it has not."""
        going = self._backward or not self._obstacle and planned.kind not in (
            Kind.STOP, Kind.GO_ROUND)
        end = self._watch.update(going, motion, f'the way to {self.target:.2f} m')
        if end is not None:
            return end
        if self._watch.end is None:
            if self._watch.rests(motion) and abs(self.target - motion.position) \
                    <= self._tolerance:
                return GoalEnd(Ending.REACHED, f'at rest at {motion.position:.3f} m')
            if self._watch.refused(motion):
                return GoalEnd(Ending.BLOCKED, self._obstacle or planned.explanation)
            if self._watch.stuck(motion):
                self._watch.end = GoalEnd(Ending.BLOCKED, 'the ball does not get on')
        return None


def drive_goal(start: Motion, target: float, speed_limit: float, tolerance: float,
               timeout: float, tuning: DecisionTuning, radius: float,
               free_from: float) -> DriveGoal:
    """
    Return a goal from what was asked for; 0 stands for the usual limit, tolerance and timeout.

    Parameters
    ----------
    start : Motion
    target : float
        On the odometry axis [m].
    speed_limit : float
        [m/s]
    tolerance : float
        [m]
    timeout : float
        [s]
    tuning : DecisionTuning
    radius : float
        Of the ball [m].
    free_from : float
        Farthest position behind the ball that is known to be free [m].

    Raises
    ------
    RefusedError
        If something is not finite, or not allowed.

    """
    if not abs(target) < FARTHEST:
        raise RefusedError(f'target must be finite and within {FARTHEST:g} m, got {target:g}')
    if speed_limit and not SLOWEST <= speed_limit <= tuning.highest_speed:
        raise RefusedError(f'speed_limit must be 0 or {SLOWEST:g} to {tuning.highest_speed:g} '
                           f'm/s, the highest_speed of the tuning, got {speed_limit:g}')
    if tolerance and not FINEST <= tolerance <= COARSEST:
        raise RefusedError(
            f'tolerance must be 0 or {FINEST:g} to {COARSEST:g} m, got {tolerance:g}')
    tolerance = tolerance or USUAL
    if target < start.position and target < free_from - tolerance:
        raise RefusedError(
            f'target {target:.2f} m is behind the ball, where the ground is known to be free '
            f'from {free_from:.2f} m on only; room_behind of the tuning says how much is free '
            'at the start')
    way = abs(target - start.position)
    speed = SLOWEST if target < start.position else min(
        speed_limit or math.inf, tuning.cruise_speed)
    return DriveGoal(start, target, speed_limit or math.inf, tolerance,
                     checked_timeout(timeout, TIMES * way / speed + SPARE), radius)
