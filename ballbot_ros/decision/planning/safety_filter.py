# SPDX-License-Identifier: Apache-2.0
"""
Safety filter around a planner: validates its inputs and its decisions.

Pure functions.  `unusable` checks the inputs before planning; `checked` checks the decision.
`with_safety_filter` wraps a planner in both.
"""
from dataclasses import replace
import math
from typing import Optional

from ballbot_ros.decision.planning.curve import bisected
from ballbot_ros.decision.planning.situation import Knowledge, Planner, Situation
from ballbot_ros.decision.planning.stop_line import StopLines
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.decision.values import Decision, Kind, Reason, UNSEEN
from ballbot_ros.physics.model.robot import Robot

ROUNDING_TOLERANCE = 1e-9  # [m/s], [m]


def stop(reason: Reason, explanation: str, **numbers: float) -> Decision:
    """Return a STOP as soon as possible."""
    return Decision(Kind.STOP, reason, 0.0, explanation, **numbers)  # type: ignore[arg-type]


def energy_bound(robot: Robot, speed: float, swing: float) -> float:
    """
    Return an upper bound of the step height that can be crossed at a speed [m].

    All kinetic energy, the potential energy of the pendulum at its largest swing angle, and its
    work during the ascent raise the ball to the height h of the step::

        M g h = (M + J1 / R^2) v^2 / 2 + M2 g e (1 - cos(swing) + acos(1 - h / R))

    The bound is at most the radius: a higher face is a wall.  `speed` is that at the touch, or
    its upper bound [m/s]; `swing` is the largest angle of the pendulum [rad].
    """
    radius, pendulum = robot.ball_radius, robot.largest_gravity_torque
    given = pendulum * (1.0 - math.cos(swing)) + 0.5 * speed * speed * (
        robot.total_mass + robot.ball_inertia / radius**2)
    # The energy surplus decreases with the height, or increases first and then decreases: it has
    # one zero below the radius if it is negative at the radius.
    if given + pendulum * 0.5 * math.pi >= robot.weight * radius:
        return radius
    return bisected(lambda height: not given + pendulum * math.acos(
        1.0 - height / radius) >= robot.weight * height, 0.0, radius, 40)


def unusable(situation: Situation, stale: float, tuning: DecisionTuning) -> Optional[Decision]:
    """
    Return STOP for missing, stale, rejected or non-finite input, otherwise None.

    `stale` [s] is the last time with an observation older than `observation_timeout`.  STOP lasts
    for that timeout, so that the decision does not alternate at a latency near the limit.
    """
    fault = implausible_input(situation)
    if fault:
        return stop(Reason.BAD_OBSERVATION, f'Stopping: {fault}')
    motion, profile, allowed = situation.motion, situation.profile, tuning.observation_timeout
    if profile is UNSEEN:
        return stop(Reason.STALE, 'Stopping: nothing has been observed yet')
    if profile.rejection is not None:
        answer = stop(profile.rejection,
                      f'Stopping: the observation is rejected because {profile.explanation}')
    elif 0.0 <= motion.stamp - stale < allowed:
        age = motion.stamp - profile.stamp
        when = f'{age:.2f} s old' if age >= 0.0 else f'{-age:.2f} s ahead of the clock'
        answer = stop(
            Reason.STALE, f'Stopping: the last observation is {when}; {allowed:g} s is allowed'
            + ('' if stale == motion.stamp else f' and was exceeded {motion.stamp - stale:.2f} s '
               'ago'))
    else:
        return None
    face = profile.face
    return answer if face is None else replace(
        answer, distance=face.position - motion.position, step=face.number)


def implausible_input(situation: Situation) -> str:
    """Return which input is implausible, or an empty string."""
    # Comparisons with NaN are false and could pass the checks below.
    if not situation.motion.is_plausible:
        return 'odometry is not finite, or out of range'
    if not situation.profile.is_plausible:
        return 'the step is not finite, or out of range'
    return ''


def checked(decision: Decision, situation: Situation, knowledge: Knowledge) -> Decision:
    """
    Return a decision, or the STOP that replaces it.

    A crossing is accepted only if its face is known and not passed, its speed is at most
    `highest_speed`, its swing at most `largest_swing`, and the step is within
    `energy_bound`.  The speed of other decisions is at most `cruise_speed`, and backing off ends
    within ground that is known to be free.
    """
    tuning, plan = knowledge.tuning, decision.plan
    crossing = decision.kind is Kind.CROSS
    most = tuning.highest_speed if crossing else tuning.cruise_speed
    # Written so that NaN is refused.
    if not (all(0.0 <= speed <= most + ROUNDING_TOLERANCE
                for speed in (decision.set_speed, plan.speed))
            and abs(plan.swing_angle) <= tuning.largest_swing):
        return stop(
            Reason.BAD_OBSERVATION, f'Stopping: a plan requested {decision.set_speed:g} and '
            f'{plan.speed:g} m/s and {plan.swing_angle:g} rad; {most:g} m/s and '
            f'{tuning.largest_swing:g} rad are allowed')
    if decision.kind is Kind.BACK_OFF \
            and not plan.start >= situation.free_from - ROUNDING_TOLERANCE:
        if plan.start < situation.free_from < situation.motion.position:
            return replace(decision, plan=replace(plan, start=situation.free_from))
        return stop(Reason.NO_ROOM, 'Stopping: a plan backs off over ground that is not known '
                    'to be free')
    if not crossing:
        return decision
    face = next((item for item in situation.profile.faces if item.number == decision.step), None)
    if face is None and situation.motion.position < plan.edge and decision.committed:
        return decision  # past the last braking point, or its face is below the ball
    if face is None:
        return stop(Reason.BAD_OBSERVATION, 'Stopping: a plan crosses an unknown step')
    bound = energy_bound(knowledge.robot, max(tuning.highest_speed, situation.motion.speed),
                         max(tuning.largest_lean, abs(plan.swing_angle)))
    if not face.height <= bound:
        return stop(
            Reason.TOO_HIGH, f'Stopping: {1e3 * face.height:.0f} mm exceed the height to which '
            f'all energy lifts the ball, {1e3 * bound:.0f} mm', step=face.number,
            height=face.height, distance=face.position - situation.motion.position)
    return decision


def with_safety_filter(planner: Planner, knowledge: Knowledge) -> Planner:
    """
    Return a planner that is called with valid input only, and whose decisions are `checked`.

    A ball past the last braking point of a crossing continues even if an observation is old or
    rejected: braking would be worse.
    """
    lines, timeout, stale = StopLines(knowledge), knowledge.tuning.observation_timeout, -math.inf

    def answer(situation: Situation, previous: Optional[Decision]) -> Decision:
        nonlocal stale
        now, profile = situation.motion.stamp, situation.profile
        if profile is not UNSEEN and not abs(now - profile.stamp) <= timeout:
            stale = now  # also for NaN, and for a stamp in the future
        trouble = unusable(situation, stale, knowledge.tuning)
        if trouble is not None and not past_braking(previous, situation):
            return trouble
        planned = lines.filtered(planner(situation, previous), situation)
        return checked(planned, situation, knowledge)
    return answer


def past_braking(previous: Optional[Decision], situation: Situation) -> bool:
    """Return whether the ball is past the last braking point of a crossing."""
    if previous is None or not previous.committed or situation.profile is UNSEEN \
            or implausible_input(situation):
        return False
    # Between two edges of a plan, the ball may already have passed the step.
    return situation.motion.position < previous.plan.edge < math.inf \
        or any(face.number == previous.step for face in situation.profile.faces)
