# SPDX-License-Identifier: Apache-2.0
"""Events of a run from its topics: a printed timeline, and a verdict for the exit code."""
from dataclasses import dataclass, field
from enum import Enum
import math
from typing import Any, Callable, List, Optional, Tuple

from ballbot_ros.msg import BallState, Contact, StepDecision
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.ros.conversions import DECISION_NAMES, to_seconds

# The ball is at rest when it has been slower than this [m/s] for this time [s].
REST_SPEED, REST_TIME = 0.02, 1.0
# Maximum distance between a face and a contact with its edge [m].
CONTACT_DISTANCE_MAX = 0.01

# Distance from the start beyond which the ball counts as driven [m].
DRIVEN = 0.2
# Time at rest after a refusal that ends the run of a ball that has not been driven [s].
STANDING_TIME = 5.0
# Maximum error of an observed height [m].
SAME_HEIGHT = 0.01

REFUSED = {StepDecision.DECISION_GO_ROUND, StepDecision.DECISION_STOP}


class Expected(str, Enum):
    """Expected action of the robot at a face."""

    CROSSED = 'crossed'
    REFUSED = 'refused'


@dataclass
class Passage:
    """A face and its events."""

    x: float  # position, height (negative for a drop), and level of the ground behind it [m]
    height: float
    top: float
    expected: Optional[Expected]  # None if either is accepted
    decided: List[int] = field(default_factory=list)
    touched: Optional[float] = None  # time of the touch [s]
    crossed: Optional[float] = None

    @property
    def name(self) -> str:
        """Return the name of the face for the timeline."""
        return (f'{1e3 * abs(self.height):.0f} mm '
                f'{"step" if self.height > 0.0 else "drop"}')


