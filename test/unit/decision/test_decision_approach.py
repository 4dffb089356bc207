# SPDX-License-Identifier: Apache-2.0
"""The approach: angles, and the whole loop of decision, law (11) and a rolling ball."""
import math

import numpy as np
import pytest

from ballbot_ros.control import (
    JointReadings, load_tuning, PendulumController, RollingModel, SetPoint)
from ballbot_ros.crossing.rules import touch_distance
from ballbot_ros.decision import (
    approach_speed, decide, Decision, Kind, load_curve, load_decision_tuning, Motion, Reason,
    set_angle, StepObservation, StepTracker)
from ballbot_ros.physics.model.robot import load_robot

GIMBALL = load_robot('gimball')
CURVE = load_curve('gimball_down')
TUNING = load_decision_tuning('decision_default')
RADIUS = GIMBALL.ball_radius


def answer(kind, set_speed=0.4, **numbers):
    return Decision(Kind(kind), Reason.NOTHING_AHEAD, set_speed, '', **numbers)


def test_leans_towards_the_wanted_speed_and_no_further_than_allowed():
    assert set_angle(answer('clear'), 0.4, GIMBALL, TUNING) == 0.0
    assert set_angle(answer('clear'), 0.3, GIMBALL, TUNING) == pytest.approx(0.18)
    assert set_angle(answer('clear'), 3.0, GIMBALL, TUNING) == -TUNING.largest_lean
    assert set_angle(answer('stop', 0.0), 0.0, GIMBALL, TUNING) == 0.0


def test_slower_than_required_leans_as_far_as_allowed():
    slow = answer('cross', 1.0, required_speed=0.9)
    assert set_angle(slow, 0.899, GIMBALL, TUNING) == TUNING.largest_lean
    assert set_angle(slow, 0.901, GIMBALL, TUNING) == pytest.approx(0.099 * TUNING.speed_gain)
    assert set_angle(slow, 0.9, GIMBALL, TUNING) == pytest.approx(0.1 * TUNING.speed_gain)
    assert set_angle(answer('clear', 1.0, required_speed=0.9), 0.8, GIMBALL, TUNING) \
        == pytest.approx(0.2 * TUNING.speed_gain)


@pytest.mark.parametrize('speed', [math.nan, math.inf, -math.inf])
def test_without_a_speed_the_pendulum_hangs_down(speed):
    assert set_angle(answer('cross', required_speed=0.9), speed, GIMBALL, TUNING) == 0.0


def test_speed_before_an_obstacle_leaves_room_to_stop():
    previous = math.inf
    for distance in np.linspace(3.0, 0.0, 301):
        speed = approach_speed(answer('go_round', distance=distance), GIMBALL, TUNING)
        gap = distance - RADIUS - TUNING.stop_gap
        assert speed <= previous
        assert TUNING.braking_distance(speed) <= max(0.0, gap) + 1e-9
        previous = speed
    assert speed == 0.0
    assert approach_speed(answer('go_round', distance=math.nan), GIMBALL, TUNING) == 0.0


def test_before_an_obstacle_reaction_and_braking_take_up_the_gap():
    for gap in (0.011, 0.05, 0.3):
        speed = approach_speed(answer('go_round', 9.9, distance=RADIUS + TUNING.stop_gap + gap),
                               GIMBALL, TUNING)
        assert TUNING.braking_distance(speed) == pytest.approx(gap)
    near = answer('go_round', distance=RADIUS + TUNING.stop_gap + 0.009)
    assert approach_speed(near, GIMBALL, TUNING) == 0.0, 'it rests, and does not creep'


def test_far_from_an_obstacle_and_before_a_crossing_the_set_speed_is_driven():
    assert approach_speed(answer('go_round', distance=9.0), GIMBALL, TUNING) == 0.4
    for kind in ('clear', 'cross', 'stop'):
        assert approach_speed(answer(kind, distance=0.1), GIMBALL, TUNING) == 0.4


