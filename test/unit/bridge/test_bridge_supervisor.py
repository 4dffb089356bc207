# SPDX-License-Identifier: Apache-2.0
"""What the motor may do, and above all when it may do nothing."""
import math

from hypothesis import given, strategies
import pytest

from ballbot_ros.bridge.hardware_file import Limits
from ballbot_ros.bridge.supervisor import PendulumMotion as Motion, Supervisor
from ballbot_ros.errors import MessageError, RefusedError

PERIOD = 0.002
STILL = Motion(0.0, 0.0, 0.0)


def released(**limits):
    """Return a supervisor without e-stop, at time 0."""
    supervisor = Supervisor(Limits(**{'torque_limit': 4.0, **limits}), PERIOD)
    supervisor.reset(0.0)
    return supervisor


def follow(supervisor, torque, begin, seconds, motion=STILL):
    """Offer and decide each period; return the torque decided last."""
    decided = 0.0
    for number in range(round(seconds / PERIOD)):
        now = begin + number * PERIOD
        supervisor.offer(torque, now, now)
        decided = supervisor.decide(now, motion)
    return decided


def test_there_is_no_torque_before_the_first_command():
    assert released().decide(0.1, STILL) == 0.0


def test_a_fresh_command_is_followed():
    assert follow(released(), 1.5, 0.0, 0.1) == 1.5


def test_the_motor_is_at_zero_a_timeout_after_the_last_command_whenever_that_came():
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


def test_a_command_counts_from_the_state_that_it_answers():
    supervisor = released()
    supervisor.offer(1.0, 0.0, 0.09)
    assert supervisor.decide(0.095, STILL) > 0.0
    assert supervisor.decide(0.1, STILL) == 0.0


def test_after_a_timeout_the_next_command_is_followed_again():
    supervisor = released()
    follow(supervisor, 1.0, 0.0, 0.1)
    assert supervisor.decide(0.5, STILL) == 0.0 and supervisor.timed_out
    assert follow(supervisor, 1.0, 0.5, 0.1) == 1.0 and not supervisor.timed_out


@pytest.mark.parametrize('policy, motion, expected', [
    ('coast', Motion(0.5, 2.0, 3.0), 0.0), ('brake', Motion(0.5, 2.0, 3.0), -0.9),
    ('settle', Motion(0.5, 2.0, 3.0), -0.6)])
def test_what_follows_a_timeout_is_chosen_and_ends(policy, motion, expected):
    supervisor = released(on_timeout=policy, damping=0.3, damping_time=1.0,
                          torque_rate_limit=1e6)
    follow(supervisor, 1.0, 0.0, 0.1)
    supervisor.decide(0.3, motion)
    assert supervisor.decide(0.302, motion) == pytest.approx(expected)
    assert supervisor.decide(1.4, motion) == 0.0


def test_the_e_stop_is_engaged_at_start_and_says_so():
    supervisor = Supervisor(Limits(torque_limit=4.0), PERIOD)
    assert supervisor.e_stop == 'engaged at start'
    assert follow(supervisor, 1.0, 0.0, 0.1) == 0.0


def test_the_e_stop_is_not_reset_while_commands_push():
    supervisor = Supervisor(Limits(torque_limit=4.0), PERIOD)
    follow(supervisor, 1.0, 0.0, 0.1)
    with pytest.raises(RefusedError, match='commands other than zero are arriving'):
        supervisor.reset(0.2)
    assert supervisor.e_stop
    follow(supervisor, 0.0, 0.2, 0.5)
    supervisor.reset(0.7)
    assert not supervisor.e_stop


def test_commands_that_were_refused_push_too():
    supervisor = Supervisor(Limits(torque_limit=4.0), PERIOD)
    with pytest.raises(MessageError, match='older'):
        supervisor.offer(1.0, -5.0, 0.1)
    with pytest.raises(RefusedError):
        supervisor.reset(0.2)


def test_an_inhibit_keeps_the_e_stop_with_its_reason():
    supervisor = Supervisor(Limits(torque_limit=4.0), PERIOD)
    with pytest.raises(RefusedError, match='the line is down'):
        supervisor.reset(0.0, 'the line is down')


def test_the_first_reason_of_an_e_stop_stays():
    supervisor = released()
    supervisor.trigger('button')
    supervisor.trigger('line lost')
    assert supervisor.e_stop == 'button' and supervisor.counts['e_stops'] == 1


def test_a_command_from_before_an_e_stop_is_not_followed_after_it():
    supervisor = released()
    follow(supervisor, 1.0, 0.0, 0.05)
    supervisor.trigger('button')
    supervisor.reset(1.0)
    assert supervisor.decide(0.06, STILL) == 0.0


def test_torque_and_its_rate_are_limited_and_counted():
    supervisor = released(torque_limit=2.0, torque_rate_limit=100.0)
    supervisor.offer(9.0, 0.0, 0.0)
    assert supervisor.decide(0.0, STILL) == pytest.approx(0.2)
    assert supervisor.decide(PERIOD, STILL) == pytest.approx(0.4)
    assert follow(supervisor, 9.0, 2 * PERIOD, 0.1) == 2.0
    assert supervisor.counts['limited_torque'] and supervisor.counts['limited_rate']


@pytest.mark.parametrize('torque, passes', [(1.0, False), (-1.0, True)])
@pytest.mark.parametrize('motion, counter', [
    (Motion(1.7, 0.0, 0.0), 'limited_angle'), (Motion(0.0, 13.0, 13.0), 'limited_speed')])
def test_beyond_angle_and_speed_only_torque_back_is_let_through(motion, counter, torque, passes):
    supervisor = released()
    decided = follow(supervisor, torque, 0.0, 0.1, motion)
    assert decided == (torque if passes else 0.0)
    assert bool(supervisor.counts[counter]) is not passes


def test_a_runaway_engages_the_e_stop():
    supervisor = released()
    follow(supervisor, 1.0, 0.0, 0.01, Motion(0.0, 19.0, 19.0))
    assert not supervisor.e_stop  # one wrong reading is none
    assert follow(supervisor, 1.0, 0.01, 0.02, Motion(0.0, 19.0, 19.0)) == 0.0
    assert 'runaway' in supervisor.e_stop


def test_without_knowing_how_the_robot_moves_there_is_no_torque():
    assert follow(released(), 1.0, 0.0, 0.1, None) == 0.0


numbers = strategies.one_of(strategies.floats(), strategies.floats(-20.0, 20.0))


@given(strategies.lists(strategies.tuples(
    strategies.sampled_from(('offer', 'decide', 'trigger', 'reset')), numbers,
    strategies.floats(0.0, 0.2), strategies.floats(-2.0, 2.0), strategies.floats(-20.0, 20.0)),
    max_size=40), strategies.sampled_from(('coast', 'brake', 'settle')))
def test_whatever_comes_torque_is_finite_limited_and_only_after_a_fresh_command(events, policy):
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
            supervisor.trigger('test')
        elif what == 'reset':
            try:
                supervisor.reset(now)
            except RefusedError:
                pass
        torque = supervisor.decide(now, Motion(angle, rate, rate))
        assert math.isfinite(torque) and abs(torque) <= 4.0
        if supervisor.e_stop or (policy == 'coast' and now - fresh >= 0.1):
            assert torque == 0.0
