# SPDX-License-Identifier: Apache-2.0
"""Goals in closed loop: the ball drives to a position, or over a step, and ends at rest."""
from dataclasses import replace
import math

import pytest
from refusals import refused

from ballbot_ros.control import load_tuning
from ballbot_ros.decision import (
    CrossGoal, Decider, Decision, DriveGoal, Ending, Goals, Kind, Knowledge, load_curve,
    load_decision_tuning, Motion, Phase, Reason, StepObservation)
from ballbot_ros.physics.model.robot import load_robot
from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.studies.evaluation.closed_loop import ClosedLoop, PERIOD

GIMBALL = load_robot('gimball')
TUNING = replace(load_decision_tuning('decision_default'), unseen_room=1.0)
KNOWLEDGE = Knowledge(GIMBALL, load_curve('gimball_down'), TUNING)
START = Motion(0.0, 0.0, 0.0)
NAN, INF = math.nan, math.inf


class Ride:
    """Closed loop of a ball before a step, or on a floor without one, with an exact sensor."""

    def __init__(self, height=0.0, face=3.0, seen=True):
        ground = [[-9.0, 0.0], [face, 0.0], [face, height], [20.0, height]] if height else [
            [-9.0, 0.0], [20.0, 0.0]]
        self.loop = ClosedLoop(GIMBALL, Terrain(ground), GIMBALL, load_tuning('published'),
                               0.0, 0.0)
        self.height, self.face, self.seen = height, face, seen
        self.decider = Decider(KNOWLEDGE, 'cubic')
        self.fastest, self.phases = 0.0, []
        self.tick()

    @property
    def motion(self):
        state = self.loop.state
        return Motion(state.time, state.x, state.velocity_x)

    def tick(self):
        """Advance by 20 ms, and return the end of the goal, or None."""
        now = self.motion
        distance = self.face - now.position
        detected = bool(self.height) and distance > 0.05
        if self.seen:
            self.decider.observe(StepObservation(
                now.stamp, detected, distance if detected else 3.0,
                self.height if detected else 0.0, 0.002, 0.0005))
        self.decider.move(now)
        answer = self.decider.decide()
        self.loop.advance(answer.set_angle, round(0.02 / PERIOD))
        self.fastest = max(self.fastest, abs(self.motion.speed))
        phase = getattr(self.decider.goals.goal, 'phase', None)
        if phase is not None and phase not in self.phases:
            self.phases.append(phase)
        return self.decider.end

    def drive(self, target, limit=0.0, timeout=0.0):
        """Set the goal to drive to a position."""
        self.decider.goals.begin(DriveGoal(
            self.motion, target, limit, 0.0, timeout, TUNING, GIMBALL.ball_radius,
            self.decider.free_from))

    def until_the_end(self, seconds=40.0):
        """Advance until the goal has ended, and return its end."""
        for _ in range(int(seconds / 0.02)):
            end = self.tick()
            if end is not None:
                assert abs(self.motion.speed) < 0.05
                return end
        raise AssertionError(f'the goal has not ended: {self.decider.decision}')


@pytest.mark.slow
def test_the_ball_drives_to_a_position_and_stays_there():
    ride = Ride()
    ride.drive(2.0)
    assert ride.until_the_end().ending is Ending.REACHED
    assert ride.motion.position == pytest.approx(2.0, abs=0.05)
    assert ride.fastest < TUNING.cruise_speed + 0.05
    for _ in range(200):
        ride.tick()
    assert ride.motion.position == pytest.approx(2.0, abs=0.05)


def test_a_goal_behind_is_reached_where_the_ground_is_known_to_be_free():
    ride = Ride()
    ride.drive(1.0)
    ride.until_the_end()
    ride.drive(0.3)
    assert ride.until_the_end().ending is Ending.REACHED
    assert ride.motion.position == pytest.approx(0.3, abs=0.05)
    with refused('out_of_range', 'target'):
        ride.drive(-0.5)


