# SPDX-License-Identifier: Apache-2.0
"""
The planner ``rollout``: plans tried out with the physics in the worlds that may be the real one.

For each face ahead it deliberates once, when it is first seen: hundreds of attempts within one
answer.  From then on the choice is kept, and looked at again with a few attempts now and then;
it is deliberated anew only where there is news (the face is believed to be elsewhere or of
another height, or is known much better), or confidence is gone.  All budgets count attempts, not
time, so that a run repeats to the bit.
"""
from dataclasses import replace
import math
from typing import NamedTuple, Optional, Sequence

from ballbot_ros.control.speed_law import braking_distance
from ballbot_ros.decision.particles import Particles
from ballbot_ros.decision.profile import Face
from ballbot_ros.decision.rollout.ahead import Ahead, faces_ahead, look_ahead
from ballbot_ros.decision.rollout.answers import go, refuse, stop
from ballbot_ros.decision.rollout.candidates import Candidate
from ballbot_ros.decision.rollout.deliberation import (
    Choice, deliberate, Deliberation, from_here)
from ballbot_ros.decision.rollout.search import good, Task
from ballbot_ros.decision.rollout.worlds import Worlds
from ballbot_ros.decision.situation import Failure, Knowledge, Planner, Situation
from ballbot_ros.decision.values import Decision, Kind, Motion, Reason

# Attempts within the first answer about a face, and within each later one.
FIRST, LATER = 640, 40
# A face farther ahead is not thought about yet [m].
FAR = 3.5
# News: the height has changed by this [m], or the place, or a deviation has shrunk to this part.
HEIGHT_NEWS, PLACE_NEWS, SHRUNK = 0.002, 0.05, 0.6
# After so many answers a choice is looked at again, with so many attempts; the old ones fade.
EVERY, ATTEMPTS, FADE = 10, 24, 0.9
# A choice is given up where its probability has come this far below what is required.
LOST = 0.05
# Slower than this a ball stands [m/s]; nearer than this it is there [m].
STANDING, THERE = 0.03, 0.05
# The ball is on the step from this far before the touch [m], for so long at most [s].
CONTACT, LONGEST_CONTACT = 0.005, 3.0
# Room that a ball that stops leaves before a touch [m].
GAP = 0.03


class Belief(NamedTuple):
    """What a choice was made for."""

    face: Face
    faces: int
    standing: bool
    failures: int
    free_from: float


def planner(knowledge: Knowledge) -> Planner:
    """Return the planner for a robot and a tuning."""
    return RolloutPlanner(knowledge)


