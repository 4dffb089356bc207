# SPDX-License-Identifier: Apache-2.0
"""
The stop line: the farthest position that the ball's centre may reach without a plan to go on.

It is the nearest of the positions before faces, before stretches that are too steep to stand on,
and before the end of the observed terrain.  The terrain map is persistent, so the line needs no
memory of its own.  The ball may be as fast as it can be stopped before the line on the slopes in
between; CLEAR, STOP and GO_ROUND are labels of this one motion.
"""
from bisect import bisect_left, bisect_right
from dataclasses import replace
import math
from typing import Iterable, List, NamedTuple, Optional, Sequence, Tuple

from ballbot_ros.crossing.rules import touch_distance
from ballbot_ros.decision.planning.braking import Braking
from ballbot_ros.decision.planning.situation import Knowledge, Situation
from ballbot_ros.decision.values import (
    Decision, Face, Kind, Motion, Plan, Profile, Reason, Strategy)

# A bend of the ground between faces by less than this is none [m].
UNEVEN = 0.004
# The ground is read so far from a face: its own points are no floor [m].
ASIDE = 1e-4
# Bends that are kept between two faces.
BENDS = 4
# A shorter end of the polyline has no slope of its own [m].
END_LENGTH = 0.1


class GroundProfile:
    """
    The ground between faces.

    Parameters
    ----------
    points : sequence of (float, float)
        Polyline of the ground, faces included; may be empty.
    slope : float
        Of the ground where there are no points [rad].

    """

    def __init__(self, points: Sequence[Tuple[float, float]], slope: float):
        """Keep them."""
        self._points, self._slope = points, math.tan(slope)
        self._places = [x for x, _ in points]
        self._end_slope = self._slope_at_end()

    def _slope_at_end(self) -> float:
        """Return the slope with which the ground goes on beyond the last point."""
        if len(self._points) < 2:
            return self._slope
        (left, low), (right, high) = self._points[-2:]
        length = right - left
        return (high - low) / length if length > END_LENGTH else self._slope

    def bends(self, begin: float, end: float) -> List[Tuple[float, float]]:
        """Return where the ground bends between two places, and how much higher it is [m]."""
        inner = self._inner(begin, end)
        if len(inner) < 3:
            return []
        found = simplified(inner, UNEVEN)[1:-1]
        return [(x, z - inner[0][1]) for x, z in found] if len(found) <= BENDS else []

    def rise(self, begin: float, end: float) -> float:
        """Return how much higher the ground is at a second place, faces at both left out [m]."""
        inner = self._inner(begin, end)
        return inner[-1][1] - inner[0][1] if inner else 0.0

    def _inner(self, begin: float, end: float) -> List[Tuple[float, float]]:
        """Return the points from behind the first to before the second of two places."""
        if end - begin < 2.0 * ASIDE:
            return []
        begin, end = begin + ASIDE, end - ASIDE
        inner = self._points[bisect_right(self._places, begin):bisect_left(self._places, end)]
        return [(begin, self._height(begin)), *inner, (end, self._height(end))]

    def _height(self, x: float) -> float:
        """Return the height of the ground at a place without a face [m]."""
        if not self._points:
            return self._slope * x
        after = bisect_right(self._places, x)
        if after == 0:
            return self._points[0][1] + self._slope * (x - self._places[0])
        if after == len(self._points):
            return self._points[-1][1] + self._end_slope * (x - self._places[-1])
        (left, low), (right, high) = self._points[after - 1], self._points[after]
        return low + (high - low) * (x - left) / max(right - left, 1e-9)


def simplified(points: Sequence[Tuple[float, float]], error: float) -> List[Tuple[float, float]]:
    """Return the points that a polyline needs to stay within an error (Douglas, Peucker)."""
    (x, z), (end_x, end_z) = points[0], points[-1]
    if len(points) < 3 or end_x - x < ASIDE:
        return [points[0], points[-1]]
    steep = (end_z - z) / (end_x - x)
    away = [abs(point[1] - z - steep * (point[0] - x)) for point in points[1:-1]]
    worst = max(range(len(away)), key=away.__getitem__) + 1
    if away[worst - 1] <= error:
        return [points[0], points[-1]]
    return [*simplified(points[:worst + 1], error)[:-1], *simplified(points[worst:], error)]


# Between the centre at the line and a touch, an edge, or the end of the observed terrain [m].
LINE_MARGIN = 0.03

# Slopes are those over such a length, or down to the shortest where a face ends the stretch [m].
SLOPE_LENGTH, SLOPE_LENGTH_MIN = 0.2, 0.08

# Steeper than this is not a slope but a face [rad].
FACE_SLOPE = 0.35

# The part of a slope in the map that the motion of the ball must show, too.
SLOPE_AGREEMENT = 0.4

