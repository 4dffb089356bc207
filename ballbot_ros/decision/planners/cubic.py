# SPDX-License-Identifier: Apache-2.0
"""
The planner ``cubic``: section 8 of the paper, with margins.

The ball touches a step when its centre is sqrt(2 R h - h^2) before the face; what lies
before that is the run-up.  The curve says which speed at touch the step asks
for.  Whatever is not known for certain is answered with STOP and a reason, never a guess.
"""
from dataclasses import replace
import math
from typing import Optional

from ballbot_ros.crossing.rules import touch_distance
from ballbot_ros.decision.curve import HeightCurve
from ballbot_ros.decision.guard import guarded, stop
from ballbot_ros.decision.planners.reach import reach
from ballbot_ros.decision.profile import Face, Profile
from ballbot_ros.decision.situation import Knowledge, Planner, Situation
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.decision.values import Decision, Kind, Motion, Reason
from ballbot_ros.physics.model.robot import Robot

# Down by less than this is an uneven floor, more is a drop [m].
SMALLEST_DROP = 0.005

# Aim above the required speed by this [m/s]: the margin must not be eaten by the lag.
HEADROOM = 0.1

# A ball that leans against a step for this long is not going to make it [s].
LONGEST_CONTACT = 1.5

# In contact the ball bounces; this far off the step it still is in contact [m].
CONTACT_SLACK = 0.03


def planner(knowledge: Knowledge) -> Planner:
    """Return the planner for a robot, its curve and a tuning."""
    def planned(situation: Situation, previous: Optional[Decision]) -> Decision:
        return _decide(situation.profile, situation.motion, previous, knowledge)
    return planned


def decide(profile: Optional[Profile], motion: Motion, previous: Optional[Decision], *,
           robot: Robot, curve: HeightCurve, tuning: DecisionTuning) -> Decision:
    """
    Decide on the step ahead; see `situation.Planner`.

    A crossing that cannot be broken off any more goes on with half the margins, and one in
    contact goes on until the centre has passed the face.

    """
    knowledge = Knowledge(robot, curve, tuning)
    return guarded(planner(knowledge), knowledge)(Situation(motion, profile), previous)


def _decide(profile: Optional[Profile], motion: Motion, previous: Optional[Decision],
            knowledge: Knowledge) -> Decision:
    """Return the decision on observations that can be used."""
    robot, curve, tuning = knowledge.robot, knowledge.curve, knowledge.tuning
    step = profile.face if profile is not None else None
    distance = step.position - motion.position if step is not None else math.nan
    pushing = _push(previous, step, motion, robot)
    if pushing is not None:
        return pushing
    if step is None or distance <= 0.0:
        return Decision(Kind.CLEAR, Reason.NOTHING_AHEAD, tuning.cruise_speed,
                        f'Nothing ahead: cruising at {tuning.cruise_speed:.2f} m/s')
    if step.height < -SMALLEST_DROP:
        return stop(
            Reason.DROP, f'Stopping: the floor drops by {-1e3 * step.height:.0f} mm at '
            f'{distance:.2f} m', height=step.height, distance=distance, step=step.number)
    return _weigh(step, distance, motion.speed, previous, robot, curve, tuning)


def _crosses(previous: Optional[Decision], step: Face) -> bool:
    """Return whether the ball is on its way over this very step."""
    return (previous is not None and previous.kind is Kind.CROSS
            and previous.step == step.number)


def _push(previous: Optional[Decision], step: Optional[Face], motion: Motion,
          robot: Robot) -> Optional[Decision]:
    """
    Return the decision of a crossing ball in contact: on, unless it lasts too long.

    Observations do not matter here.  The face is below the ball, the odometry slips, and
    there is nothing better to do than to push.
    """
    if previous is None or step is None or not _crosses(previous, step):
        return None
    distance = step.position - motion.position
    run_up = distance - touch_distance(robot.ball_radius, step.height)
    since = previous.contact_since
    if distance <= 0.0 or run_up > (0.0 if since is None else CONTACT_SLACK):
        return None
    since = motion.stamp if since is None else since
    if not 0.0 <= motion.stamp - since <= LONGEST_CONTACT:
        return replace(
            previous, kind=Kind.STOP, reason=Reason.NO_ROOM, set_speed=0.0,
            distance=distance, contact_since=None,
            explanation='Stopping: still not over the step after '
            f'{LONGEST_CONTACT:g} s of pushing; back off for a longer run-up')
    return replace(
        previous, reason=Reason.COMMITTED, distance=distance, contact_since=since,
        explanation=f'On the step, {distance:.2f} m to its face: pushing on')


def _weigh(step: Face, distance: float, speed: float, previous: Optional[Decision],
           robot: Robot, curve: HeightCurve, tuning: DecisionTuning) -> Decision:
    """Return the decision on a known step ahead."""
    margins = (tuning.speed_margin, tuning.height_margin, tuning.sigma_margin)
    reason = Reason.WITHIN_CURVE
    found = reach(step, distance, speed, margins, robot, curve, tuning)
    if _crosses(previous, step) and found.run_up < tuning.braking_distance(speed):
        reason, margins = Reason.COMMITTED, tuning.halved
        found = reach(step, distance, speed, margins, robot, curve, tuning)
    needed = found.required
    answer = Decision(
        Kind.CROSS, reason, 0.0, '', math.nan if needed is None else needed,
        found.reachable, step.height, found.spare, distance, step.number)
    where = f'{1e3 * step.height:.0f} mm at {distance:.2f} m'
    if needed is None or needed > found.top:
        wish = 'more than the curve knows' if needed is None else f'{needed:.2f} m/s'
        return replace(
            answer, kind=Kind.GO_ROUND, reason=Reason.TOO_HIGH,
            set_speed=min(tuning.cruise_speed, found.top),
            explanation=f'{where}: needs {wish}, {found.top:.2f} m/s is the most; '
            'find another way')
    if found.slowest > curve.highest_speed:
        return replace(
            answer, kind=Kind.STOP, reason=Reason.TOO_FAST,
            explanation=f'{where}: touched at {found.slowest:.2f} m/s even when braking, the '
            f'curve ends at {curve.highest_speed:.2f} m/s')
    if not needed <= found.reachable:
        return replace(
            answer, kind=Kind.STOP, reason=Reason.NO_ROOM,
            explanation=f'{where}: needs {needed:.2f} m/s, only {found.reachable:.2f} m/s '
            'reachable from here; a longer run-up would do')
    # Going on with half the margins is no reason to slow down.
    pace = previous.set_speed if previous and reason is Reason.COMMITTED else 0.0
    return replace(
        answer, set_speed=min(found.top, max(tuning.cruise_speed, needed + HEADROOM, pace)),
        explanation=f'{where}: needs {needed:.2f} m/s, {found.reachable:.2f} m/s reachable, '
        f'{math.floor(1e3 * found.spare):.0f} mm to spare')
