# SPDX-License-Identifier: Apache-2.0
"""Limits on the torque of the motor, and the conditions for zero torque."""
import math

from hypothesis import given, strategies
import pytest
from refusals import refused

from ballbot_ros.bridge.hardware_file import Limits
from ballbot_ros.bridge.supervisor import (
    EStop, PendulumMotion as Motion, StopReason, Supervisor)
from ballbot_ros.errors import MessageError, RefusedError

PERIOD = 0.002
STILL = Motion(0.0, 0.0, 0.0)
BUTTON = EStop(StopReason.REQUESTED, 'button')


def released(**limits):
    """Return a supervisor without e-stop, at time 0."""
    supervisor = Supervisor(Limits(**{'torque_limit': 4.0, **limits}), PERIOD)
    supervisor.reset(0.0)
    return supervisor


def follow(supervisor, torque, start, seconds, motion=STILL):
    """Offer a torque and decide in each period; return the last decision."""
    decided = 0.0
    for number in range(round(seconds / PERIOD)):
        now = start + number * PERIOD
        supervisor.offer(torque, now, now)
        decided = supervisor.decide(now, motion)
    return decided


def test_there_is_no_torque_before_the_first_command():
    assert released().decide(0.1, STILL) == 0.0


def test_the_torque_is_zero_one_timeout_after_the_last_command_at_any_phase():
    for late in (0.0, 0.0005, 0.0019):
        supervisor = released()
        follow(supervisor, 1.0, 0.0, 0.1)
        last = 0.1 + late
        supervisor.offer(1.0, last, last)
        ticks = [last + PERIOD - late + number * PERIOD for number in range(60)]
        decided = [(now, supervisor.decide(now, STILL)) for now in ticks]
        assert all(torque == 0.0 for now, torque in decided if now >= last + 0.1)
        assert any(torque == 1.0 for now, torque in decided if now > last + 0.05)
        assert supervisor.counts['timeouts'] == 1


def test_the_age_of_a_command_counts_from_the_state_that_it_answers():
    supervisor = released()
    supervisor.offer(1.0, 0.0, 0.09)
    assert supervisor.decide(0.095, STILL) > 0.0
    assert supervisor.decide(0.1, STILL) == 0.0


def test_after_a_timeout_the_next_command_is_followed_again():
    supervisor = released()
    follow(supervisor, 1.0, 0.0, 0.1)
    assert supervisor.decide(0.5, STILL) == 0.0 and supervisor.timed_out
    assert follow(supervisor, 1.0, 0.5, 0.1) == 1.0 and not supervisor.timed_out


@pytest.mark.parametrize('policy, expected', [('coast', 0.0), ('brake', -0.9), ('settle', -0.6)])
def test_the_timeout_policy_is_applied_for_its_configured_time(policy, expected):
    supervisor = released(on_timeout=policy, damping=0.3, damping_time=1.0,
                          torque_rate_limit=1e6)
    follow(supervisor, 1.0, 0.0, 0.1)
    for now, torque in ((0.5, expected), (1.5, expected), (1.5001, 0.0)):
        assert supervisor.decide(now, Motion(0.5, 2.0, 3.0)) == pytest.approx(torque)
    assert supervisor.counts['timeouts'] == 1


def test_the_e_stop_is_engaged_at_start_with_that_reason():
    supervisor = Supervisor(Limits(torque_limit=4.0), PERIOD)
    assert supervisor.e_stop.reason is StopReason.START
    assert follow(supervisor, 1.0, 0.0, 0.1) == 0.0


def test_refused_commands_also_inhibit_the_release():
    supervisor = Supervisor(Limits(torque_limit=4.0), PERIOD)
    with refused('stale'):
        supervisor.offer(1.0, -5.0, 0.1)
    with pytest.raises(RefusedError):
        supervisor.reset(0.2)


def test_an_inhibit_keeps_the_e_stop_with_its_reason():
    supervisor = Supervisor(Limits(torque_limit=4.0), PERIOD)
    with refused('standing', 'drive', RefusedError):
        supervisor.reset(0.0, 'the line is down', 'drive')


def test_a_command_from_before_an_e_stop_is_not_followed_after_it():
    supervisor = released()
    follow(supervisor, 1.0, 0.0, 0.05)
    supervisor.trigger(BUTTON)
    supervisor.reset(1.0)
    assert supervisor.decide(0.06, STILL) == 0.0


