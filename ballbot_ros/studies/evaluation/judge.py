# SPDX-License-Identifier: Apache-2.0
"""
What came of an approach, judged on the truth.

*Taken* is a face that the decision in force means to cross: it says CROSS, and the last edge of
its plan (without a plan: the step that it names) is not before that face.

``over``       the centre has passed all that is to be passed, and 0.25 m more
``fell``       the ball went down, by more than 5 mm below the edge, a drop that was not taken when
               the centre passed its edge; or one of more than 60 mm, taken or not
``hit``        it touched a face of 5 mm or more faster than 0.1 m/s, that was not taken then nor
               within the 0.1 s before; one of up to 8 mm that it touches on its way, saying
               CLEAR or CROSS, is a *bump*, and counted apart
``stopped``    it stood for 1 s and the decision was to stop or to go round
``ran away``   it was 0.25 m behind what is known to be free, or faster than 1.5 times the highest
               speed
``stuck``      it stood for 4 s, or the time was up, and it touched a face
``idle``       it stood for 4 s, and the decision was to move
``undecided``  the time was up

*Hidden* is a face that is less than `unseen_room` of the decision tuning behind another, where the
sensor sees the next face only: the decision takes that much floor for granted.
"""
from collections import deque
from dataclasses import asdict, dataclass, field
import math
from typing import Any, Deque, Dict, List, Tuple

from ballbot_ros.control.periods import AX, AY, BX, BY, TOUCH_PERIOD, TOUCH_SPEED
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.decision.values import Decision, Kind
from ballbot_ros.physics.model.state import State
from ballbot_ros.studies.evaluation.approaches import Approach
from ballbot_ros.studies.evaluation.attempts import alike, crosses, JudgedAttempt, last_edge
from ballbot_ros.studies.evaluation.closed_loop import ClosedLoop, PERIOD, true_faces

OUTCOMES = ('over', 'stopped', 'fell', 'hit', 'ran away', 'stuck', 'idle', 'undecided')

BEYOND = 0.25          # behind the goal [m]
FALL, DEEPEST = 0.005, 0.06  # of a drop that counts, and of one that may be taken [m]
SINKING = 0.003        # of a ball into the ground that it rolls on, at most [m]
HIT, BUMP = 0.1, 0.008  # [m/s], [m]
MEMORY = 0.1           # so long a crossing counts that is called off [s]
RESTING, STANDING, WAITING = 0.01, 1.0, 4.0  # [m/s], [s], [s]
ASTRAY, RACING = 0.25, 1.5  # [m], over the highest speed
LOST = 0.03            # so far behind its touch an attempt has failed [m]
AFTERMATH = 2.0        # so long a crossing may still end badly [s]


@dataclass
class Verdict:
    """What came of an approach; all that the report counts."""

    outcome: str = 'undecided'
    time: float = 0.0
    x: float = 0.0
    gap: float = math.nan       # at rest: front to the next face, or centre to a drop [m]
    hit_speed: float = 0.0      # [m/s]
    depth: float = 0.0          # of the drop that it fell [m]
    hidden: bool = False        # whether what it fell or hit could not be seen in time
    bumps: int = 0              # low faces that it went over without a plan
    changes: int = 0            # of mind, without news
    attempts: List[JudgedAttempt] = field(default_factory=list)

    @property
    def row(self) -> Dict[str, Any]:
        """Return it as JSON takes it: null for what is no number."""
        return asdict(self, dict_factory=lambda items: {
            name: None if isinstance(value, float) and not math.isfinite(value) else value
            for name, value in items})


