# SPDX-License-Identifier: Apache-2.0
"""The sampled loop: known limits, refusals, and the divergence of refused loops."""
from dataclasses import replace
import math

import numpy as np
import pytest
from refusals import refused
from scipy.linalg import expm
from tiers import slow

from ballbot_ros.control import (
    check_loop, ControlTuning, growth_rate, is_stable, JointReadings, load_tuning, loop_poles,
    lowest_stable_rate, PendulumController, RollingModel, SetPoint)
from ballbot_ros.control.rolling_model import rolling_accelerations
from ballbot_ros.control.sampled import HeldInput
from ballbot_ros.errors import UnstableLoopError
from ballbot_ros.physics import Model, Solver, State, Terrain
from ballbot_ros.physics.model.actuation import Actuator, TORQUE
from ballbot_ros.physics.model.robot import load_robot

GIMBALL = load_robot('gimball')
PUBLISHED = load_tuning('published')
DOWN = (0.0,)


@pytest.mark.parametrize('law, expected', [
    ('hold', [-470.3, -3.984, -0.02698]),
    ('drive', [-464.9, -0.00906 - 1.962j, -0.00906 + 1.962j])])
def test_the_poles_converge_to_those_in_continuous_time(law, expected):
    rate = 1e5
    poles = np.log(loop_poles(GIMBALL, PUBLISHED, law, rate)) * rate
    # Sampling at 100 kHz still shifts the fast pole by 470^2 / 2e5, about 0.25 %.
    assert np.sort_complex(poles) == pytest.approx(np.sort_complex(expected), rel=4e-3)


@pytest.mark.parametrize('law, delay, expected', [
    ('hold', 0, 234.0), ('hold', 1, 467.0), ('drive', 0, 229.0), ('drive', 1, 455.0)])
def test_the_published_gains_have_the_known_lowest_rates(law, delay, expected):
    assert lowest_stable_rate(
        GIMBALL, PUBLISHED, law, delay, DOWN) == pytest.approx(expected, rel=5e-3)


def test_holding_the_pendulum_upright_requires_the_highest_rate():
    down = lowest_stable_rate(GIMBALL, PUBLISHED, 'hold', 1, DOWN)
    worst = lowest_stable_rate(GIMBALL, PUBLISHED, 'hold', 1)
    assert worst == pytest.approx(548.0, rel=2e-3)
    assert worst == lowest_stable_rate(GIMBALL, PUBLISHED, 'hold', 1, (math.pi,)) > down


@pytest.mark.parametrize('law', ['hold', 'drive'])
def test_published_gains_are_refused_at_100_hz_with_remedies(law):
    with pytest.raises(UnstableLoopError) as caught:
        check_loop(GIMBALL, PUBLISHED, law, 100.0, 1)
    text = str(caught.value)
    number = {'hold': ('(11)', 'position_kd 10', '548 Hz'),
              'drive': ('(12)', 'velocity_kp 10', '457 Hz')}[law]
    for part in (*number, '100 Hz', '1 sample of delay', 'gimball', 'lower'):
        assert part in text


@pytest.mark.parametrize('law, name, rate', [
    ('hold', 'position_kd', 440.0), ('hold', 'position_kd', 100.0),
    ('drive', 'velocity_kp', 450.0), ('drive', 'velocity_kp', 100.0),
    ('drive', 'velocity_kp', 6.0)])
def test_the_suggested_gain_is_the_highest_that_is_stable_at_90_percent_of_the_rate(
        law, name, rate):
    def has_margin(percent):
        gain = percent / 100.0 * getattr(PUBLISHED, name)
        return is_stable(GIMBALL, replace(PUBLISHED, **{name: gain}), law, 0.9 * rate, 1)

    with pytest.raises(UnstableLoopError) as caught:
        check_loop(GIMBALL, PUBLISHED, law, rate, 1)
    offered = float(str(caught.value).split(f'lower {name} to ')[1])
    percent = round(100.0 * offered / getattr(PUBLISHED, name))
    assert offered == pytest.approx(percent / 100.0 * getattr(PUBLISHED, name))
    assert has_margin(percent) and not any(has_margin(more) for more in range(percent + 1, 96))
    check_loop(GIMBALL, replace(PUBLISHED, **{name: offered}), law, rate, 1)


def test_no_gain_is_suggested_if_none_is_stable():
    with pytest.raises(UnstableLoopError) as caught:
        check_loop(GIMBALL, PUBLISHED, 'drive', 2.5, 1)
    assert '457 Hz' in str(caught.value) and 'lower' not in str(caught.value)