def test_torque_and_its_rate_are_limited_and_counted():
    supervisor = released(torque_limit=2.0, torque_rate_limit=100.0)
    supervisor.offer(9.0, 0.0, 0.0)
    assert supervisor.decide(0.0, STILL) == pytest.approx(0.2)
    assert supervisor.decide(PERIOD, STILL) == pytest.approx(0.4)
    assert follow(supervisor, 9.0, 2 * PERIOD, 0.1) == 2.0
    assert supervisor.counts['limited_torque'] and supervisor.counts['limited_rate']


@pytest.mark.parametrize('motion', [Motion(1.7, 2.0, 2.0), Motion(0.0, 13.0, 13.0)])
def test_beyond_a_limit_the_rate_limit_does_not_prolong_outward_torque(motion):
    supervisor = released(torque_rate_limit=50.0)
    assert follow(supervisor, 3.0, 0.0, 0.1) == pytest.approx(3.0)
    supervisor.offer(-3.0, 0.102, 0.102)
    assert -0.5 <= supervisor.decide(0.102, motion) < 0.0


def test_the_first_reason_for_the_e_stop_is_kept_and_counted_once():
    supervisor = released()
    follow(supervisor, 1.0, 0.0, 0.1)
    supervisor.trigger(BUTTON)
    supervisor.trigger(EStop(StopReason.LOST, 'line lost'))
    assert supervisor.e_stop is BUTTON and supervisor.counts['e_stops'] == 1
    assert supervisor.torque == 0.0 and not supervisor.commanded
    started = Supervisor(Limits(torque_limit=4.0), PERIOD)
    started.trigger(BUTTON)
    assert started.e_stop.reason is StopReason.START and not started.counts


def test_the_release_needs_half_a_second_of_zero_commands_within_a_tolerance():
    supervisor = Supervisor(Limits(torque_limit=4.0), PERIOD)
    supervisor.offer(2e-6, 0.0, 0.0)
    supervisor.offer(-1e-6, 0.25, 0.25)
    with refused('refused', 'set_point', RefusedError):
        supervisor.reset(0.499)
    assert supervisor.e_stop
    supervisor.reset(0.5)
    assert not supervisor.e_stop


def test_negative_commands_inhibit_the_release_and_non_finite_ones_do_not():
    supervisor = Supervisor(Limits(torque_limit=4.0), PERIOD)
    with pytest.raises(MessageError):
        supervisor.offer(math.inf, 1.0, 1.0)
    supervisor.reset(1.0)
    supervisor.offer(-1.0, 1.0, 1.0)
    with pytest.raises(RefusedError):
        supervisor.reset(1.1)


def test_a_command_is_active_from_its_arrival_to_its_timeout():
    supervisor = released()
    assert not supervisor.commanded
    supervisor.offer(0.0, 0.0, 0.0)
    supervisor.decide(0.0, STILL)
    assert supervisor.commanded and not supervisor.timed_out
    supervisor.decide(0.2, STILL)
    assert not supervisor.commanded and supervisor.timed_out
    supervisor.quiet()
    assert not supervisor.commanded and not supervisor.timed_out


def test_a_loop_slower_than_the_timeout_accepts_commands_up_to_half_a_period_old():
    supervisor = Supervisor(Limits(torque_limit=4.0, command_timeout=0.01), 0.02)
    supervisor.offer(1.0, 0.0, 0.0099)
    with refused('stale'):
        supervisor.offer(1.0, 0.0, 0.0101)


@pytest.mark.parametrize('policy', ['coast', 'brake', 'settle'])
def test_there_is_no_torque_if_the_motion_is_unknown_even_after_a_timeout(policy):
    supervisor = released(on_timeout=policy)
    assert follow(supervisor, 1.0, 0.0, 0.1, None) == 0.0
    follow(supervisor, 1.0, 0.1, 0.1)
    assert supervisor.decide(0.4, None) == 0.0 and supervisor.timed_out


def test_the_torque_starts_from_zero_after_a_stop_of_any_duration():
    supervisor = released(torque_rate_limit=100.0)
    follow(supervisor, 1.0, 0.0, 0.1)
    supervisor.quiet()
    assert supervisor.torque == 0.0
    supervisor.offer(1.0, 0.2, 0.2)
    assert supervisor.decide(0.2, STILL) == pytest.approx(100.0 * PERIOD)


def test_after_any_pause_the_torque_changes_by_at_most_one_timeout_at_the_rate_limit():
    supervisor = released(torque_rate_limit=10.0, command_timeout=0.1)
    supervisor.offer(0.02, 0.0, 0.0)
    assert supervisor.decide(0.0, STILL) == pytest.approx(0.02)
    supervisor.offer(4.0, 5.0, 5.0)
    assert supervisor.decide(5.0, STILL) == pytest.approx(1.02)
    assert supervisor.decide(4.95, STILL) == pytest.approx(1.02)  # no change if time goes back


