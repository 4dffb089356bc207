# SPDX-License-Identifier: Apache-2.0
"""Encoder jumps are detected, and impacts on the robot are not mistaken for jumps."""
import math

from hypothesis import given, settings, strategies as st
import pytest

from ballbot_ros.errors import EstimateLostError
from ballbot_ros.estimation import EncoderReading, Fusion, ImuMounting, ImuReading
from ballbot_ros.estimation.encoder import Continuity
from ballbot_ros.physics import load_robot
from ballbot_ros.physics.simulation.scene import read_scene
from ballbot_ros.plant import Imu, Plant

GIMBALL = load_robot('gimball')
PERIOD = 0.002
TWO_TURNS = 2.0 * math.tau / 50.0  # of the motor, as a joint angle [rad]
IMU_POSITION = (0.05, -0.03)
# Name -> height of the step 2 m ahead [m], speed towards it [m/s].
HARD = {'wall': (0.3, 4.0), 'drop': (-1.0, 1.0), 'crossing': (0.031, 2.0), 'level': (0.0, 1.0)}


@pytest.fixture(scope='module', params=HARD)
def motion(request):
    """Return states, torques and IMU samples of a robot with impacts."""
    height, speed = HARD[request.param]
    terrain = [{'flat': {'length': 2.0}}, {'step': {'height': height}}, {'flat': {'length': 30.0}}]
    plant = Plant(read_scene(
        {'robot': 'gimball', 'initial': {'x': 0.5, 'velocity_x': speed}, 'duration': 3.0,
         'terrain': terrain if height else terrain[:1]}, 'test', 'test'), 1.0 / PERIOD)
    imu = Imu(9.81, IMU_POSITION, gyro_sd=0.005, force_sd=0.1, bias=0.01, seed=3)
    kept = []
    for number in range(800):
        torque, before = 1.2 * math.sin(1.2 * plant.time), plant.state
        state = plant.advance(torque)
        kept.append((state, torque, ImuReading(*imu.sample(before, state, number))))
    return kept


def followed(motion, imu=True, every=1, lag=0.0, late=lambda number: 0.0, jump=0.0, at=400,
             rates=True):
    """Return the fusion after a motion, and its estimated joint angles."""
    fusion, angles, rate = Fusion(GIMBALL, ImuMounting(*IMU_POSITION)), [], 0.0
    for number, (state, torque, sample) in enumerate(motion):
        rate += (state.joint_rate - rate) * min(1.0, PERIOD / lag if lag else 1.0)
        if imu:
            fusion.imu(sample)
        if number % every == 0:
            angle = state.joint_angle - late(number) * state.joint_rate \
                + (jump if number >= at else 0.0)
            estimate = fusion.encoder(EncoderReading(
                state.time, angle, torque, rate if rates else None))
            angles.append(estimate.readings.joint_angle)
    return fusion, angles


@pytest.mark.parametrize('imu', [True, False])
@pytest.mark.parametrize('every, lag', [(1, 0.0), (1, 0.005), (5, 0.005), (10, 0.0)])
def test_no_impact_is_detected_as_a_jump(motion, imu, every, lag):
    fusion, _ = followed(motion, imu, every, lag)
    assert (fusion.jumps, fusion.rezeroed) == (0, 0)


@pytest.mark.parametrize('imu', [True, False])
@pytest.mark.parametrize('rates', [True, False])
def test_no_reading_up_to_3_ms_old_is_detected_as_a_jump(motion, imu, rates):
    fusion, _ = followed(motion, imu, rates=rates,
                         late=lambda number: 0.003 * (number * 7 % 5) / 4.0)
    assert (fusion.jumps, fusion.rezeroed) == (0, 0)


@pytest.mark.parametrize('jump', [TWO_TURNS, -TWO_TURNS])
@pytest.mark.parametrize('imu, every', [(True, 1), (False, 1), (True, 5)])
def test_a_jump_of_two_motor_turns_is_detected_and_corrected(motion, imu, every, jump):
    _, right = followed(motion, imu, every)
    fusion, found = followed(motion, imu, every, jump=jump)
    assert fusion.rezeroed == 1
    assert fusion.last_jump == pytest.approx(jump, abs=0.03)
    # The angle is predicted until the encoder is used again.
    assert max(abs(one - other) for one, other in zip(found, right)) < 0.04


@pytest.mark.slow
@settings(max_examples=200, deadline=None)
@given(st.floats(-25.0, 25.0), st.floats(0.12, 3.0), st.sampled_from([-1.0, 1.0]))
def test_a_jump_of_more_than_an_eighth_of_a_radian_is_detected_at_any_rate(rate, jump, sign):
    kept = Continuity()
    for number in range(10):
        angle = rate * PERIOD * number
        kept = kept.after(EncoderReading(PERIOD * number, angle, rate=rate), 0.0, rate)
        assert kept.doubt is None
    for number in range(10, 20):
        assert kept.doubt is None or kept.doubt.jump is None
        angle = rate * PERIOD * number + sign * jump
        kept = kept.after(EncoderReading(PERIOD * number, angle, rate=rate), sign * jump, rate)
        assert (kept.doubt is None) is (jump <= 0.04 + 0.003 * abs(rate))
    assert kept.doubt is None or kept.doubt.jump == pytest.approx(sign * jump)


def test_a_velocity_caused_by_the_jump_does_not_explain_the_jump():
    # The estimator of an ODrive follows a jump within a millisecond or two.
    kept = Continuity().after(EncoderReading(0.0, 0.0, rate=0.0), 0.0, 0.0)
    kept = kept.after(EncoderReading(0.002, 0.25, rate=250.0), 0.25, 0.0)
    assert kept.doubt is not None