@pytest.mark.parametrize('mass', [1.25, 1.6, 2.1])
@pytest.mark.parametrize('law, tuning, rate, delay', [
    ('hold', 'gentle', 100.0, 1), ('drive', 'gentle', 100.0, 1), ('speed', 'gentle', 100.0, 1),
    ('speed', 'published', 500.0, 0)])
def test_the_gains_are_stable_over_the_range_of_the_robot(mass, law, tuning, rate, delay):
    robot = replace(GIMBALL, pendulum_mass=mass, ball_mass=5.4 - mass)
    check_loop(robot, load_tuning(tuning), law, rate, delay)


def test_the_gentle_gains_are_stable_with_two_more_samples_of_delay():
    assert is_stable(GIMBALL, load_tuning('gentle'), 'hold', 100.0, 3)
    assert is_stable(GIMBALL, load_tuning('gentle'), 'drive', 100.0, 3)


def test_gains_that_are_unstable_at_any_rate_are_refused():
    # The stiffness is below that of gravity at a raised pendulum, which falls at any rate.
    tuning = ControlTuning(position_kp=0.5, position_kd=1.0, gravity_compensation=False)
    assert lowest_stable_rate(GIMBALL, tuning, 'hold') == math.inf
    with refused('unstable', error=UnstableLoopError):
        check_loop(GIMBALL, tuning, 'hold', 1000.0, 0)


@pytest.mark.parametrize('law', ['hold', 'drive'])
@pytest.mark.parametrize('delay', [1, 2, 3, 0.3, 0.7, 1.4, 2.9])
@pytest.mark.parametrize('velocity_ki', [0.0, 5.0])
def test_the_poles_agree_with_an_explicitly_stepped_loop(law, delay, velocity_ki):
    rate, parts, angle = 300.0, 10, 0.7
    tuning = ControlTuning(position_kp=6.0, position_kd=0.8, velocity_kp=0.8,
                           velocity_ki=velocity_ki)
    matrix, column = RollingModel(GIMBALL).about_held(angle)
    flow = np.zeros((5, 5))  # phi, phi', theta1', theta2, torque
    flow[:3, :3], flow[:3, 4], flow[3, 1:3] = matrix, column, (1.0, -1.0)
    fine = expm(flow / rate / parts)
    gravity = GIMBALL.largest_gravity_torque * math.cos(angle)
    gains = {'hold': [gravity - 6.0, -0.8, 0.0, 0.0],
             'drive': [gravity, -0.8, 0.8, -velocity_ki]}[law]
    stored = math.ceil(delay)
    switch = round(parts * (delay - stored + 1))  # number of parts with the older torque

    def stepped(start):
        """Return the state and the delayed torques one sample later."""
        state, torques = start[:4], [*start[4:], np.dot(gains, start[:4])]
        for number in range(parts):
            torque = torques[number >= switch]
            state = fine[:4, :4] @ state + fine[:4, 4] * torque
        return np.concatenate([state, torques[1:]])

    loop = np.array([stepped(unit) for unit in np.eye(4 + stored)]).T
    expected = np.linalg.eigvals(loop)
    if law == 'hold' or not velocity_ki:  # loop_poles omits the joint angle
        expected = np.delete(expected, np.abs(expected - 1.0).argmin())
    found = loop_poles(GIMBALL, tuning, law, rate, delay, angle)
    assert np.sort(np.abs(found)) == pytest.approx(np.sort(np.abs(expected)), abs=1e-6)


@pytest.mark.parametrize('delay', [0.3, 0.7, 1.4, 2.9])
def test_the_growth_of_the_speed_law_lies_between_those_of_integer_delays(delay):
    # The speed law is linearised by finite differences.
    tuning = ControlTuning(position_kp=6.0, position_kd=0.8, velocity_kp=0.8, velocity_ki=2.0)
    near = [np.abs(loop_poles(GIMBALL, tuning, 'speed', 300.0, one, 0.4)).max()
            for one in (math.floor(delay), delay, math.ceil(delay))]
    assert min(near[0], near[2]) - 1e-9 <= near[1] <= max(near[0], near[2]) + 1e-9


def test_the_growth_rate_is_that_of_the_largest_pole_over_all_angles():
    found = growth_rate(GIMBALL, PUBLISHED, 'hold', 500.0, 1, (0.0, 3.0))
    worst = max(np.abs(loop_poles(GIMBALL, PUBLISHED, 'hold', 500.0, 1, angle)).max()
                for angle in (0.0, 3.0))
    assert found == pytest.approx(500.0 * math.log(worst)) and found > 0.0


