# SPDX-License-Identifier: Apache-2.0
"""
Goals: drive to a position, cross the step ahead.

A goal does not drive: it limits how far the decision is executed, and ends with the ball at rest.
Times are stamps of the motion.
"""
from dataclasses import dataclass, replace
from enum import Enum
import math
from typing import Optional, Tuple

from ballbot_ros.decision.learning.outcomes import Outcome
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.decision.values import (
    Decision, Kind, Motion, Plan, POSITION_MAX, Reason, REST_SPEED_MAX, Strategy)
from ballbot_ros.errors import RefusedError

# The ball rests after this time below `REST_SPEED_MAX` [s].
REST_TIME_MIN = 0.5
# A decision not to continue ends a goal after this time [s].
REFUSAL_TIME_MIN = 1.5
# The ball is stuck with less progress than this [m] within this time [s].
PROGRESS_MIN, PROGRESS_TIMEOUT = 0.03, 6.0
TIMEOUT_MAX = 3600.0  # [s]
# Clearance behind an edge for stopping without rolling back over it [m].
ROOM_BEHIND_EDGE_MIN = 0.5


class Ending(str, Enum):
    """Result of a goal; the names are those of the actions."""

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
    """Result of a goal, with one sentence."""

    ending: Ending
    message: str


def stopping(planned: Decision, why: str, place: float = math.inf,
             speed: float = 0.0) -> Decision:
    """Return the stop that replaces a decision: at a position [m], or as soon as possible."""
    return replace(planned, kind=Kind.STOP, reason=Reason.GOAL, set_speed=speed, explanation=why,
                   plan=Plan(Strategy.STOP, speed=speed, stop_position=place))


class Goal:
    """
    A goal: limits the execution of each decision, and determines its own end.

    A timeout of 0 selects the default [s].  Raises `RefusedError` if it is out of range.
    """

    def __init__(self, start: Motion, timeout: float, default: float):
        if not 0.0 <= timeout <= TIMEOUT_MAX:
            raise RefusedError(f'timeout must be 0 to {TIMEOUT_MAX:g} s, got {timeout:g}',
                               'out_of_range', 'timeout')
        self._timeout = timeout or default
        self._deadline = start.stamp + self._timeout
        self._moving = self._going = start.stamp  # last time in this state
        self._anchor = start.position, start.stamp
        self._end: Optional[GoalEnd] = None  # effective as soon as the ball rests
        self.canceled = False

    def cancel(self) -> None:
        """Stop the ball; the goal ends when it rests."""
        self.canceled = True
        self._end = GoalEnd(Ending.CANCELED, 'the ball was stopped')

    def constrain(self, planned: Decision, motion: Motion) -> Decision:
        """Return the executed part of a decision."""
        if self._end is not None:
            return stopping(planned, f'Stopping: {self._end.message}')
        return self._constrain(planned, motion)

    @property
    def stops(self) -> bool:
        """Return whether the goal is ending and stops the ball."""
        return self._end is not None

    def _constrain(self, planned: Decision, motion: Motion) -> Decision:
        """Return the executed part of a decision while the goal is not ending."""
        raise NotImplementedError

    def update(self, planned: Decision, motion: Motion,
               outcome: Optional[Outcome]) -> Optional[GoalEnd]:
        """Return the end of the goal, None while it is active."""
        raise NotImplementedError

    def _monitor(self, going: bool, motion: Motion, aim: str) -> Optional[GoalEnd]:
        """
        Return the end of the goal once the ball rests, else None.

        `going`: whether the decision continues; `aim`: the target, for the timeout message.
        """
        now = motion.stamp
        if abs(motion.speed) > REST_SPEED_MAX:
            self._moving = now
        if going:
            self._going = now
        if abs(motion.position - self._anchor[0]) > PROGRESS_MIN:
            self._anchor = motion.position, now
        if self._end is None and now > self._deadline:
            self._end = GoalEnd(Ending.TIMED_OUT, f'{aim} took more than {self._timeout:g} s')
        return self._end if self._rests(motion) else None

    def _rests(self, motion: Motion) -> bool:
        """Return whether the ball rests."""
        return motion.stamp - self._moving >= REST_TIME_MIN

    def _refused(self, motion: Motion) -> bool:
        """Return whether the ball rests because the decision does not continue."""
        return self._rests(motion) and motion.stamp - self._going >= REFUSAL_TIME_MIN