def test_the_rate_limit_applies_to_a_reversal_of_torque_but_not_to_a_cut_to_zero():
    supervisor = released(torque_rate_limit=100.0)
    follow(supervisor, 1.0, 0.0, 0.1)
    supervisor.offer(-1.0, 0.1, 0.1)
    assert supervisor.decide(0.1, STILL) == pytest.approx(0.8)
    supervisor.offer(0.0, 0.102, 0.102)
    assert supervisor.decide(0.102, STILL) == 0.0


EXACTLY = Motion(1.6, 0.0, 12.0)


def test_at_the_limits_of_angle_and_speed_torque_passes_and_beyond_each_cut_is_counted():
    supervisor = released()
    supervisor.offer(0.1, 0.0, 0.0)
    assert supervisor.decide(0.0, EXACTLY) == pytest.approx(0.1)
    assert not supervisor.counts
    for number in (1, 2):
        assert supervisor.decide(0.0, Motion(1.7, 0.0, 0.0)) == 0.0
        assert supervisor.counts['limited_angle'] == number
        assert supervisor.decide(0.0, Motion(-1.7, 0.0, 12.1)) == 0.0
        assert supervisor.counts['limited_speed'] == number
    assert supervisor.decide(0.002, Motion(-1.7, 0.0, -12.1)) == pytest.approx(0.1)


@pytest.mark.parametrize('motion', [Motion(1.7, 0.0, 0.0), Motion(0.0, 0.0, 12.1)])
def test_beyond_a_limit_the_smallest_inward_torque_passes_and_zero_torque_is_not_a_cut(motion):
    supervisor = released(torque_rate_limit=1e6)
    for now, torque in ((0.0, 0.0), (0.002, -0.01)):
        supervisor.offer(torque, now, now)
        assert supervisor.decide(now, motion) == torque
    assert not supervisor.counts


def test_each_cut_to_the_torque_limit_is_counted_and_the_limit_itself_is_not_a_cut():
    supervisor = released(torque_rate_limit=1e6)
    for number, torque in enumerate((-9.0, -4.0, 4.0, 9.0)):
        supervisor.offer(torque, 0.001 * number, 0.001 * number)
        assert supervisor.decide(0.001 * number, STILL) == math.copysign(4.0, torque)
    assert supervisor.counts == {'limited_torque': 2}


@pytest.mark.parametrize('direction', [1.0, -1.0])
def test_a_runaway_exceeds_one_and_a_half_speed_limits_for_two_hundredths_of_a_second(direction):
    supervisor = released()
    fast, slower = (Motion(0.0, 0.0, direction * rate) for rate in (18.01, 18.0))
    supervisor.offer(1.0, 0.0, 0.0)
    for now, motion in ((0.0, fast), (0.019, fast), (0.0195, slower), (0.02, fast),
                        (0.0399, fast)):
        supervisor.decide(now, motion)
        assert not supervisor.e_stop
    assert supervisor.decide(0.04, fast) == 0.0
    assert supervisor.e_stop.reason is StopReason.RUNAWAY and supervisor.torque == 0.0


numbers = strategies.one_of(strategies.floats(), strategies.floats(-20.0, 20.0))


@given(strategies.lists(strategies.tuples(
    strategies.sampled_from(('offer', 'decide', 'trigger', 'reset')), numbers,
    strategies.floats(0.0, 0.2), strategies.floats(-2.0, 2.0), strategies.floats(-20.0, 20.0)),
    max_size=40), strategies.sampled_from(('coast', 'brake', 'settle')))
def test_torque_is_finite_and_limited_and_requires_a_fresh_command(events, policy):
    supervisor = Supervisor(Limits(torque_limit=4.0, on_timeout=policy), PERIOD)
    now, fresh = 0.0, -math.inf
    for what, number, pause, angle, rate in events:
        now += pause
        if what == 'offer':
            try:
                supervisor.offer(number, now, now)
                fresh = now
            except MessageError:
                pass
        elif what == 'trigger':
            supervisor.trigger(BUTTON)
        elif what == 'reset':
            try:
                supervisor.reset(now)
            except RefusedError:
                pass
        torque = supervisor.decide(now, Motion(angle, rate, rate))
        assert math.isfinite(torque) and abs(torque) <= 4.0
        if supervisor.e_stop or (policy == 'coast' and now - fresh >= 0.1):
            assert torque == 0.0