@pytest.mark.parametrize('growth, stable', [(0.19, True), (0.21, False)])
def test_slow_drift_is_stable_and_faster_growth_is_not(growth, stable):
    # A raised pendulum falls slowly if the gain is slightly too low for its weight.
    def held_with(gain):
        return replace(tuning, position_kp=gain), 'hold', 1000.0, 0, (math.pi,)

    tuning = ControlTuning(position_kd=1.0, gravity_compensation=False)
    falls, stands = 0.5, 10.0
    for _ in range(40):
        gain = 0.5 * (falls + stands)
        weak = growth_rate(GIMBALL, *held_with(gain)) > growth
        falls, stands = (gain, stands) if weak else (falls, gain)
    assert growth_rate(GIMBALL, *held_with(gain)) == pytest.approx(growth)
    assert is_stable(GIMBALL, *held_with(gain)) == stable


def test_the_default_delay_is_zero_but_one_sample_for_check_loop():
    assert growth_rate(GIMBALL, PUBLISHED, 'drive', 300.0) == growth_rate(
        GIMBALL, PUBLISHED, 'drive', 300.0, 0)
    assert is_stable(GIMBALL, PUBLISHED, 'drive', 300.0)
    assert not is_stable(GIMBALL, PUBLISHED, 'drive', 300.0, 1)
    assert lowest_stable_rate(GIMBALL, PUBLISHED, 'drive') < 230.0
    assert len(loop_poles(GIMBALL, PUBLISHED, 'hold', 500.0)) == 3
    with refused('unstable', error=UnstableLoopError):
        check_loop(GIMBALL, PUBLISHED, 'drive', 300.0)
    check_loop(GIMBALL, PUBLISHED, 'drive', 300.0, 0)


def test_a_loop_without_torque_is_stable_at_any_rate():
    idle = ControlTuning(position_kp=0.0, position_kd=0.0, gravity_compensation=False)
    assert lowest_stable_rate(GIMBALL, idle, 'hold', 0, DOWN) == 1.0


def test_the_lowest_rate_is_found_to_one_in_ten_thousand():
    lowest = lowest_stable_rate(GIMBALL, PUBLISHED, 'hold', 1, DOWN)
    assert is_stable(GIMBALL, PUBLISHED, 'hold', lowest, 1, DOWN)
    assert not is_stable(GIMBALL, PUBLISHED, 'hold', lowest / 1.0001, 1, DOWN)


def test_the_integral_adds_a_state_but_no_neutral_pole():
    tuning = ControlTuning(velocity_kp=1.0, velocity_ki=5.0)
    poles = loop_poles(GIMBALL, tuning, 'drive', 1000.0)
    assert len(poles) == 4 and np.abs(poles).max() < 1.0 - 1e-6


@pytest.mark.parametrize('law, rate, delay, reason, field', [
    ('hold', 0.0, 1, 'out_of_range', 'rate'), ('hold', math.nan, 1, 'out_of_range', 'rate'),
    ('drive', 100.0, -1, 'out_of_range', 'delay'), ('idle', 100.0, 1, 'not_a_choice', 'law'),
    ('fast', 100.0, 1, 'not_a_choice', 'law'), ('hold', 100.0, -0.5, 'out_of_range', 'delay'),
    ('hold', 100.0, math.nan, 'out_of_range', 'delay'),
    ('hold', 100.0, 100.5, 'out_of_range', 'delay')])
def test_invalid_loop_parameters_are_refused(law, rate, delay, reason, field):
    with refused(reason, field):
        check_loop(GIMBALL, PUBLISHED, law, rate, delay)


def roll(tuning, set_point, rate, delay, *, seconds=1.0, substeps=20):
    """Return the pendulum angles of the exact rolling model under the sampled controller."""
    controller, model = PendulumController(GIMBALL, tuning), RollingModel(GIMBALL)
    controller.give(set_point)
    state = np.array([0.01, 0.0, 0.0, 0.0])   # phi, phi', theta1, theta1'
    waiting, switch = [0.0] * math.ceil(delay), round(substeps * (delay % 1.0))
    step = 1.0 / rate / substeps
    angles = []

    def slope(now, torque):
        pendulum, ball = rolling_accelerations(
            now[0], now[1], now[3], torque, model.numbers)
        return np.array([now[1], pendulum, now[3], ball])

    for index in range(int(seconds * rate)):
        waiting.append(controller.torque(JointReadings(
            index / rate, state[2], state[0] - state[2], state[3], state[1] - state[3])))
        torque = waiting.pop(0)
        for number in range(substeps):
            if number == switch > 0:  # within the period
                torque = waiting[0]
            k1 = slope(state, torque)
            k2 = slope(state + step / 2 * k1, torque)
            k3 = slope(state + step / 2 * k2, torque)
            k4 = slope(state + step * k3, torque)
            state = state + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            if abs(state[0]) > 2.0:   # diverged
                return np.array(angles + [state[0]])
        angles.append(state[0])
    return np.array(angles)


