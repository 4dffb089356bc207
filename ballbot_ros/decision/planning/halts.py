# SPDX-License-Identifier: Apache-2.0
"""Where to stand before what is not crossed, and how fast to drive where nothing is ahead."""
from dataclasses import replace
import math
from typing import Optional

from ballbot_ros.crossing.rules import touch_distance
from ballbot_ros.decision.planning.beyond import SMALLEST_DROP, steep_ahead
from ballbot_ros.decision.planning.braking import Braking
from ballbot_ros.decision.planning.safety_filter import stop
from ballbot_ros.decision.planning.situation import Knowledge, Situation
from ballbot_ros.decision.values import (
    Decision, Face, Kind, Motion, Outlook, Plan, Profile, Reason, Strategy)

# Kept to where the sight ends [m], and the speed there in parts of the room [1/s]: a set speed is
# followed within half a second.
SIGHT_GAP, SIGHT_RATE = 0.1, 1.0

# A slope that is seen below the ball is there where at least this part of it is felt.
AGREEING = 0.4


class Halts:
    """Stops that need no planning; slopes are those below the ball, positive uphill [rad]."""

    def __init__(self, knowledge: Knowledge):
        """Work the constants out once."""
        self._radius, self._tuning = knowledge.robot.ball_radius, knowledge.tuning
        self.braking = Braking(knowledge.robot, knowledge.tuning, knowledge.control)

    def braking_room(self, step: Face, motion: Motion, slope: float) -> float:
        """Return the way to the last point where braking still avoids a touch or fall [m]."""
        return (step.position - motion.position - touch_distance(self._radius, step.height)
                - self.braking.distance(motion.speed, slope, emergency=True))

    def cruise(self, profile: Profile, motion: Motion, slope: float) -> Decision:
        """Return CLEAR: as fast as it cruises, but able to stop within what is seen."""
        room = profile.seen_to - motion.position - self._radius - SIGHT_GAP
        speed = min(self._tuning.cruise_speed, max(0.0, room) * SIGHT_RATE,
                    self.braking.speed_within(room, slope, emergency=True))
        return Decision(Kind.CLEAR, Reason.NOTHING_AHEAD, speed,
                        f'Nothing ahead: cruising at {speed:.2f} m/s',
                        plan=Plan(Strategy.CRUISE, motion.position, speed))

    def drop(self, step: Face, situation: Situation, slope: float,
             previous: Optional[Decision]) -> Optional[Decision]:
        """Return the STOP before a face that drops, None for one that does not."""
        was = (previous is not None and previous.reason is Reason.DROP
               and previous.step == step.number)
        # What was a drop stays one for a little less: noise is no news.
        if not step.height < -SMALLEST_DROP + (0.001 if was else 0.0):
            return None
        distance = step.position - situation.motion.position
        outlook = Outlook(required=self._tuning.required_probability,
                          braking_room=self.braking_room(step, situation.motion, slope))
        return self.stand(
            Decision(Kind.STOP, Reason.DROP, 0.0, 'Stopping: the floor drops by '
                     f'{-1e3 * step.height:.0f} mm at {distance:.2f} m', height=step.height,
                     distance=distance, step=step.number, outlook=outlook),
            step.position, situation, slope)

    def steep(self, profile: Profile, situation: Situation, slope: float,
              previous: Optional[Decision]) -> Optional[Decision]:
        """Return the STOP that a slope below or ahead asks for, if it is too steep to hold."""
        steepest, position = self.braking.steepest, situation.motion.position
        if previous is not None and previous.kind is Kind.STOP \
                and previous.reason is Reason.STEEP:
            steepest *= 0.9
        most = f'{math.degrees(self.braking.steepest):.1f} degrees can be held'
        # Uphill only where it is seen: what is felt may be a step.
        # At an edge the slope is seen badly: its deviation tells, and what is felt must agree.
        seen = math.isfinite(profile.slope)
        felt = situation.motion.slope
        if seen and not slope * felt > AGREEING * slope * slope:
            slope = 0.0
        doubt = profile.slope_sd if seen and math.isfinite(profile.slope_sd) else 0.0
        if not -steepest - doubt <= slope <= (steepest + doubt if seen else math.inf):
            return stop(Reason.STEEP, f'Stopping: the slope of {math.degrees(slope):+.1f} degrees '
                        f'is too steep, {most}', distance=0.0)
        ahead = steep_ahead(profile, position, steepest)
        if ahead is None:
            return None
        at, angle = ahead
        return self.stand(
            Decision(Kind.STOP, Reason.STEEP, 0.0, f'Stopping: in {at - position:.2f} m the slope '
                     f'gets {math.degrees(angle):+.1f} degrees steep, {most}',
                     distance=at - position), at, situation, slope)

    def stand(self, decision: Decision, before: float, situation: Situation,
              slope: float) -> Decision:
        """Return a decision that stands with the stop gap before a place [m], or at once."""
        position = situation.motion.position
        place = before - self._radius - self._tuning.stop_gap
        if not (place >= position or place >= situation.free_from):
            return replace(decision, set_speed=0.0, plan=Plan(Strategy.STOP))
        speed = min(self._tuning.cruise_speed,
                    self.braking.speed_within(place - position, slope, emergency=True))
        return replace(decision, set_speed=speed, plan=Plan(
            Strategy.GO_ROUND if decision.kind is Kind.GO_ROUND else Strategy.STOP,
            speed=speed, stop_position=place))
