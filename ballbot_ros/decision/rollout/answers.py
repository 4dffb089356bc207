# SPDX-License-Identifier: Apache-2.0
"""From a choice to a decision, with its plan, its numbers and one sentence."""
from dataclasses import replace
import math

from ballbot_ros.decision.plan import After, Plan
from ballbot_ros.decision.rollout.ahead import Ahead
from ballbot_ros.decision.rollout.candidates import Candidate, HELD
from ballbot_ros.decision.rollout.deliberation import Choice
from ballbot_ros.decision.rollout.layout import TIGHT
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.decision.values import Decision, Kind, Motion, Outlook, Reason

WHY = {
    Reason.NOT_LIKELY: 'no plan gets over with the required probability',
    Reason.LANDING: 'the ball could not be stopped behind the edge',
    Reason.TOO_HIGH: 'no plan gets over from any start; find another way',
    Reason.NO_ROOM: 'only a longer run-up would do',
    Reason.FAILED_BEFORE: 'it was tried, and no plan that promises more is left',
    Reason.DROP: 'the floor falls away',
    Reason.WALL: 'a wall; find another way',
    Reason.TOO_FAST: 'the ball cannot be stopped before it any more',
    Reason.STUCK: 'the ball does not get on',
}
# Where waiting or looking again does not help.
HOPELESS = (Reason.TOO_HIGH, Reason.WALL, Reason.LANDING, Reason.FAILED_BEFORE)


def outlook(choice: Choice, required: float, braking_room: float) -> Outlook:
    """Return what is expected of a choice."""
    tally = choice.tally
    number = max(tally.attempts, 1.0)
    known = tally.attempts > 0.0
    return Outlook(
        tally.probability if known else math.nan, tally.stuck / number if known else math.nan,
        tally.falling if known else math.nan, required, tally.speed, choice.limit, braking_room,
        int(round(tally.attempts)), choice.others)


def plan_of(candidate: Candidate, ahead: Ahead, next_at: float) -> Plan:
    """
    Return the plan of a candidate.

    Parameters
    ----------
    candidate : Candidate
    ahead : Ahead
    next_at : float
        Where the centre meets what comes behind the plan's last edge [m].

    """
    end = candidate.end(ahead)
    after = After.STOP if next_at - end.position < TIGHT else After.CRUISE
    return Plan(
        candidate.strategy, ahead.touch - candidate.back if candidate.back > 0.0 else -math.inf,
        candidate.speed, ahead.touch - candidate.swing, candidate.angle, end.position + HELD,
        after)


def go(choice: Choice, candidate: Candidate, ahead: Ahead, motion: Motion, next_at: float,
       braking_room: float, tuning: DecisionTuning) -> Decision:
    """Return the decision to carry out a plan."""
    plan = plan_of(candidate, ahead, next_at)
    face = ahead.faces[0]
    back = candidate.back > 0.0
    # Where it backs off to, it will be asked again: until then nothing is crossed at any speed.
    speed = min(candidate.speed, tuning.cruise_speed) if back else candidate.speed
    plan = replace(plan, speed=speed)
    seen = outlook(choice, tuning.required_probability, braking_room)
    where = f'{1e3 * face.height:.0f} mm at {face.position - motion.position:.2f} m'
    how = f'{candidate.strategy.value} at up to {candidate.speed:.2f} m/s'
    if math.isfinite(plan.swing_position):
        how += (f', pendulum to {math.degrees(candidate.angle):.0f} deg '
                f'{candidate.swing:.2f} m before the touch')
    reason = Reason.RUN_UP if back else Reason.COMMITTED if braking_room < 0.0 else Reason.LIKELY
    said = f'{where}: {how}, over with {100 * seen.probability:.0f} % ({seen.attempts} attempts)'
    if back:
        said = f'{where}: back to {motion.position - plan.start:.2f} m behind here first; {said}'
    return Decision(
        Kind.BACK_OFF if back else Kind.CROSS, reason, speed, said,
        height=face.height, height_margin=choice.limit - face.height,
        distance=face.position - motion.position, step=face.number,
        start_distance=motion.position - plan.start if back else 0.0,
        swing_distance=plan.swing_position - motion.position, plan=plan, outlook=seen)


def refuse(choice: Choice, ahead: Ahead, motion: Motion, braking_room: float,
           tuning: DecisionTuning) -> Decision:
    """Return the decision not to cross the first face; it does not say yet where to stand."""
    face = ahead.faces[0]
    seen = outlook(choice, tuning.required_probability, braking_room)
    hopeless = choice.reason in HOPELESS
    what = f'drops by {-1e3 * face.height:.0f} mm' if face.height < 0.0 else \
        f'{1e3 * face.height:.0f} mm'
    said = (f'{what} at {face.position - motion.position:.2f} m: '
            f'{WHY.get(choice.reason, "no plan is good enough")}')
    if seen.attempts:
        said += (f'; at best over with {100 * seen.probability:.0f} %, '
                 f'{100 * tuning.required_probability:.0f} % are required')
    return Decision(
        Kind.GO_ROUND if hopeless else Kind.STOP, choice.reason, tuning.cruise_speed, said,
        height=face.height, distance=face.position - motion.position, step=face.number,
        outlook=seen)


def weighing(ahead: Ahead, motion: Motion, tuning: DecisionTuning) -> Decision:
    """Return the decision of a ball that rolls on while plans are weighed."""
    face = ahead.faces[0]
    distance = face.position - motion.position
    return Decision(
        Kind.CLEAR, Reason.NOT_LIKELY, tuning.cruise_speed,
        f'{1e3 * face.height:.0f} mm at {distance:.2f} m: weighing plans on the way',
        height=face.height,
        step=face.number, distance=distance)