def test_an_integrator_with_a_fractional_delay_is_stable_up_to_the_known_gain():
    # z^2 - z + g (1 - m) z + g m: stable for g m < 1 and g (1 - 2 m) < 2.
    for part, gain in ((0.1, 2.5), (0.25, 4.0), (1.0 / 3.0, 3.0), (0.5, 2.0), (0.9, 1.0 / 0.9)):
        for share, stable in ((0.999, True), (1.001, False)):
            loop = HeldInput.of(np.zeros((1, 1)), np.ones(1), 1.0, part).closed(
                np.array([-share * gain]))
            assert (np.abs(np.linalg.eigvals(loop)).max() < 1.0) == stable


def test_the_poles_are_continuous_at_integer_delays():
    for whole in (1, 2):
        for near in (whole - 1e-7, whole + 1e-7):
            found = np.abs(loop_poles(GIMBALL, PUBLISHED, 'hold', 400.0, near)).max()
            exact = np.abs(loop_poles(GIMBALL, PUBLISHED, 'hold', 400.0, whole)).max()
            assert found == pytest.approx(exact, rel=1e-5)


def test_a_lag_is_a_delay_in_seconds():
    assert growth_rate(GIMBALL, PUBLISHED, 'hold', 400.0, 0, DOWN, 0.001) == growth_rate(
        GIMBALL, PUBLISHED, 'hold', 400.0, 0.4, DOWN)
    lowest = lowest_stable_rate(GIMBALL, PUBLISHED, 'hold', 0, (math.pi,), 0.001)
    assert lowest == pytest.approx(178.0, rel=5e-3)
    # A short lag stabilises a slowly sampled loop; with 4 ms no rate is stable.
    assert lowest < lowest_stable_rate(GIMBALL, PUBLISHED, 'hold', 0, (math.pi,))
    assert lowest_stable_rate(GIMBALL, PUBLISHED, 'hold', 0, DOWN, 0.004) == math.inf
    with refused('unstable', error=UnstableLoopError):
        check_loop(GIMBALL, PUBLISHED, 'drive', 300.0, 0, 0.004)


@pytest.mark.parametrize('law, delay, refused, accepted', [
    ('hold', 0, 225.0, 245.0), ('hold', 0.5, 224.0, 245.0),
    *slow(('hold', 1, 450.0, 490.0), ('hold', 1.25, 478.0, 515.0), ('speed', 0.5, 224.0, 245.0))])
def test_refused_loops_diverge_and_accepted_loops_do_not(law, delay, refused, accepted):
    # Unlimited torque: with a limit, the growth would end in a limit cycle.
    tuning, resting = replace(PUBLISHED, torque_limit=1e6), SetPoint(law, 0.0)
    assert not is_stable(GIMBALL, tuning, law, refused, delay, DOWN)
    assert is_stable(GIMBALL, tuning, law, accepted, delay, DOWN)
    assert np.abs(roll(tuning, resting, refused, delay, seconds=3.0)).max() > 2.0
    calm = np.abs(roll(tuning, resting, accepted, delay, seconds=2.0))
    assert calm.max() < 0.05 and calm[-20:].max() < 1e-3


@pytest.mark.slow
def test_the_torque_limit_turns_divergence_into_a_limit_cycle():
    angles = roll(PUBLISHED, SetPoint('hold', 0.0), 100.0, 1, seconds=3.0, substeps=50)
    cycle = angles[-100:]
    assert np.abs(cycle).max() < 1.5         # bounded ...
    assert cycle.max() - cycle.min() > 0.02  # ... but not at rest


@pytest.mark.parametrize('tuning, delay, rate', [
    ('published', 0, 233.0), ('gentle', 1, 43.1),
    *slow(('published', 1, 467.0), ('gentle', 0, 20.7))])
def test_the_speed_law_is_stable_at_a_lower_rate_than_the_hold_law(tuning, delay, rate):
    tuning = load_tuning(tuning)
    assert lowest_stable_rate(GIMBALL, tuning, 'speed', delay) == pytest.approx(rate, rel=5e-3)
    assert lowest_stable_rate(GIMBALL, tuning, 'hold', delay) > rate


@pytest.mark.parametrize('delay, refused, accepted', [
    (0, 225.0, 245.0), *slow((1, 450.0, 490.0))])