class Goals:
    """Executes one goal at a time; the ball then rests until the next one, or `go_on`."""

    def __init__(self) -> None:
        self.goal: Optional[Goal] = None
        self.waiting = False  # whether the ball rests until a goal arrives
        self._crossing = False  # whether the last executed decision crosses a step

    def begin(self, goal: Goal) -> None:
        """Start a goal; raises `RefusedError` while another one is active."""
        if self.goal is not None:
            raise RefusedError('another goal is active: cancel it first', 'busy', 'goal')
        self.goal, self.waiting = goal, True

    def go_on(self) -> None:
        """Execute decisions without a goal."""
        if self.goal is not None:
            raise RefusedError('a goal is active: cancel it first', 'busy', 'goal')
        self.waiting = False

    def end(self) -> None:
        """Drop the goal immediately."""
        self.goal = None

    def constrain(self, planned: Decision, motion: Motion) -> Decision:
        """Return the executed part of a decision."""
        # A stop continues a crossing past its last braking point, but does not start one.
        stops = self.waiting if self.goal is None else self.goal.stops
        if planned.committed and (self._crossing or not stops):
            executed = planned
        elif self.goal is not None:
            executed = self.goal.constrain(planned, motion)
        elif self.waiting:
            executed = stopping(planned, 'Standing: waiting for a goal or for ~/resume')
        else:
            executed = planned
        self._crossing = executed.kind is Kind.CROSS
        return executed

    def update(self, planned: Decision, motion: Motion,
               outcome: Optional[Outcome]) -> Optional[GoalEnd]:
        """Return the end of the goal if this update ended it."""
        end = None if self.goal is None else self.goal.update(planned, motion, outcome)
        if end is not None:
            self.goal = None
        return end


# Minimum speed limit, and speed at which the ball returns after an overshoot [m/s].
SPEED_LIMIT_MIN = 0.1
# Allowed tolerances, and the default [m].
TOLERANCE_MIN, TOLERANCE_MAX, TOLERANCE_DEFAULT = 0.01, 1.0, 0.05
# Default timeout: this multiple of the travel time, plus a constant [s].
TIMEOUT_PER_TRAVEL_TIME, TIMEOUT_MIN = 3.0, 20.0
ROUNDING_TOLERANCE = 1e-6  # [m/s]


class DriveGoal(Goal):
    """
    Drive to a position and rest there; 0 selects the default limit, tolerance and timeout.

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
        If a value is not finite, or not allowed.

    """

    def __init__(self, start: Motion, target: float, speed_limit: float, tolerance: float,
                 timeout: float, tuning: DecisionTuning, radius: float, free_from: float):
        if not abs(target) < POSITION_MAX:
            raise RefusedError(
                f'target must be finite and within {POSITION_MAX:g} m, got {target:g}',
                'out_of_range', 'target')
        if speed_limit and not SPEED_LIMIT_MIN <= speed_limit <= tuning.highest_speed:
            raise RefusedError(
                f'speed_limit must be 0 or {SPEED_LIMIT_MIN:g} to {tuning.highest_speed:g} m/s, '
                f'the highest_speed of the tuning, got {speed_limit:g}',
                'out_of_range', 'speed_limit')
        if tolerance and not TOLERANCE_MIN <= tolerance <= TOLERANCE_MAX:
            raise RefusedError(f'tolerance must be 0 or {TOLERANCE_MIN:g} to {TOLERANCE_MAX:g} m, '
                               f'got {tolerance:g}', 'out_of_range', 'tolerance')
        tolerance = tolerance or TOLERANCE_DEFAULT
        if target < start.position and target < free_from - tolerance:
            raise RefusedError(
                f'target {target:.2f} m is behind the ball, where the ground is known to be free '
                f'only from {free_from:.2f} m on; room_behind of the tuning sets how much is free '
                'at the start', 'out_of_range', 'target')
        distance = abs(target - start.position)
        speed = SPEED_LIMIT_MIN if target < start.position else min(
            speed_limit or math.inf, tuning.cruise_speed)
        super().__init__(start, timeout, TIMEOUT_PER_TRAVEL_TIME * distance / speed + TIMEOUT_MIN)
        self.target, self._limit, self._tolerance = target, speed_limit or math.inf, tolerance
        self._radius = radius
        self._backward = target < start.position
        self._fast = 0  # step that requires more than the limit
        self._obstacle = ''  # why the ball does not follow the decision

    def _constrain(self, planned: Decision, motion: Motion) -> Decision:
        self._obstacle = ''
        why = f'Driving to {self.target:.2f} m, {self.target - motion.position:.2f} m to go'
        speed = min(self._limit, planned.set_speed)
        if self._backward or self.target < motion.position or planned.kind is Kind.CLEAR:
            return stopping(planned, why, self.target, speed)
        if planned.kind in (Kind.CROSS, Kind.BACK_OFF):
            return self._at_step(planned, motion, why, speed)
        if self.target < planned.plan.stop_position < math.inf:
            return stopping(planned, why, self.target, speed)
        return replace(planned, set_speed=speed)

    def _at_step(self, planned: Decision, motion: Motion, why: str, speed: float) -> Decision:
        """Return the executed part of a decision to cross a step, now or after a run-up."""
        face = motion.position + planned.distance
        before = face - self._radius
        # Written so that a required speed that is NaN does not count.
        needed = max(planned.plan.speed, planned.required_speed)
        if self.target <= before:
            return stopping(planned, why, self.target, speed)
        if self.target < planned.last_edge(motion.position) + ROOM_BEHIND_EDGE_MIN:
            self._obstacle = (
                f'{self.target:.2f} m is on the step at {face:.2f} m or less than '
                f'{ROOM_BEHIND_EDGE_MIN:g} m behind its edge, where the ball cannot stop')
        elif self._fast == planned.step or needed > self._limit + ROUNDING_TOLERANCE:
            self._fast = planned.step  # also while a run-up for it is evaluated
            self._obstacle = (f'the step at {face:.2f} m requires {needed:.2f} m/s, and '
                              f'{self._limit:g} m/s is the limit')
        else:
            return planned
        return stopping(planned, f'Stopping: {self._obstacle}', before - self._radius, speed)

    def update(self, planned: Decision, motion: Motion,
               outcome: Optional[Outcome]) -> Optional[GoalEnd]:
        """Return the end of the goal, None while it is active."""
        going = self._backward or not self._obstacle and not planned.refuses
        end = self._monitor(going, motion, f'the drive to {self.target:.2f} m')
        if end is not None:
            return end
        if self._end is None:
            if self._rests(motion) and abs(self.target - motion.position) <= self._tolerance:
                return GoalEnd(Ending.REACHED, f'at rest at {motion.position:.3f} m')
            if self._refused(motion):
                return GoalEnd(Ending.BLOCKED, self._obstacle or planned.explanation)
            if motion.stamp - self._anchor[1] >= PROGRESS_TIMEOUT:
                self._end = GoalEnd(Ending.BLOCKED, 'the ball makes no progress')
        return None