class Timeline:
    """
    Detects events and the end of a run from ball states and decisions.

    Messages are added in the order of their stamps; a decision follows the state that it answers.
    Times count from the first state [s].  The passages are the faces of the scene, from left to
    right, first the faces to be crossed; `report` is called with time [s], a mark and a sentence.
    """

    def __init__(self, passages: List[Passage], robot: Robot,
                 report: Callable[[float, str, str], None]):
        self.passages = passages
        self.states: List[BallState] = []
        self._robot, self._report = robot, report
        self._limit = math.nan
        self._last: Optional[Tuple[int, int, int]] = None
        self._seen = -1  # index of the last step whose observation was reported
        self._resting: Optional[float] = None
        self.rested: Optional[float] = None  # time of rest behind all faces to be crossed [s]

    @property
    def next_step(self) -> int:
        """Return the index of the step ahead of the ball."""
        return sum(passage.crossed is not None for passage in self.passages)

    @property
    def now(self) -> float:
        """Return the time of the latest state [s], minus infinity before the first."""
        return self.time_of(self.states[-1]) if self.states else -math.inf

    def time_of(self, message: Any) -> float:
        """Return the time of a message since the first state [s]."""
        return to_seconds(message.header.stamp) - to_seconds(self.states[0].header.stamp)

    def add_decision(self, message: StepDecision) -> None:
        """Process a decision; report changes since the first state."""
        if not self.states:
            return
        time, index = self.time_of(message), self.next_step
        if index and message.decision == StepDecision.DECISION_CROSS and abs(
                message.height - self.passages[index - 1].height) < SAME_HEIGHT:
            index -= 1  # the decision still follows its plan behind the edge
        if message.decision == StepDecision.DECISION_CROSS:
            self._limit = message.height_limit
        key = (message.decision, message.reason, index)
        if key == self._last:
            return
        self._last = key
        if index < len(self.passages) and message.decision != StepDecision.DECISION_CLEAR:
            # Behind an edge, a decision may refer to no step.
            if index > self._seen and math.isfinite(message.distance):
                self._seen = index
                self._report(
                    time, 'detects', f'a {"step" if message.height > 0.0 else "drop"} of '
                    f'{1e3 * abs(message.height):.0f} mm, {message.distance:.2f} m ahead of its '
                    'centre')
            if message.decision not in self.passages[index].decided \
                    and message.reason != StepDecision.REASON_EVALUATING:
                self.passages[index].decided.append(message.decision)
        late = 'too late to stop: ' if message.reason == StepDecision.REASON_COMMITTED else ''
        word = 'evaluates' if message.reason == StepDecision.REASON_EVALUATING \
            else DECISION_NAMES.get(message.decision, '?')
        self._report(time, word, late + message.explanation)

    def add_state(self, message: BallState) -> None:
        """Process a state; report touches, crossings and rest."""
        before = self.states[-1] if self.states else message
        self.states.append(message)
        for passage in self.passages:
            self._follow(passage, message, before)
        self._watch_rest(message)

    def _follow(self, passage: Passage, message: BallState, before: BallState) -> None:
        """Report when the ball touches a step, and when it has crossed it."""
        if passage.touched is None and any(
                touch.kind == Contact.KIND_EDGE and abs(touch.x - passage.x) < CONTACT_DISTANCE_MAX
                for touch in message.contacts):
            passage.touched = self.now
            limit = '' if math.isnan(self._limit) else (
                f'; the plan crosses up to {1e3 * self._limit:.0f} mm')
            self._report(self.now, 'touches', f'the {passage.name} at '
                         f'{before.velocity_x:.2f} m/s{limit}')
        radius = self._robot.ball_radius
        if passage.crossed is None and message.x > passage.x \
                and message.y > passage.top + 0.5 * radius:
            passage.crossed = self.now
            self._report(self.now, 'crossed', f'over it, now at {message.velocity_x:.2f} m/s, '
                         f'pendulum at {math.degrees(message.pendulum_angle):.0f} degrees')

    def _watch_rest(self, message: BallState) -> None:
        """Report when the ball has come to rest behind all faces to be crossed."""
        due = sum(passage.expected is Expected.CROSSED for passage in self.passages)
        driven = abs(message.x - self.states[0].x) > DRIVEN
        kind, reason, _ = self._last or (None, None, 0)
        refused = kind in REFUSED
        if self.next_step < due or not (driven or refused) \
                or reason == StepDecision.REASON_EVALUATING \
                or abs(message.velocity_x) > REST_SPEED:
            self._resting = None
            return
        if self._resting is None:
            self._resting = self.now
        elif self.rested is None and self.now - self._resting >= (
                REST_TIME if driven else STANDING_TIME):
            self.rested = self._resting
            gap = self._gap(message)
            self._report(self._resting, 'rests', 'still' if math.isnan(gap) else
                         f'{gap:.2f} m before the {self.passages[self.next_step].name}')

    def _gap(self, message: BallState) -> float:
        """Return the distance from the front of the ball to the next face [m], NaN if none."""
        if self.next_step >= len(self.passages):
            return math.nan
        return float(self.passages[self.next_step].x - message.x - self._robot.ball_radius)

    def verdict(self) -> List[str]:
        """Return the deviations from the expected result; empty for a success."""
        wrong = []
        for passage in self.passages:
            accepted = StepDecision.DECISION_CROSS in passage.decided
            if passage.expected is Expected.CROSSED:
                if not accepted:
                    wrong.append(f'the {passage.name} was never accepted')
                if passage.crossed is None:
                    wrong.append(f'the {passage.name} was not crossed')
                continue
            if passage.expected is None:
                continue
            if accepted:
                wrong.append(f'the {passage.name} was accepted, but must be refused')
            if not REFUSED & set(passage.decided):
                wrong.append(f'the {passage.name} was never refused')
            if passage.touched is not None or passage.crossed is not None:
                wrong.append(f'the {passage.name} was touched')
        # Behind the last step that it crosses, the ball continues to cruise.
        ends_cruising = bool(self.passages) and all(
            passage.expected is Expected.CROSSED for passage in self.passages)
        if self.rested is None and not ends_cruising:
            wrong.append('the robot did not come to rest')
        return wrong


def account(timeline: Timeline) -> List[str]:
    """Return the result at each face, and the rest position."""
    lines = []
    for face in timeline.passages:
        result = 'crossed' if face.crossed is not None else \
            'not touched' if face.touched is None else 'touched, not crossed'
        words = ', '.join(DECISION_NAMES.get(kind, '?') for kind in face.decided)
        lines.append(f'the {face.name} at {face.x:.2f} m: {result}'
                     + (f'; decided: {words}' if words else ''))
    if timeline.states:
        where = f'at {timeline.states[-1].x:.2f} m'
        lines.append(f'came to rest {where}' if timeline.rested is not None else
                     f'had not come to rest after {timeline.now:.1f} s, {where}')
    return lines