def drive(height, face, *, seconds=15.0, gains='published', rate=500, speed=0.0, noise=0.0):
    """
    Return rows (time, position, speed, pendulum angle) and decisions up to touch.

    The rolling model under law (11) at `rate`, decisions at 50 Hz.
    """
    random, model = np.random.default_rng(5), RollingModel(GIMBALL)
    controller = PendulumController(GIMBALL, load_tuning(gains))
    tracker = StepTracker(GIMBALL, TUNING)
    state = np.array([0.0, 0.0, 0.0, -speed / RADIUS])   # phi, phi', theta1, theta1'
    step = 1.0 / 1000.0
    rows, decisions = [], []

    def slope(now, torque):
        pendulum, ball = model.accelerations(now[0], now[1], now[3], torque)
        return np.array([now[1], pendulum, now[3], ball])

    for index in range(int(seconds * rate)):
        now, x, v = index / rate, -RADIUS * state[2], -RADIUS * state[3]
        if index % (rate // 50) == 0:
            track = tracker.update(StepObservation(
                now, True, max(0.0, face - x + random.normal(0.0, noise)),
                height + random.normal(0.0, 0.1 * noise), noise, 0.1 * noise), x)
            decisions.append(decide(
                track, Motion(now, x, v), decisions[-1] if decisions else None,
                robot=GIMBALL, curve=CURVE, tuning=TUNING))
            controller.give(SetPoint('hold', set_angle(decisions[-1], v, GIMBALL, TUNING), now))
        rows.append((now, x, v, state[0]))
        if face - x <= touch_distance(RADIUS, height):
            break
        torque = controller.torque(JointReadings(
            now, state[2], state[0] - state[2], state[3], state[1] - state[3]))
        for _ in range(1000 // rate):
            k1 = slope(state, torque)
            k2 = slope(state + step / 2 * k1, torque)
            k3 = slope(state + step / 2 * k2, torque)
            k4 = slope(state + step * k3, torque)
            state = state + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return np.array(rows), decisions


@pytest.mark.parametrize('gains, rate, noise', [
    ('published', 500, 0.0), ('published', 500, 0.005), ('gentle', 100, 0.0)])
def test_from_rest_the_paper_s_run_up_is_enough_for_31_mm(gains, rate, noise):
    rows, decisions = drive(0.031, 1.2, gains=gains, rate=rate, noise=noise)
    assert decisions[-1].kind is Kind.CROSS
    settled = [item for item in decisions if item.reason is Reason.WITHIN_CURVE]
    assert {item.kind for item in decisions[10:]} == {Kind.CROSS}
    # At touch it is as fast as the full margins ask for, not only the halved ones.
    assert rows[-1, 1] == pytest.approx(1.2 - touch_distance(RADIUS, 0.031), abs=0.01)
    assert rows[-1, 2] >= settled[-1].required_speed >= decisions[-1].required_speed


@pytest.mark.parametrize('speed', [0.0, 0.4])
def test_what_is_said_to_be_reachable_is_reached(speed):
    rows, decisions = drive(0.035, 2.0, speed=speed)
    said = decisions[0]
    assert said.kind is Kind.CROSS
    assert rows[-1, 2] >= min(said.reachable_speed, said.required_speed)


@pytest.mark.parametrize('gains, rate, face, speed, noise', [
    ('published', 500, 1.2, 0.0, 0.0), ('published', 500, 2.0, 0.4, 0.01),
    ('published', 500, 2.0, 1.0, 0.0), ('gentle', 100, 1.2, 0.0, 0.0)])
def test_before_80_mm_it_comes_to_rest_and_stays(gains, rate, face, speed, noise):
    rows, decisions = drive(0.080, face, gains=gains, rate=rate, speed=speed, noise=noise)
    assert {item.kind for item in decisions} == {Kind.GO_ROUND}
    gap = face - rows[:, 1] - RADIUS
    assert gap.min() >= 0.1                       # never nearer than that
    assert gap[-1] <= TUNING.stop_gap + 0.1       # but it did come near
    late = rows[rows[:, 0] > 11.0]
    assert np.ptp(late[:, 1]) < 1e-3              # no creeping
    assert np.abs(late[:, 2]).max() < 1e-3        # at rest
    assert np.abs(late[:, 3]).max() < 1e-2        # pendulum down


def test_without_room_it_does_not_go_nearer():
    rows, decisions = drive(0.035, 0.6, seconds=8.0)
    assert {item.reason for item in decisions} == {Reason.NO_ROOM}
    assert np.abs(rows[:, 1]).max() < 1e-6