@pytest.mark.parametrize('angle, doubted', [
    (0.0, True), (-0.2, True), (-0.34, True), (-0.36, False), (0.14, True), (0.16, False),
    (0.35, False)])
def test_after_a_pause_a_possible_restart_of_the_encoder_at_0_is_doubted(angle, doubted):
    # Before the pause the angle was 0.5; the predicted change in the pause is -0.2.
    kept = Continuity().after(EncoderReading(0.0, 0.5, rate=-1.0), 0.0, -1.0)
    kept = kept.after(EncoderReading(0.2, angle, rate=-1.0), angle - 0.3, -1.0)
    assert (kept.doubt is not None) is (doubted or abs(angle - 0.3) > 0.5)


@pytest.mark.parametrize('rate', [1.0, 3.0, 5.0, 20.0])
@pytest.mark.parametrize('delay', [0.01, 0.016, 0.03])
def test_delayed_encoder_replies_are_not_detected_as_a_jump(rate, delay):
    # On a busy machine, all pending requests are answered with the present angle.
    kept, jumps = Continuity(), 0
    for number in range(60):
        stamp = PERIOD * number
        sampled = max(stamp, 0.04 + delay) if 0.04 <= stamp <= 0.04 + delay else stamp
        angle = rate * sampled
        kept = kept.after(EncoderReading(stamp, angle, rate=rate), angle - rate * stamp, rate)
        jumps += kept.doubt is not None and kept.doubt.jump is not None
    assert jumps == 0 and kept.doubt is None


def test_after_a_pause_a_late_reading_is_not_detected_as_a_jump():
    # A bus that loses frames: the reply answers an earlier request than the lost one.
    rate, late = 15.0, 0.05
    for latency in (late, 0.0):
        kept = Continuity().after(EncoderReading(0.0, 0.0, rate=rate), 0.0, rate)
        kept = kept.after(EncoderReading(0.06, rate * (0.06 + late), rate=rate, latency=latency),
                          rate * late, rate)
        assert (kept.doubt is None) is (latency == late)


@pytest.mark.parametrize('pause', [0.06, 0.1, 0.14])
def test_a_step_in_a_pause_is_a_motion_if_it_agrees_with_the_velocity(pause):
    # Commands were lost, too: the prediction is wrong.
    for jump in (0.0, 2.0):
        kept = Continuity().after(EncoderReading(0.0, 0.0, rate=4.0), 0.0, 4.0)
        kept = kept.after(EncoderReading(pause, 6.0 * pause + jump, rate=8.0), jump - 0.6, 17.0)
        assert (kept.doubt is None) is (jump == 0.0)


def test_a_pause_of_the_readings_does_not_end_a_doubt():
    kept = Continuity().after(EncoderReading(0.0, 0.0, rate=0.0), 0.0, 0.0)
    kept = kept.after(EncoderReading(0.002, 0.4, rate=0.0), 0.4, 0.0)
    assert kept.doubt is not None
    assert kept.after(EncoderReading(0.08, 0.45, rate=0.0), 0.45, 0.0).doubt is not None


def test_a_smooth_encoder_angle_corrects_a_wrong_filter():
    kept = Continuity().after(EncoderReading(0.0, 0.0, rate=5.0), 0.0, 5.0)
    for number in range(1, 30):
        reading = EncoderReading(PERIOD * number, 5.0 * PERIOD * number, rate=5.0)
        kept = kept.after(reading, 0.4, 5.0)
        assert kept.doubt is None


def test_a_single_wrong_reading_is_rejected_without_rezeroing():
    fusion, still = Fusion(GIMBALL), Fusion(GIMBALL)
    for number in range(20):
        angle = 0.3 if number == 10 else 0.0
        estimate = fusion.encoder(EncoderReading(PERIOD * number, angle, 0.0, 0.0))
        other = still.encoder(EncoderReading(PERIOD * number, 0.0, 0.0, 0.0))
        assert estimate.readings.joint_angle == pytest.approx(
            other.readings.joint_angle, abs=1e-6)
    assert (fusion.jumps, fusion.rezeroed) == (1, 0)


def test_an_inconsistent_encoder_is_relied_on_for_20_ms_and_fails_after_100_ms():
    fusion = Fusion(GIMBALL)
    fusion.encoder(EncoderReading(0.0, 0.0, 0.0, 0.0))
    relied_on = {}
    with pytest.raises(EstimateLostError) as raised:
        for number in range(1, 100):
            fusion.encoder(EncoderReading(PERIOD * number, 0.5 * (-1) ** number, 0.0, 0.0))
            relied_on[number] = fusion.is_relied_on()
    assert raised.value.reason == 'encoder_jumps'
    assert [number for number, good in relied_on.items() if good] == list(range(1, 12))
    assert max(relied_on) == 51
    assert fusion.estimate is None and not fusion.is_relied_on()


def test_three_encoder_jumps_in_5_s_end_the_estimate():
    fusion, angle = Fusion(GIMBALL), 0.0
    with pytest.raises(EstimateLostError) as raised:
        for number in range(2000):
            angle += TWO_TURNS if number % 500 == 100 else 0.0
            fusion.encoder(EncoderReading(PERIOD * number, angle, 0.0, 0.0))
    assert raised.value.reason == 'encoder_jumps'
    assert number == 1109 and fusion.rezeroed == 3
    for number in range(2000, 6000):  # one jump in 4 s is tolerated
        angle += TWO_TURNS if number % 2000 == 100 else 0.0
        fusion.encoder(EncoderReading(PERIOD * number, angle, 0.0, 0.0))
    assert fusion.rezeroed == 5