# A stop before a slope that is too steep is kept until the slope is less by this part.
SLOPE_HYSTERESIS = 0.9

# Speed in parts of the distance to the end of the observed terrain [1/s]: a set speed is followed
# within half a second.
SIGHT_RATE = 1.0


class StopLine(NamedTuple):
    """A position that the centre must not pass, and why; `obstacle` is where that begins [m]."""

    position: float
    obstacle: float
    reason: Reason
    explanation: str


class StopLines:
    """
    Finds stop lines, and the motion before them.

    Parameters
    ----------
    knowledge : Knowledge

    """

    def __init__(self, knowledge: Knowledge):
        self._radius, self._tuning = knowledge.robot.ball_radius, knowledge.tuning
        self.braking = Braking(knowledge.robot, knowledge.tuning, knowledge.control)

    def before_face(self, face: Face) -> StopLine:
        """Return the line before a face that is not crossed."""
        touch = touch_distance(self._radius, face.height) if face.height > 0.0 else 0.0
        margin = LINE_MARGIN + self._tuning.sigma_margin * face.position_sd
        return StopLine(face.position - touch - margin, face.position,
                        Reason.WALL if face.height > 0.0 else Reason.DROP,
                        f'a face of {1e3 * face.height:.0f} mm')

    def end_of_sight(self, profile: Profile) -> Optional[StopLine]:
        """Return the line before the end of the observed terrain, None for a step sensor."""
        if not math.isfinite(profile.seen_to):
            return None
        return StopLine(profile.seen_to - self._radius - LINE_MARGIN, profile.seen_to,
                        Reason.WALL, 'the end of the observed terrain')

    def before_slope(self, profile: Profile, position: float, slope: float,
                     previous: Optional[Decision]) -> Optional[StopLine]:
        """Return the line before the next stretch that is too steep to stand on, if any."""
        steepest = self.braking.steepest
        if previous is not None and previous.reason is Reason.STEEP:
            steepest *= SLOPE_HYSTERESIS
        found = steep_stretch(profile, position, steepest, slope)
        if found is None:
            return None
        begin, angle = found
        return StopLine(
            begin - LINE_MARGIN, begin, Reason.STEEP,
            f'a slope of {math.degrees(angle):+.1f} degrees, {self._most} can be held')

    def nearest(self, situation: Situation, slope: float, faces: Iterable[Face],
                previous: Optional[Decision]) -> Optional[StopLine]:
        """Return the nearest line; faces that a plan crosses are left out of `faces`."""
        profile, position = situation.profile, situation.motion.position
        if profile is None:
            return None
        lines: List[Optional[StopLine]] = [self.before_face(face) for face in faces
                                           if face.position > position]
        lines.append(self.end_of_sight(profile))
        lines.append(self.before_slope(profile, position, slope, previous))
        return min((line for line in lines if line is not None), default=None,
                   key=lambda line: line.position)

    @property
    def _most(self) -> str:
        return f'{math.degrees(self.braking.steepest):.1f} degrees'

    def slope_to(self, profile: Optional[Profile], begin: float, end: float,
                 slope: float) -> float:
        """
        Return the mean slope between two positions [rad].

        A ball that brakes all the way loses as much energy on it as on the slopes in between.
        """
        if profile is None or not profile.points or end - begin < SLOPE_LENGTH_MIN:
            return slope
        return math.atan(GroundProfile(profile.points, slope).rise(begin, end) / (end - begin))

    def speed_before(self, line: float, situation: Situation, slope: float) -> float:
        """Return the speed from which the ball is stopped before a position [m/s]."""
        position = situation.motion.position
        mean = self.slope_to(situation.profile, position, line, slope)
        return self.braking.speed_within(line - position, mean, emergency=True)

    def braking_room(self, step: Face, motion: Motion, slope: float) -> float:
        """Return the distance to the last point where braking avoids a touch or fall [m]."""
        return (step.position - motion.position - touch_distance(self._radius, step.height)
                - self.braking.distance(motion.speed, slope, emergency=True))

    def cruise(self, situation: Situation, slope: float, previous: Optional[Decision]
               ) -> Decision:
        """Return CLEAR at the speed of which the ball can be stopped before the line."""
        line = self.nearest(situation, slope, (), previous)
        speed = self._tuning.cruise_speed
        if line is not None:
            room = line.position - situation.motion.position
            speed = min(speed, max(0.0, room) * SIGHT_RATE,
                        self.speed_before(line.position, situation, slope))
        return Decision(Kind.CLEAR, Reason.NOTHING_AHEAD, speed,
                        f'Nothing ahead: cruising at {speed:.2f} m/s',
                        plan=Plan(Strategy.CRUISE, situation.motion.position, speed))

    def steep(self, situation: Situation, slope: float, previous: Optional[Decision],
              disturbed: bool = False) -> Optional[Decision]:
        """
        Return the STOP that a slope below or ahead requires, if it is too steep to hold.

        The slope below is not judged where a face is so near that it is `disturbed`.
        """
        profile, motion, steepest = situation.profile, situation.motion, self.braking.steepest
        if profile is None:
            return None
        if previous is not None and previous.kind is Kind.STOP \
                and previous.reason is Reason.STEEP:
            steepest *= SLOPE_HYSTERESIS
        # Uphill only where the map shows it: the motion of the ball may show a step.  At an edge
        # the map shows the slope badly: its deviation counts, and the motion must agree.
        seen = math.isfinite(profile.slope)
        below = slope
        if seen and not slope * motion.slope > SLOPE_AGREEMENT * slope * slope:
            below = 0.0
        doubt = profile.slope_sd if seen and math.isfinite(profile.slope_sd) else 0.0
        uphill = steepest + doubt if seen else math.inf
        if not disturbed and not -steepest - doubt <= below <= uphill:
            return Decision(
                Kind.STOP, Reason.STEEP, 0.0, f'Stopping: a slope of {math.degrees(below):+.1f} '
                f'degrees is too steep, {self._most} can be held', plan=Plan(Strategy.STOP),
                distance=0.0)
        line = self.before_slope(profile, motion.position, slope, previous)
        if line is None:
            return None
        distance = line.obstacle - motion.position
        return self.stand(
            Decision(Kind.STOP, Reason.STEEP, 0.0, f'Stopping: in {distance:.2f} m comes '
                     f'{line.explanation}', distance=distance), line.obstacle, situation, slope)

    def stand(self, decision: Decision, before: float, situation: Situation,
              slope: float) -> Decision:
        """Return a decision that stands with the stop gap before a position [m], or here."""
        position = situation.motion.position
        place = before - self._radius - self._tuning.stop_gap
        if not (place >= position or place >= situation.free_from):
            return replace(decision, set_speed=0.0, plan=Plan(Strategy.STOP))
        speed = min(self._tuning.cruise_speed, self.speed_before(place, situation, slope))
        return replace(decision, set_speed=speed, plan=Plan(
            Strategy.GO_ROUND if decision.kind is Kind.GO_ROUND else Strategy.STOP,
            speed=speed, stop_position=place))

    def filtered(self, decision: Decision, situation: Situation, slope: float,
                 previous: Optional[Decision]) -> Decision:
        """
        Return a decision that leaves the ball able to stop before the line after this period.

        A crossing is left alone: rollouts have stopped the ball behind its last edge.
        """
        profile = situation.profile
        if decision.kind in (Kind.CROSS, Kind.BACK_OFF) or profile is None:
            return decision
        line = self.nearest(situation, slope, profile.faces, previous)
        if line is None:
            return decision
        most = self.speed_before(line.position, situation, slope)
        if situation.motion.speed <= most and decision.set_speed <= most:
            return decision
        if decision.kind is not Kind.CLEAR:
            if situation.motion.speed > most:  # as soon as possible, not at a place
                return replace(decision, set_speed=0.0, plan=Plan(
                    Strategy.GO_ROUND if decision.kind is Kind.GO_ROUND else Strategy.STOP))
            return replace(decision, set_speed=min(decision.set_speed, most))
        return self.stand(
            replace(decision, kind=Kind.STOP, reason=line.reason,
                    explanation=f'Stopping before {line.explanation}',
                    distance=line.obstacle - situation.motion.position),
            line.obstacle, situation, slope)


def steep_stretch(profile: Profile, position: float, steepest: float,
                  slope: float) -> Optional[Tuple[float, float]]:
    """
    Return where the ground ahead gets steeper than can be held, and its slope, or None.

    Parameters
    ----------
    profile : Profile
    position : float
        Of the ball's centre [m].
    steepest, slope : float
        That can be held, and below the ball, positive uphill [rad].

    """
    points = profile.points
    if len(points) < 2:
        return None
    floor, aside = GroundProfile(points, slope), 2e-3
    for (x, _), sd in zip(points, profile.points_sd or (0.0,) * len(points)):
        begin = x + aside
        if x < position or any(face.position - aside < begin < face.position + face.run
                               for face in profile.faces):
            continue
        end = min([begin + SLOPE_LENGTH, points[-1][0]] + [
            face.position - aside for face in profile.faces if face.position > begin])
        if end - begin < SLOPE_LENGTH_MIN:
            continue
        angle = math.atan(floor.rise(begin, end) / (end - begin))
        if steepest + 2.0 * sd / (end - begin) < abs(angle) < FACE_SLOPE:
            return x, angle
    return None