def test_the_speed_limit_holds_while_driving():
    ride = Ride()
    ride.drive(1.0, limit=0.2)
    assert ride.until_the_end().ending is Ending.REACHED
    assert ride.fastest < 0.25


def test_a_canceled_goal_ends_with_the_ball_at_rest():
    ride = Ride()
    ride.drive(5.0)
    while ride.motion.speed < 0.35:
        ride.tick()
    ride.decider.goals.goal.cancel()
    end = ride.until_the_end()
    assert end.ending is Ending.CANCELED and ride.motion.position < 2.0


def test_a_goal_that_times_out_ends_with_the_ball_at_rest():
    ride = Ride()
    ride.drive(5.0, timeout=2.0)
    end = ride.until_the_end()
    assert end.ending is Ending.TIMED_OUT and '2 s' in end.message


def test_a_goal_behind_a_step_too_high_is_blocked_with_the_explanation_of_the_decision():
    ride = Ride(height=0.12)
    ride.drive(6.0)
    end = ride.until_the_end()
    assert end.ending is Ending.BLOCKED
    assert ride.decider.planned.kind in (Kind.GO_ROUND, Kind.STOP)
    assert end.message == ride.decider.planned.explanation
    assert ride.motion.position < ride.face - GIMBALL.ball_radius


def test_a_goal_behind_a_low_step_is_reached_by_crossing_it():
    ride = Ride(height=0.02)
    ride.drive(4.5)
    assert ride.until_the_end().ending is Ending.REACHED
    assert ride.motion.position == pytest.approx(4.5, abs=0.05)
    assert ride.loop.state.y == pytest.approx(GIMBALL.ball_radius + 0.02, abs=0.002)


def test_a_goal_on_the_edge_of_a_step_is_blocked():
    ride = Ride(height=0.02)
    ride.drive(3.1)
    end = ride.until_the_end()
    assert end.ending is Ending.BLOCKED and 'cannot stop' in end.message
    assert ride.motion.position < ride.face - GIMBALL.ball_radius


def test_a_step_that_requires_more_than_the_speed_limit_is_not_crossed():
    ride = Ride(height=0.025)
    ride.drive(5.0, limit=0.3)
    end = ride.until_the_end()
    assert end.ending is Ending.BLOCKED and '0.3 m/s is the limit' in end.message
    assert ride.fastest < 0.4


def test_without_observations_a_goal_is_blocked():
    ride = Ride(seen=False)
    ride.drive(2.0)
    end = ride.until_the_end()
    assert end.ending is Ending.BLOCKED and ride.decider.planned.reason is Reason.STALE


def test_the_step_ahead_is_crossed_and_the_ball_rests_behind_it():
    ride = Ride(height=0.02, face=2.0)
    ride.decider.goals.begin(CrossGoal(ride.motion, 0.0))
    end = ride.until_the_end()
    assert end.ending is Ending.CROSSED and '20 mm' in end.message
    assert ride.motion.position > 2.0
    assert ride.loop.state.y == pytest.approx(GIMBALL.ball_radius + 0.02, abs=0.002)
    assert ride.phases[0] is Phase.APPROACHING and ride.phases[-1] is Phase.STOPPING


def test_a_goal_reports_its_own_step_and_not_the_one_behind_it():
    goal = CrossGoal(START, 0.0)
    first = Decision(Kind.CROSS, Reason.LIKELY, 0.6, 'cross', height=0.012, distance=1.0, step=1)
    second = replace(first, kind=Kind.GO_ROUND, distance=1.4, height=0.08, step=2)
    goal.update(first, Motion(0.1, 0.0, 0.5), None)
    goal.update(second, Motion(2.0, 1.6, 0.5), None)
    for number in range(40):
        end = goal.update(second, Motion(2.1 + 0.02 * number, 1.6, 0.0), None)
    assert end.ending is Ending.CROSSED and end.message == 'over the step of 12 mm'
    assert goal.height == 0.012