class Judge:
    """
    Watches one approach.

    Parameters
    ----------
    approach : Approach
    loop : ClosedLoop
    tuning : DecisionTuning

    Attributes
    ----------
    verdict : Verdict

    """

    def __init__(self, approach: Approach, loop: ClosedLoop, tuning: DecisionTuning):
        """Start with nothing passed and nothing touched."""
        self._approach, self._loop, self._tuning = approach, loop, tuning
        self._radius = approach.robot.ball_radius
        self._faces = true_faces(approach.ground.terrain)
        self._said: Deque[Tuple[float, float, Decision]] = deque()
        self._passed: Dict[float, bool] = {}  # edges of drops, and whether they were taken
        self._resting_since = math.inf
        self._x = loop.state.x
        self.verdict = Verdict()
        self.news = 0.0  # when there was some last [s]

    def look(self, before: float, decision: Decision) -> bool:
        """
        Look at the ball after a stretch; return whether that was the end.

        Parameters
        ----------
        before : float
            Time at the begin of the stretch [s].
        decision : Decision
            In force during the stretch.

        """
        state = self._loop.state
        self._said.append((before, self._x, decision))
        while self._said[0][0] < before - MEMORY - 1e-9:
            self._said.popleft()
        self._look_at_attempt(state)
        ended = (self._look_for_fall(state) or self._look_for_touch()
                 or self._look_for_end(state, decision))
        self._x = state.x
        if ended:
            self.verdict.time, self.verdict.x = state.time, state.x
            self._close()
        return ended

    def finish(self, state: State) -> None:
        """Note that the time is up."""
        verdict = self.verdict
        verdict.outcome = 'stuck' if self._gap(state) < 0.005 else 'undecided'
        verdict.time, verdict.x, verdict.gap = state.time, state.x, self._gap(state)
        self._close()

    def _taken(self, place: float, long: float = 0.0) -> bool:
        """Return whether a face is taken now, or was within some time [s]."""
        now = self._said[-1][0]
        return any(crosses(decision, x, place) for when, x, decision in self._said
                   if when >= now - long - 1e-9)

    def _is_low(self, place: float) -> bool:
        """Return whether the face at a place is no more than a bump."""
        return all(abs(height) <= BUMP for left, _, width, height in self._faces
                   if left - 1e-6 <= place <= left + width + 1e-6)

    def _hidden(self, place: float) -> bool:
        """Return whether a face is near behind another, and the sensor sees the next only."""
        before = [left + width for left, _, width, _ in self._faces
                  if 0.0 < left + width < place - 1e-6]
        return (self._approach.flaws.kind == 'step' and bool(before)
                and place - max(before) < self._tuning.unseen_room)

    def _gap(self, state: State) -> float:
        """Return how far the ball is from the next face, its centre from a drop [m]."""
        ahead = [left - (self._radius if height > 0.0 else 0.0)
                 for left, _, width, height in self._faces if left + width > state.x]
        return ahead[0] - state.x if ahead else math.inf

    def _look_for_fall(self, state: State) -> bool:
        """Return whether the ball has gone down a drop that was not taken."""
        slope = self._approach.ground.slope
        for left, low, width, height in self._faces:
            if height < 0.0:
                edge, top, side = left, low, 1.0
            elif left + width < 0.0:  # the brink behind the start
                edge, top, side = left + width, low + height, -1.0
            else:
                continue
            if side * (state.x - edge) <= 0.0:
                self._passed.pop(edge, None)
                continue
            if edge not in self._passed:
                self._passed[edge] = (
                    side > 0.0 and -height <= DEEPEST and self._taken(edge))
                self.news = state.time
            floor = top + math.tan(slope) * (state.x - edge)
            if not self._passed[edge] and state.y < floor + self._radius / math.cos(
                    slope) - FALL - SINKING:
                self.verdict.outcome, self.verdict.depth = 'fell', abs(height)
                self.verdict.hidden = side > 0.0 and self._hidden(edge)
                return True
        return False

    def _look_for_touch(self) -> bool:
        """Return whether the ball has hit a face; begin an attempt where it meant to."""
        for piece in self._loop.watched:
            if piece[TOUCH_PERIOD] == 0.0:
                continue
            when, speed = float(piece[TOUCH_PERIOD]) * PERIOD, float(piece[TOUCH_SPEED])
            piece[TOUCH_PERIOD] = 0.0
            place = float(piece[AX] if piece[BY] > piece[AY] else piece[BX])
            self.news = when
            if self._taken(place):
                self._begin(when, place, speed)
            elif speed > HIT and not self._taken(place, MEMORY):
                if self._is_low(place) and self._said[-1][2].kind in (Kind.CLEAR, Kind.CROSS):
                    self.verdict.bumps += 1
                    continue
                self.verdict.outcome, self.verdict.hit_speed = 'hit', speed
                self.verdict.hidden = self._hidden(place)
                return True
        return False

    def _begin(self, when: float, place: float, speed: float) -> None:
        """Note a new attempt, unless one is under way."""
        attempts = self.verdict.attempts
        if attempts and attempts[-1].over is None:
            return
        _, x, decision = self._said[-1]
        plan, outlook = decision.plan, decision.outlook
        attempt = JudgedAttempt(
            when, self._loop.state.x, place, speed, plan.strategy.value if plan else '',
            outlook.probability if outlook else math.nan, float(last_edge(decision, x)),
            (plan.start, plan.speed, plan.swing_position, plan.swing_angle) if plan
            else (decision.set_speed,))
        attempt.same = any(alike(attempt, other) for other in attempts if other.over is False)
        attempts.append(attempt)

    def _look_at_attempt(self, state: State) -> None:
        """Settle the attempt under way."""
        if not self.verdict.attempts or self.verdict.attempts[-1].over is not None:
            return
        attempt = self.verdict.attempts[-1]
        if state.x > max(attempt.edge, attempt.face) + 0.5 * self._radius:
            attempt.over = True
        elif state.x < attempt.x - LOST:
            attempt.over = False
        else:
            return
        self.news = attempt.settled = state.time

    def _look_for_end(self, state: State, decision: Decision) -> bool:
        """Return whether the ball is over, at rest or astray."""
        verdict, goal = self.verdict, self._approach.ground.goal
        if not math.isfinite(goal):
            last = max((left + width for left, _, width, _ in self._faces), default=0.0)
            goal = max(last, self._approach.ground.foot) + BEYOND
        if state.x > goal + BEYOND:
            verdict.outcome = 'over'
            return True
        if (state.x < -self._approach.room_behind - ASTRAY
                or abs(state.velocity_x) > RACING * self._tuning.highest_speed):
            verdict.outcome = 'ran away'
            return True
        if abs(state.velocity_x) > RESTING:
            self._resting_since = math.inf
            return False
        if self._resting_since == math.inf:
            self._resting_since = state.time
        rest = state.time - self._resting_since
        verdict.gap = self._gap(state)
        if rest >= STANDING and decision.kind in (Kind.STOP, Kind.GO_ROUND):
            verdict.outcome = 'stopped'
            return True
        if rest >= WAITING:
            verdict.outcome = 'stuck' if verdict.gap < 0.005 else 'idle'
            return True
        return False

    def _close(self) -> None:
        """Settle an attempt at the end; one that ended badly later did not get over."""
        verdict = self.verdict
        if verdict.attempts:
            last = verdict.attempts[-1]
            # A ball that stays between the edges of its plan has not got over.
            bad = (verdict.outcome in ('fell', 'hit') and not verdict.hidden
                   and (last.over is None or verdict.time < last.settled + AFTERMATH))
            beyond = verdict.x > max(last.edge, last.face)
            last.over = (beyond if last.over is None else last.over) and not bad