CROSSING_TIMEOUT = 60.0  # default [s]


class Phase(str, Enum):
    """Phase of the crossing of a step."""

    APPROACHING = 'approaching'
    CROSSING = 'crossing'
    STOPPING = 'stopping'


class CrossGoal(Goal):
    """
    Cross the step ahead and rest behind it; a timeout of 0 selects the default [s].

    Attributes
    ----------
    phase : Phase
    height : float
        Height of the step, NaN before one is observed [m].

    """

    def __init__(self, start: Motion, timeout: float):
        super().__init__(start, timeout, CROSSING_TIMEOUT)
        self._edge: Optional[Tuple[float, int]] = None  # position [m], and number of the step
        self.phase, self.height = Phase.APPROACHING, math.nan

    def _constrain(self, planned: Decision, motion: Motion) -> Decision:
        if self._finds_none(planned):
            return stopping(planned, 'Standing: no step is in sight')
        if self._crosses_next(planned, motion):
            return stopping(planned, 'Stopping between two steps')
        return planned

    def _crosses_next(self, planned: Decision, motion: Motion) -> bool:
        """
        Return whether a decision crosses another step, behind that of the goal.

        Before its edge, the step may get another number.
        """
        return planned.kind is Kind.CROSS and self._edge is not None \
            and motion.position >= self._edge[0] and planned.step != self._edge[1]

    def _finds_none(self, planned: Decision) -> bool:
        return self._edge is None and planned.kind is Kind.CLEAR and planned.step == 0

    def update(self, planned: Decision, motion: Motion,
               outcome: Optional[Outcome]) -> Optional[GoalEnd]:
        """Return the end of the goal, None while it is active."""
        self._note(planned, motion, outcome)
        none = self._finds_none(planned)
        going = not none and not planned.refuses
        end = self._monitor(going, motion, 'the crossing')
        if end is not None:
            return end
        if self._end is None and self._refused(motion):
            return GoalEnd(Ending.NO_STEP, 'no step is in sight') if none \
                else GoalEnd(Ending.REFUSED, planned.explanation)
        return None

    def _note(self, planned: Decision, motion: Motion, outcome: Optional[Outcome]) -> None:
        """Update the step, and the phase of its crossing."""
        if planned.kind is Kind.CROSS and not self._crosses_next(planned, motion):
            self._edge = planned.last_edge(motion.position), planned.step
        if planned.step and not math.isnan(planned.height) and self._end is None \
                and (self._edge is None or self._edge[1] == planned.step):
            self.height = planned.height
        over = outcome is not None and outcome.crossed
        room = 0.0 if self._rests(motion) else ROOM_BEHIND_EDGE_MIN
        past = self._edge is not None and motion.position > self._edge[0] + room \
            and not (planned.kind is Kind.CROSS and planned.step == self._edge[1])
        if (over or past) and self._end is None:
            self._end = GoalEnd(
                Ending.CROSSED, f'over the step of {1e3 * self.height:.0f} mm')
        self.phase = Phase.CROSSING if planned.contact_since is not None else (
            Phase.STOPPING if self._end is not None else Phase.APPROACHING)
