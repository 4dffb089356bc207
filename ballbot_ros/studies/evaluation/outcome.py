# SPDX-License-Identifier: Apache-2.0
"""
The outcome of an approach, from the true state and terrain.

A face is *being crossed* while the decision in force is CROSS and the last edge of its plan
(without a plan: the step that it names) is not before that face.

``over``       the centre has passed the goal by 0.25 m
``fell``       the ball has descended more than 5 mm below the edge of a drop that it was not
               crossing when the centre passed the edge, or of any drop deeper than 60 mm.
               The far side of an obstacle narrower than 50 mm, such as a cord, is not a drop
``hit``        the ball touched a face of 5 mm or more, faster than 0.1 m/s, that it was not
               crossing then or within the 0.1 s before; contact with a face of up to 8 mm while
               the decision is CLEAR or CROSS is a *bump*, which is counted separately
``stopped``    the ball rested for 1 s, and the decision was to stop or to go round
``ran away``   the ball was 0.25 m beyond `room_behind`, or faster than 1.5 times the highest speed
``stuck``      the ball rested for 4 s, or the time limit passed, while the ball touched a face
``idle``       the ball rested for 4 s, and the decision was to move
``undecided``  the time limit passed
"""
from collections import deque
from dataclasses import dataclass, field
import math
from typing import Deque, Dict, List, Optional, Tuple

import numpy as np

from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.decision.values import Decision, Kind
from ballbot_ros.physics.model.state import State
from ballbot_ros.studies.evaluation.approaches import Approach
from ballbot_ros.studies.evaluation.closed_loop import (
    AX, AY, BX, BY, ClosedLoop, PERIOD, TOUCH_PERIOD, TOUCH_SPEED)
from ballbot_ros.studies.evaluation.terrains import true_faces

OUTCOMES = ('over', 'stopped', 'fell', 'hit', 'ran away', 'stuck', 'idle', 'undecided')

GOAL_MARGIN = 0.25         # beyond the goal [m]
# Depths of a drop that counts, and of one that may be crossed [m].
FALL_DEPTH_MIN, DROP_CROSSABLE_MAX = 0.005, 0.06
CORD_WIDTH = 0.05          # largest width of an obstacle without a drop on its far side [m]
PENETRATION = 0.003        # largest penetration of a rolling ball into the ground [m]
HIT_SPEED_MIN, BUMP_HEIGHT_MAX = 0.1, 0.008     # [m/s], [m]
CANCELLATION_TIME = 0.1            # a crossing counts for this time after its cancellation [s]
RESTING_SPEED_MAX, REST_TIME_MIN, IDLE_TIME_MAX = 0.01, 1.0, 4.0  # [m/s], [s], [s]
POSITION_ERROR_MAX, SPEED_EXCESS_MAX = 0.25, 1.5  # [m], over the highest speed
SAME_FACE = 0.06           # position error of a face [m]
RETREAT_MIN = 0.03                # retreat from the touch after which an attempt has failed [m]
OUTCOME_DELAY = 2.0            # a crossing may still fail for this time [s]


@dataclass
class ObservedAttempt:
    """An executed crossing; the values are those at the first contact with the face."""

    time: float
    x: float           # [m]
    face: float        # [m]
    speed: float       # [m/s]
    strategy: str
    probability: float  # predicted; NaN for none
    edge: float        # last edge of the plan [m]
    plan: Tuple[float, float, float, float]  # start, speed, swing position and angle
    height_margin: float = math.nan  # predicted [m]
    # Position [m], speed [m/s] and pendulum angle [rad] before the swing, and before the touch of
    # a step of any height.
    before: Tuple[float, float, float] = (math.nan, math.nan, math.nan)
    same: bool = False  # same plan as one that has failed at this face
    over: Optional[bool] = None
    settled: float = 0.0  # time when `over` was determined [s]


def crosses(decision: Decision, x: float, face: float) -> bool:
    """Return whether a decision made at x intends to cross a face [m]."""
    return decision.kind is Kind.CROSS and decision.last_edge(x) >= face - SAME_FACE


def same_plan(one: ObservedAttempt, other: ObservedAttempt) -> bool:
    """Return whether two attempts at a face have the same plan."""
    if abs(one.face - other.face) > SAME_FACE or one.strategy != other.strategy:
        return False
    tolerances = (0.1, 0.05, 0.03, 0.1)
    return all(a == b or abs(a - b) < within
               for a, b, within in zip(one.plan, other.plan, tolerances))


