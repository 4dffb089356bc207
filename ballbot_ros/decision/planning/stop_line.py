# SPDX-License-Identifier: Apache-2.0
"""
The stop line: the farthest position that the ball's centre may reach without a crossing plan.

It is the nearest of the positions before faces, before stretches that are too steep to stand on,
and before the end of the observed terrain.  The terrain map is persistent, so the line needs no
separate memory.  The speed is limited so that the ball can stop before the line on the slopes in
between; CLEAR, STOP and GO_ROUND are labels of this one motion.
"""
from dataclasses import replace
import math
from typing import Iterable, NamedTuple, Optional

from ballbot_ros.decision.perception.ground_profile import (
    GroundProfile, SLOPE_LENGTH_MIN)
from ballbot_ros.decision.planning.situation import Knowledge, Situation
from ballbot_ros.decision.values import (
    Decision, Face, Kind, Plan, Profile, Reason, Strategy)

# Distance of the line before a touch, an edge, or the end of the observed terrain [m].
LINE_MARGIN = 0.03


class StopLine(NamedTuple):
    """A position that the centre must not pass, and the start of the `obstacle` [m]."""

    position: float
    obstacle: float
    reason: Reason
    explanation: str


class StopLines:
    """Finds stop lines, and the motion before them."""

    def __init__(self, knowledge: Knowledge):
        self._radius, self._tuning = knowledge.robot.ball_radius, knowledge.tuning
        self.braking = knowledge.braking

    def before_face(self, face: Face) -> StopLine:
        """Return the line before a face that is not crossed."""
        margin = LINE_MARGIN + self._tuning.sigma_margin * face.position_sd
        return StopLine(face.touch(self._radius) - margin, face.position,
                        Reason.WALL if face.height > 0.0 else Reason.DROP,
                        f'a face of {1e3 * face.height:.0f} mm')

    def before_slope(self, profile: Profile, position: float) -> Optional[StopLine]:
        """Return the line before the next stretch that is too steep to stand on, if any."""
        for begin, angle in profile.steep:
            if begin >= position:
                return StopLine(
                    begin - LINE_MARGIN, begin, Reason.STEEP,
                    f'a slope of {math.degrees(angle):+.1f} degrees; {self._most} can be held')
        return None

    def nearest(self, situation: Situation, faces: Iterable[Face]) -> Optional[StopLine]:
        """Return the nearest line; `faces` must exclude those that a plan crosses."""
        profile, position = situation.profile, situation.motion.position
        lines = [self.before_face(face) for face in faces if face.position > position]
        if math.isfinite(profile.seen_to):
            lines.append(StopLine(profile.seen_to - self._radius - LINE_MARGIN, profile.seen_to,
                                  Reason.WALL, 'the end of the observed terrain'))
        slope = self.before_slope(profile, position)
        if slope is not None:
            lines.append(slope)
        return min(lines, default=None, key=lambda line: line.position)

    @property
    def _most(self) -> str:
        return f'{math.degrees(self.braking.steepest):.1f} degrees'

    def slope_to(self, situation: Situation, end: float) -> float:
        """
        Return the mean slope from the ball to a position [rad].

        A ball that brakes on it loses as much energy as on the slopes in between.
        Without observed terrain, return the lower limit of the estimated slope.
        """
        begin, profile = situation.motion.position, situation.profile
        if not profile.points:
            return situation.slope - self._tuning.sigma_margin * situation.slope_sd
        if end - begin < SLOPE_LENGTH_MIN:
            return situation.slope
        floor = GroundProfile(profile.points, situation.slope)
        return math.atan(floor.rise(begin, end) / (end - begin))

    def speed_before(self, line: float, situation: Situation) -> float:
        """Return the speed from which the ball can stop before a position [m/s]."""
        position = situation.motion.position
        mean = self.slope_to(situation, line)
        return self.braking.speed_within(line - position, mean)

    def steep(self, situation: Situation) -> Optional[Decision]:
        """Return the STOP that a slope below or ahead requires, if it is too steep to hold."""
        profile, motion, steepest = situation.profile, situation.motion, self.braking.steepest
        below, seen = situation.slope, math.isfinite(profile.slope)
        slope_sd = profile.slope_sd if seen and math.isfinite(profile.slope_sd) else 0.0
        # Only the map can show an uphill slope: the motion of the ball may show a step instead.
        uphill = steepest + slope_sd if seen else math.inf
        if not -steepest - slope_sd <= below <= uphill:
            return Decision(
                Kind.STOP, Reason.STEEP, 0.0, f'Stopping: a slope of {math.degrees(below):+.1f} '
                f'degrees is too steep; {self._most} can be held', distance=0.0)
        line = self.before_slope(profile, motion.position)
        if line is None:
            return None
        distance = line.obstacle - motion.position
        return self.stop_before(
            Decision(Kind.STOP, Reason.STEEP, 0.0, f'Stopping: in {distance:.2f} m there is '
                     f'{line.explanation}', distance=distance), line.obstacle, situation)

    def stop_before(self, decision: Decision, before: float, situation: Situation) -> Decision:
        """Return a decision that stops with the stop gap before a position [m], or here."""
        position = situation.motion.position
        target = before - self._radius - self._tuning.stop_gap
        if not (target >= position or target >= situation.free_from):
            return replace(decision, set_speed=0.0, plan=Plan(Strategy(decision.kind.value)))
        speed = min(self._tuning.cruise_speed, self.speed_before(target, situation))
        return replace(decision, set_speed=speed, plan=Plan(
            Strategy(decision.kind.value), speed=speed, stop_position=target))

    def filtered(self, decision: Decision, situation: Situation) -> Decision:
        """
        Return a decision after which the ball can still stop before the line.

        A crossing is not changed unless the ball was stuck before: its rollouts include the stop
        behind the last edge.
        """
        blocked = situation.obstruction
        if blocked is not None and decision.forward_speed > 0.0:
            what = ('rolled back on a slope that is too steep' if blocked.reason is Reason.STEEP
                    else 'made no progress')
            decision = self.stop_before(
                replace(decision, kind=Kind.GO_ROUND, reason=blocked.reason,
                        explanation=f'The ball {what} at {blocked.position:.2f} m; find another '
                        'way'), blocked.position + self._radius, situation)
        if decision.kind in (Kind.CROSS, Kind.BACK_OFF):
            return decision
        line = self.nearest(situation, situation.profile.faces)
        if line is None:
            return decision
        most = self.speed_before(line.position, situation)
        if situation.motion.speed <= most and decision.set_speed <= most:
            return decision
        if decision.kind is not Kind.CLEAR:
            if situation.motion.speed > most:  # stop as soon as possible, not at a position
                return replace(decision, set_speed=0.0, plan=replace(
                    decision.plan, stop_position=math.inf))
            return replace(decision, set_speed=min(decision.set_speed, most))
        return self.stop_before(
            replace(decision, kind=Kind.STOP, reason=line.reason,
                    explanation=f'Stopping before {line.explanation}',
                    distance=line.obstacle - situation.motion.position),
            line.obstacle, situation)