def test_a_refused_speed_law_diverges_at_the_growth_rate_of_its_poles(
        delay, refused, accepted):
    tuning, standing = replace(PUBLISHED, torque_limit=1e6), SetPoint('speed', 0.0)
    assert is_stable(GIMBALL, tuning, 'speed', accepted, delay)
    assert np.abs(roll(tuning, standing, accepted, delay, seconds=2.0))[-20:].max() < 1e-3
    growth = growth_rate(GIMBALL, tuning, 'speed', refused, delay)
    # The envelope of the oscillation, while it is small enough to be linear.
    rattle, window = np.abs(np.diff(roll(tuning, standing, refused, delay, seconds=3.0), 2)), 10
    tops = np.array([rattle[index:index + window].max()
                     for index in range(0, len(rattle) - window, window)])
    tops = tops[tops.argmin():]
    tops = np.log(tops[(tops > 1e-4) & (tops < 0.01)])
    assert len(tops) > 5 and growth > 1.0
    measured = np.polyfit(np.arange(len(tops)) * window / refused, tops, 1)[0]
    assert measured == pytest.approx(growth, rel=0.05)


def test_an_unstable_speed_law_is_refused_with_its_gains_and_a_remedy():
    hasty = replace(load_tuning('gentle'), speed_gain=20.0)
    with pytest.raises(UnstableLoopError) as caught:
        check_loop(GIMBALL, hasty, 'speed', 100.0, 1)
    text = str(caught.value)
    for part in ('the speed law', 'speed_gain 20', 'observer_rate 6', '100 Hz'):
        assert part in text
    offered = float(text.split('lower speed_gain to ')[1])
    check_loop(GIMBALL, replace(hasty, speed_gain=offered), 'speed', 100.0, 1)


def test_the_drive_law_diverges_if_it_is_refused():
    tuning = replace(PUBLISHED, torque_limit=1e6)
    assert np.abs(roll(tuning, SetPoint('drive', 1.0), 430.0, 1)).max() > 1.0
    assert np.abs(roll(tuning, SetPoint('drive', 1.0), 480.0, 1)).max() < 1.0


def joint_pole(robot, rate):
    """Return the pole of the joint rate under (12), for a frictionless ball in flight."""
    arm = robot.pendulum_mass * robot.pendulum_length
    swing = robot.pendulum_inertia + arm * robot.pendulum_length - arm**2 / robot.total_mass
    return 1.0 - PUBLISHED.velocity_kp * (1.0 / swing + 1.0 / robot.ball_inertia) / rate


@pytest.mark.parametrize('rate', [200.0, 300.0, 1000.0])
def test_in_flight_the_joint_pole_depends_only_on_the_two_inertias(rate):
    loose = replace(GIMBALL, joint_friction=0.0, rolling_friction=0.0, gravity=0.0)
    for angle in (0.0, 1.0, 2.5):
        poles = loop_poles(loose, PUBLISHED, 'drive', rate, 0, angle, rolls=False)
        # The angle and the common rate are neutral: their poles are 1.
        assert np.abs(poles - joint_pole(loose, rate)).min() < 1e-9
        assert np.sort(np.abs(poles - 1.0))[1] < 1e-6
    # The pole in flight is faster than any pole while rolling.
    assert -joint_pole(loose, rate) > max(
        -loop_poles(loose, PUBLISHED, 'drive', rate, 0, angle).real.min()
        for angle in np.linspace(0.0, math.pi, 19))


@pytest.mark.parametrize('rate, grows', [(300.0, True), (335.0, False)])
def test_a_loop_that_is_stable_while_rolling_may_diverge_in_flight(rate, grows):
    assert growth_rate(GIMBALL, PUBLISHED, 'drive', rate) < 0.0
    predicted = growth_rate(GIMBALL, PUBLISHED, 'drive', rate, rolls=False)
    assert (predicted > 10.0) == grows
    model = Model(GIMBALL, Terrain.flat(), solver=Solver('adaptive', 1.0 / rate))
    state, errors = State(y=10.0, pendulum_rate=1e-3), []
    for _ in range(20):
        errors.append(abs(state.joint_rate))
        torque = (GIMBALL.largest_gravity_torque * math.sin(state.pendulum_angle)
                  - PUBLISHED.velocity_kp * state.joint_rate)
        state = model.advance(state, Actuator(TORQUE, torque), 1)
    measured = np.polyfit(np.arange(20) / rate, np.log(errors), 1)[0]
    if grows:
        assert measured == pytest.approx(predicted, rel=0.01)
    else:
        assert measured < 0.0