@dataclass
class Verdict:
    """The outcome of an approach, with all values for the report."""

    outcome: str = 'undecided'
    time: float = 0.0
    x: float = 0.0
    gap: float = math.nan       # at rest: front to the next face, or centre to a drop [m]
    hit_speed: float = 0.0      # [m/s]
    depth: float = 0.0          # of the drop that the ball fell down [m]
    bumps: int = 0              # low faces that the ball rolled over without a plan
    changes: int = 0            # of the decision, without new information
    height_margin: float = math.nan  # of the step that the last decision refuses [m]
    attempts: List[ObservedAttempt] = field(default_factory=list)


class OutcomeMonitor:
    """Determines the outcome of one approach."""

    def __init__(self, approach: Approach, loop: ClosedLoop, tuning: DecisionTuning):
        self._approach, self._loop, self._tuning = approach, loop, tuning
        self._radius = approach.robot.ball_radius
        self._faces = true_faces(approach.ground.terrain)
        self._decisions: Deque[Tuple[float, float, Decision]] = deque()
        self._passed: Dict[float, bool] = {}  # edges of drops, and whether the ball was crossing
        self._resting_since = math.inf
        self._x, self._y = loop.state.x, loop.state.y
        self._path: List[Tuple[float, float, float]] = []  # see `ObservedAttempt.before`
        self.verdict = Verdict()
        self.last_event = 0.0  # time of the last event that justifies another decision [s]

    def update(self, before: float, decision: Decision) -> bool:
        """
        Evaluate the state after a number of periods; return whether the approach has ended.

        The decision was in force during these periods, which start at the time `before` [s].
        """
        state = self._loop.state
        self._path.append((state.x, state.velocity_x, state.pendulum_angle))
        self._decisions.append((before, self._x, decision))
        while self._decisions[0][0] < before - CANCELLATION_TIME - 1e-9:
            self._decisions.popleft()
        self._settle_attempt(state)
        ended = self._falls(state) or self._hits() or self._ends(state, decision)
        self._x, self._y = state.x, state.y
        if ended:
            self.verdict.time, self.verdict.x = state.time, state.x
            self._close()
        return ended

    def finish(self, state: State) -> None:
        """Close the approach at the time limit."""
        verdict = self.verdict
        verdict.outcome = 'stuck' if self._gap(state) < 0.005 else 'undecided'
        verdict.time, verdict.x, verdict.gap = state.time, state.x, self._gap(state)
        self._close()

    def _crossing(self, face: float, before: float = 0.0) -> bool:
        """Return whether a face is being crossed, or was within a time before [s]."""
        now = self._decisions[-1][0]
        return any(crosses(decision, x, face) for when, x, decision in self._decisions
                   if when >= now - before - 1e-9)

    def _is_low(self, x: float) -> bool:
        """Return whether the face at x is only a bump for the ball, or a narrow groove."""
        bottom = min(self._y, self._loop.state.y) - self._radius
        return all(abs(height) <= BUMP_HEIGHT_MAX
                   or max(low, low + height) <= bottom + BUMP_HEIGHT_MAX
                   for left, low, width, height in self._faces
                   if left - 1e-6 <= x <= left + width + 1e-6)

    def _floor_before(self, edge: float, top: float, side: float) -> float:
        """Return the lowest floor within `CORD_WIDTH` before an edge [m], at most `top`."""
        xs = edge - side * np.linspace(0.0, CORD_WIDTH, 11)[1:]
        return min(top, float(self._approach.ground.terrain.height(xs).min()))

    def _gap(self, state: State) -> float:
        """Return the distance of the ball from the next face, or of its centre from a drop [m]."""
        ahead = [left - (self._radius if height > 0.0 else 0.0)
                 for left, _, width, height in self._faces if left + width > state.x]
        return ahead[0] - state.x if ahead else math.inf

    def _falls(self, state: State) -> bool:
        """Return whether the ball has fallen down a drop that it was not crossing."""
        slope = self._approach.ground.slope
        for left, low, width, height in self._faces:
            if height < 0.0:
                edge, top, side = left, low, 1.0
            elif left + width < 0.0:  # the drop behind the start
                edge, top, side = left + width, low + height, -1.0
            else:
                continue
            if side * (state.x - edge) <= 0.0:
                self._passed.pop(edge, None)
                continue
            if edge not in self._passed:
                crossing = side > 0.0 and -height <= DROP_CROSSABLE_MAX and self._crossing(edge)
                self._passed[edge] = crossing
                self.last_event = state.time
                if crossing:
                    self._begin(state.time, edge, state.velocity_x)
            bottom = (state.y - math.tan(slope) * (state.x - edge) - self._radius / math.cos(slope)
                      + FALL_DEPTH_MIN + PENETRATION)
            if not self._passed[edge] and bottom < top \
                    and bottom < self._floor_before(edge, top, side):
                self.verdict.outcome, self.verdict.depth = 'fell', abs(height)
                return True
        return False

    def _hits(self) -> bool:
        """Return whether the ball has hit a face; start an attempt if it was crossing."""
        for piece in self._loop.watched:
            if piece[TOUCH_PERIOD] == 0.0:
                continue
            when, speed = float(piece[TOUCH_PERIOD]) * PERIOD, float(piece[TOUCH_SPEED])
            piece[TOUCH_PERIOD] = 0.0
            face = float(piece[AX] if piece[BY] > piece[AY] else piece[BX])
            self.last_event = when
            if self._crossing(face):
                self._begin(when, face, speed)
            elif speed > HIT_SPEED_MIN and not self._crossing(face, CANCELLATION_TIME):
                if self._is_low(face) and self._decisions[-1][2].kind in (Kind.CLEAR, Kind.CROSS):
                    self.verdict.bumps += 1
                    continue
                self.verdict.outcome, self.verdict.hit_speed = 'hit', speed
                return True
        return False

    def _begin(self, when: float, face: float, speed: float) -> None:
        """Record a new attempt, unless one is under way."""
        attempts = self.verdict.attempts
        if attempts and attempts[-1].over is None:
            return
        _, x, decision = self._decisions[-1]
        plan = decision.plan
        attempt = ObservedAttempt(
            when, self._loop.state.x, face, speed, plan.strategy.value,
            decision.outlook.probability, float(decision.last_edge(x)),
            (plan.start, plan.speed, plan.swing_position, plan.swing_angle),
            decision.height_margin, self._before(min(face - self._radius, plan.swing_position)))
        attempt.same = any(same_plan(attempt, other) for other in attempts if other.over is False)
        attempts.append(attempt)

    def _before(self, x: float) -> Tuple[float, float, float]:
        """Return the values of `ObservedAttempt.before` when the ball was last at or before x."""
        return next((one for one in reversed(self._path) if one[0] <= x), self._path[0])

    def _settle_attempt(self, state: State) -> None:
        if not self.verdict.attempts or self.verdict.attempts[-1].over is not None:
            return
        attempt = self.verdict.attempts[-1]
        if state.x > max(attempt.edge, attempt.face) + 0.5 * self._radius:
            attempt.over = True
        elif state.x < attempt.x - RETREAT_MIN:
            attempt.over = False
        else:
            return
        self.last_event = attempt.settled = state.time

    def _ends(self, state: State, decision: Decision) -> bool:
        """Return whether the ball is over, has run away or rests."""
        verdict, goal = self.verdict, self._approach.ground.goal
        if not math.isfinite(goal):
            last = max((left + width for left, _, width, _ in self._faces), default=0.0)
            goal = max(last, self._approach.ground.foot)
        if state.x > goal + GOAL_MARGIN:
            verdict.outcome = 'over'
            return True
        if (state.x < -self._approach.room_behind - POSITION_ERROR_MAX
                or abs(state.velocity_x) > SPEED_EXCESS_MAX * self._tuning.highest_speed):
            verdict.outcome = 'ran away'
            return True
        if abs(state.velocity_x) > RESTING_SPEED_MAX:
            self._resting_since = math.inf
            return False
        if self._resting_since == math.inf:
            self._resting_since = state.time
        rest = state.time - self._resting_since
        verdict.gap = self._gap(state)
        if rest >= REST_TIME_MIN and decision.refuses:
            verdict.outcome, verdict.height_margin = 'stopped', decision.height_margin
            return True
        if rest >= IDLE_TIME_MAX:
            verdict.outcome = 'stuck' if verdict.gap < 0.005 else 'idle'
            return True
        return False

    def _close(self) -> None:
        """Settle the last attempt at the end; a fall or hit soon afterwards makes it a failure."""
        verdict = self.verdict
        if verdict.attempts:
            last = verdict.attempts[-1]
            # A ball that stays between the edges of its plan has not crossed.
            bad = (verdict.outcome in ('fell', 'hit')
                   and (last.over is None or verdict.time < last.settled + OUTCOME_DELAY))
            beyond = verdict.x > max(last.edge, last.face)
            last.over = (beyond if last.over is None else last.over) and not bad