def test_a_goal_stops_behind_its_step_although_a_plan_crosses_the_next_one():
    goals = Goals()
    goals.begin(CrossGoal(START, 0.0))
    first = Decision(Kind.CROSS, Reason.LIKELY, 0.4, 'cross', height=-0.012, distance=1.0, step=1)
    renumbered = replace(first, distance=0.5, step=2)
    following = replace(first, distance=0.7, height=0.009, step=3)
    for stamp, position, planned, kind in ((0.1, 0.0, first, Kind.CROSS),
                                           (1.0, 0.5, renumbered, Kind.CROSS),
                                           (3.0, 1.2, following, Kind.STOP)):
        motion = Motion(stamp, position, 0.4)
        assert goals.constrain(planned, motion).kind is kind
        assert goals.update(planned, motion, None) is None
    ends = [goals.update(following, Motion(3.1 + 0.1 * number, 1.3, 0.0), None)
            for number in range(10)]
    end = next(filter(None, ends))
    assert end.ending is Ending.CROSSED and end.message == 'over the step of -12 mm'


@pytest.mark.parametrize('stop', [lambda goals: goals.goal.cancel(), lambda goals: goals.end()])
def test_a_stop_continues_a_committed_crossing_but_starts_none(stop):
    likely = Decision(Kind.CROSS, Reason.LIKELY, 0.6, 'cross', height=0.012, distance=1.0, step=1)
    late = replace(likely, reason=Reason.COMMITTED)
    for before, kind in (likely, Kind.STOP), (late, Kind.CROSS):
        goals = Goals()
        goals.begin(CrossGoal(START, 0.0))
        goals.constrain(before, START)
        stop(goals)
        for planned in before, late:
            assert goals.constrain(planned, START).kind is kind


def test_the_crossing_of_a_step_too_high_is_refused():
    ride = Ride(height=0.12, face=2.0)
    ride.decider.goals.begin(CrossGoal(ride.motion, 0.0))
    end = ride.until_the_end()
    assert end.ending is Ending.REFUSED and end.message == ride.decider.planned.explanation


def test_without_a_step_to_cross_the_ball_stays_at_rest():
    ride = Ride()
    ride.decider.goals.begin(CrossGoal(ride.motion, 0.0))
    assert ride.until_the_end().ending is Ending.NO_STEP
    assert abs(ride.motion.position) < 0.05


def test_a_second_goal_is_refused_and_the_ball_rests_after_a_goal_until_resumed():
    ride = Ride()
    ride.drive(0.5)
    with refused('busy', 'goal'):
        ride.drive(1.0)
    with refused('busy', 'goal'):
        ride.decider.goals.go_on()
    ride.until_the_end()
    ride.decider.goals.go_on()
    for _ in range(200):
        ride.tick()
    assert ride.motion.position > 1.0
    assert ride.decider.decision.kind is Kind.CLEAR


@pytest.mark.parametrize('changes, field', [
    ({'target': NAN}, 'target'), ({'target': INF}, 'target'), ({'target': -1e9}, 'target'),
    ({'speed_limit': NAN}, 'speed_limit'), ({'speed_limit': -0.2}, 'speed_limit'),
    ({'speed_limit': 5.0}, 'speed_limit'), ({'tolerance': NAN}, 'tolerance'),
    ({'tolerance': -1.0}, 'tolerance'), ({'timeout': NAN}, 'timeout'),
    ({'timeout': -1.0}, 'timeout'), ({'target': -1.0}, 'target')])
def test_impossible_goals_are_refused(changes, field):
    asked = {'target': 1.0, 'speed_limit': 0.0, 'tolerance': 0.0, 'timeout': 0.0, **changes}
    with refused('out_of_range', field):
        DriveGoal(START, tuning=TUNING, radius=0.226, free_from=0.0, **asked)


@pytest.mark.parametrize('timeout', [NAN, -1.0, INF])
def test_an_invalid_timeout_is_refused(timeout):
    with refused('out_of_range', 'timeout'):
        CrossGoal(START, timeout)