class RolloutPlanner:
    """
    Keeps a choice for the faces ahead; see the module.

    Parameters
    ----------
    knowledge : Knowledge

    """

    def __init__(self, knowledge: Knowledge):
        """Draw the worlds."""
        self._tuning, self._robot = knowledge.tuning, knowledge.robot
        self._worlds = Worlds(knowledge)
        self._worlds.believe(Particles.of(knowledge.robot, knowledge.tuning.height_bias_sd))
        self._forget()

    def _forget(self) -> None:
        """Forget the face ahead."""
        self._choice: Optional[Choice] = None
        self._belief: Optional[Belief] = None
        self._deliberation: Optional[Deliberation] = None
        self._answers = 0
        self._stand: Optional[float] = None  # relative to the face [m]

    def __call__(self, situation: Situation, previous: Optional[Decision]) -> Decision:
        """Decide on the ground ahead; see `situation.Planner`."""
        motion, profile = situation.motion, situation.profile
        if profile is None:
            return stop(Reason.STALE, 'nothing has been observed yet')
        pushing = self._push(situation, previous)
        if pushing is not None:
            return pushing
        faces = faces_ahead(profile, motion.position)
        if not faces or faces[0].position - motion.position > FAR:
            self._forget()
            return Decision(Kind.CLEAR, Reason.NOTHING_AHEAD, self._tuning.cruise_speed,
                            f'Nothing ahead: cruising at {self._tuning.cruise_speed:.2f} m/s')
        slope = profile.slope if math.isfinite(profile.slope) else motion.slope
        deviation = profile.slope_sd if math.isfinite(profile.slope_sd) else 0.005
        ahead = look_ahead(profile, faces, motion.position, slope, deviation,
                           self._robot.ball_radius, self._tuning.unseen_room)
        if self._belief is not None and self._belief.face.number != faces[0].number:
            self._forget()
        if not ahead.ends or faces[0].height > self._robot.ball_radius:
            reason = Reason.DROP if faces[0].height < 0.0 else Reason.WALL
            self._choice = Choice(None, reason)
            self._belief = None
            return self._refuse(ahead, situation)
        self._think(ahead, situation)
        return self._answer(ahead, situation)

    def _push(self, situation: Situation, previous: Optional[Decision]) -> Optional[Decision]:
        """Return the decision of a ball on the step: on, unless it lasts too long."""
        motion = situation.motion
        if previous is None or previous.kind is not Kind.CROSS or previous.plan is None \
                or self._belief is None or not motion.position < previous.plan.edge:
            return None
        if previous.contact_since is None and \
                motion.position < self._belief.face.position - self._touching() - CONTACT:
            return None
        since = motion.stamp if previous.contact_since is None else previous.contact_since
        back = self._belief.face.position - self._touching() - GAP
        if not 0.0 <= motion.stamp - since <= LONGEST_CONTACT \
                or motion.position < back and motion.speed < 0.0:
            self._forget()
            return None
        # With two edges the second one is left when the first is passed.
        faces = situation.profile.faces if situation.profile is not None else ()
        left = [face for face in faces if face.number == previous.step] or [
            face for face in faces if motion.position < face.position < previous.plan.edge]
        if not left:
            return None
        distance = left[0].position - motion.position
        return replace(
            previous, reason=Reason.COMMITTED, distance=distance, contact_since=since,
            step=left[0].number,
            explanation=f'On the step, {distance:.2f} m to its face: pushing on')

    def _touching(self) -> float:
        """Return how far before the face the ball touches it [m]."""
        assert self._belief is not None
        radius = self._robot.ball_radius
        rise = min(max(self._belief.face.height, 0.0), radius)
        return math.sqrt(2.0 * radius * rise - rise * rise)

    def _failures(self, situation: Situation, face: Face) -> Sequence[Failure]:
        """Return what was tried at a face."""
        return [failure for failure in situation.failures
                if failure.face == face.number or abs(failure.position - face.position) < 0.15]

    def _think(self, ahead: Ahead, situation: Situation) -> None:
        """Deliberate, or look at the choice again, within the attempts of one answer."""
        motion, face = situation.motion, ahead.faces[0]
        failures = self._failures(situation, face)
        self._worlds.see(ahead)
        task = Task(
            (motion.position, motion.speed, motion.pendulum_angle, motion.pendulum_rate),
            ahead, self._worlds, self._tuning.required_probability, self._tuning.highest_speed)
        now = Belief(face, len(ahead.faces), abs(motion.speed) < STANDING, len(failures),
                     situation.free_from)
        budget = LATER if self._choice is not None else FIRST
        kept = self._choice.candidate if self._choice is not None else None
        if kept is not None and kept.back > 0.0 and self._arrived(kept, ahead, motion):
            self._choice = Choice(None, Reason.NOT_LIKELY)
            self._deliberation = deliberate(task, self._tuning, 0.0, from_here(kept), failures)
            self._belief, budget = now, FIRST
        elif self._deliberation is None and self._is_news(now, ahead, motion):
            room = max(0.0, motion.position - situation.free_from)
            self._deliberation = deliberate(task, self._tuning, room, kept, failures)
            self._belief = now
        if self._deliberation is None:
            self._look_again(task, motion)
            return
        spent = self._worlds.attempts
        try:
            while self._worlds.attempts - spent < budget:
                self._choice = next(self._deliberation) or self._choice
        except StopIteration as end:
            self._adopt(end.value)

    def _adopt(self, choice: Choice) -> None:
        """Take over what a deliberation ended with."""
        before = self._choice
        if before is not None and before.candidate == choice.candidate and not choice.others:
            choice.limit, choice.others = before.limit, before.others
        self._choice, self._deliberation, self._answers = choice, None, 0

    def _is_news(self, now: Belief, ahead: Ahead, motion: Motion) -> bool:
        """Return whether the choice must be made anew."""
        then, choice = self._belief, self._choice
        if then is None or choice is None:
            return True
        if now.failures != then.failures or now.faces != then.faces:
            return True
        if choice.trial is None:
            known = (now.face.height_sd < SHRUNK * then.face.height_sd
                     and choice.reason is not Reason.TOO_HIGH)
            freed = now.free_from < then.free_from - 0.3
            if known or (now.standing and (not then.standing or freed)):
                return True
        elif self._braking_room(ahead, motion) < 0.0:
            return False
        changed = max(HEIGHT_NEWS, then.face.height_sd)
        return abs(now.face.height - then.face.height) > changed

    def _arrived(self, kept: Candidate, ahead: Ahead, motion: Motion) -> bool:
        """Return whether the ball has backed off to where its plan begins."""
        start = ahead.touch - kept.back
        return motion.position < start + THERE and abs(motion.speed) < STANDING

    def _look_again(self, task: Task, motion: Motion) -> None:
        """Try the chosen plan a few times more, now and then."""
        choice = self._choice
        self._answers += 1
        if choice is None or choice.trial is None or self._answers % EVERY \
                or self._braking_room(task.ahead, motion) < 0.0 and choice.candidate is not None \
                and self._answers % (4 * EVERY):
            return
        trial = choice.trial
        trial.row = trial.candidate.row(task.ahead)
        new = task.tally(trial, task.worlds.take(ATTEMPTS))
        choice.tally = choice.tally.faded(FADE if choice.tally.attempts > 300 else 1.0) + new
        if not good(choice.tally, task.required - LOST) \
                and self._braking_room(task.ahead, motion) > 0.0:
            self._belief = None

    def _braking_room(self, ahead: Ahead, motion: Motion) -> float:
        """Return how far it is to the last point where braking still works [m]."""
        tuning = self._tuning
        way = braking_distance(motion.speed, ahead.slope, tuning.emergency_lean,
                               tuning.reaction_time + tuning.actuation_delay, self._worlds.law)
        return ahead.touch - GAP - motion.position - way

    def _answer(self, ahead: Ahead, situation: Situation) -> Decision:
        """Return the decision of the choice."""
        choice, motion = self._choice, situation.motion
        if choice is None and abs(motion.speed) > STANDING \
                and self._braking_room(ahead, motion) > 0.1:
            face = ahead.faces[0]
            return Decision(
                Kind.CLEAR, Reason.NOT_LIKELY, self._tuning.cruise_speed,
                f'{1e3 * face.height:.0f} mm at {face.position - motion.position:.2f} m: '
                'weighing plans', height=face.height, step=face.number,
                distance=face.position - motion.position)
        if choice is None or choice.trial is None:
            return self._refuse(ahead, situation)
        self._stand = None
        end = choice.trial.candidate.end(ahead)
        later = [face.position - self._robot.ball_radius for face in ahead.faces
                 if face.position > end.position + 1e-3]
        return go(choice, choice.trial.candidate, ahead, motion,
                  min(later, default=math.inf), self._braking_room(ahead, motion), self._tuning)

    def _refuse(self, ahead: Ahead, situation: Situation) -> Decision:
        """Return the decision to stand before the face."""
        motion, face = situation.motion, ahead.faces[0]
        choice = self._choice or Choice(None, Reason.NOT_LIKELY)
        room = self._braking_room(ahead, motion)
        usual = -self._robot.ball_radius - self._tuning.stop_gap
        if self._stand is None or face.position + usual > motion.position:
            here = motion.position - face.position
            way = max(0.0, min(ahead.touch - GAP - motion.position, ahead.touch - GAP
                               - motion.position - max(room, 0.0)))
            self._stand = usual if here < usual else here + (
                0.0 if abs(motion.speed) < STANDING else way)
        return refuse(choice, ahead, motion, face.position + self._stand, room, self._tuning)

