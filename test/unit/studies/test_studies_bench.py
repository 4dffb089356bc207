# SPDX-License-Identifier: Apache-2.0
"""The virtual test bench has the sensors of the real one and finds the thresholds of the model."""
import csv
from dataclasses import replace
import math

import numpy as np
import pytest
from reference_search import crosses
from refusals import refused

from ballbot_ros.cli import main
from ballbot_ros.crossing.rules import touch_distance
from ballbot_ros.paper import procedure
from ballbot_ros.paper.procedure import find_thresholds, run_tests, true_thresholds
from ballbot_ros.paper.test_bench import first_passage, Ramp, Roll, RunUp
from ballbot_ros.physics import load_robot
from ballbot_ros.physics.simulation.model import Model

GIMBALL, SHELLBALL = load_robot('gimball'), load_robot('shellball')
STILL = {'pendulum_sd': 0.0, 'release_sd': 0.0, 'push_sd': 0.0}


def generator(seed=0):
    """Return a random generator."""
    return np.random.default_rng(seed)


@pytest.mark.parametrize('height', [0.02, 0.08, 0.2])
def test_a_ball_without_losses_keeps_the_energy_of_its_release(height):
    # v^2 (1 + kappa) / 2 = g h; friction with a sharp threshold does not creep.
    ball, rig = replace(SHELLBALL, rolling_friction=0.0, slip_threshold=1e-4), Ramp(**STILL)
    model = Model(ball, rig.terrain(0.02))
    drop = rig.begin(model, height, generator())[0].y - model.at_rest(-0.4).y
    assert drop == pytest.approx(height, rel=0.1)  # a ball on a slope is slightly higher at rest
    kappa = ball.ball_inertia / (ball.ball_mass * ball.ball_radius**2)
    assert rig.roll(ball, 0.02, height, generator()).touch_speed == pytest.approx(
        math.sqrt(2.0 * 9.81 * drop / (1.0 + kappa)), rel=1e-3)


def test_the_sensors_measure_their_mean_speed_with_the_resolution_of_their_rate():
    ball = replace(SHELLBALL, rolling_friction=0.0)
    roll = Ramp(**STILL).roll(ball, 0.02, 0.08, generator())
    ticks = 0.1 * 1000.0 / roll.measured_speed
    assert ticks == pytest.approx(round(ticks), abs=1e-9)
    assert roll.measured_speed == pytest.approx(roll.touch_speed, rel=1.0 / ticks)
    fine = Ramp(sensor_rate=1e6, **STILL).roll(ball, 0.02, 0.08, generator())
    assert fine.measured_speed == pytest.approx(fine.touch_speed, rel=2e-3)


def test_with_friction_the_measured_speed_exceeds_the_collision_speed():
    roll = Ramp(**STILL).roll(GIMBALL, 0.02, 0.05, generator())
    assert roll.measured_speed > 1.05 * roll.touch_speed
    assert roll.touch_angle < -0.1  # joint friction moves the pendulum backwards


def test_the_time_of_passage_is_interpolated_between_samples():
    time, x = np.array([0.0, 1.0, 2.0]), np.array([-1.0, 0.0, 4.0])
    assert first_passage(time, x, 1.0) == 1.25
    assert first_passage(time, x, 5.0) is None
    assert first_passage(time, x, -2.0) is None


def test_the_driven_ball_starts_1_20_m_before_the_touch():
    rig = RunUp(length_sd=0.0, voltage_sd=0.0, pendulum_sd=0.0)
    model = Model(GIMBALL, rig.terrain(0.03))
    start, actuation = rig.begin(model, 6.0, generator())
    touch = touch_distance(GIMBALL.ball_radius, 0.03, GIMBALL.static_penetration)
    assert start.x == pytest.approx(-1.2 - touch)
    assert (start.velocity_x, actuation.law, actuation.voltage) == (0.0, 'voltage', 6.0)


def test_a_ball_that_does_not_reach_the_sensors_has_no_speed():
    roll = RunUp().roll(GIMBALL, 0.03, 0.05, generator())
    assert not roll.passed and math.isnan(roll.measured_speed) and math.isnan(roll.touch_speed)


def test_equal_seeds_give_equal_rolls_and_another_seed_gives_others():
    first, same, other = (
        list(run_tests(Ramp(), SHELLBALL, (0.005,), seed, 3)) for seed in (3, 3, 4))
    assert first == same
    assert first != other


@pytest.mark.slow
def test_the_measured_thresholds_agree_with_the_model():
    # ShellBall has no pendulum: only its speed matters.
    rolls = list(run_tests(Ramp(), SHELLBALL, (0.02,), fine_rolls=16))
    for item in true_thresholds(rolls):
        assert not crosses(SHELLBALL, 0.985 * item.highest_no_pass, item.step_height)
        assert crosses(SHELLBALL, 1.015 * item.lowest_pass, item.step_height)
        assert item.lowest_pass == pytest.approx(item.highest_no_pass, rel=0.03)


def test_tests_end_at_the_highest_release_of_the_ramp():
    rolls = list(run_tests(Ramp(highest=0.02), SHELLBALL, (0.005, 0.03, 0.04)))
    assert [roll.step_height for roll in rolls][-1] == 0.03
    assert [roll.setting for roll in rolls[-procedure.ATTEMPTS_MAX:]] == [
        0.02] * procedure.ATTEMPTS_MAX


def test_thresholds_ignore_rolls_without_a_speed():
    nan = math.nan
    found = find_thresholds([
        Roll(0.01, 1.0, nan, False, nan, nan), Roll(0.01, 1.0, 0.4, False, 0.4, 0.0),
        Roll(0.01, 1.0, 0.5, True, 0.5, 0.0), Roll(0.02, 1.0, nan, False, nan, nan)])
    assert found[0] == (0.01, 3, 0.4, 0.5)
    assert found[1].rolls == 1 and math.isnan(found[1].highest_no_pass)


@pytest.mark.parametrize('make, reason, field', [
    (lambda: Ramp(slope=1.0), 'out_of_range', 'slope'),
    (lambda: RunUp(run_up=1e9), 'out_of_range', 'run_up'),
    (lambda: Ramp(sensor_distance=0.55), 'inconsistent', 'sensor_distance'),
    (lambda: RunUp(run_up=0.6, sensor_distance=0.55), 'inconsistent', 'sensor_distance'),
    (lambda: Ramp(sensor_distance=0.1).roll(GIMBALL, 0.055, 0.1, generator()), 'inconsistent',
     'sensor_distance'),
    (lambda: RunUp().roll(SHELLBALL, 0.02, 5.0, generator()), 'missing', 'law')])
def test_an_invalid_test_is_refused(make, reason, field):
    with refused(reason, field):
        make()


def tables(folder):
    """Return the rows of both tables."""
    return [list(csv.DictReader((folder / name).open())) for name in ('tests.csv', 'truth.csv')]


def test_the_command_writes_the_table_of_measurements_and_the_plot(
        capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(procedure, 'HEIGHTS', (0.005, 0.01))
    assert main(['test-bench', '--robot', 'shellball', '--rolls', '2', '--out',
                 str(tmp_path)]) == 0
    seen, true = tables(tmp_path)
    assert list(seen[0]) == ['test', 'step height [mm]', 'release height [m]',
                             'measured speed [m/s]', 'passed']
    assert len(seen) == len(true) and {row['passed'] for row in seen} == {'yes', 'no'}
    assert [row['step height [mm]'] for row in seen] == sorted(
        (row['step height [mm]'] for row in seen), key=float)
    assert (tmp_path / 'tests.png').stat().st_size > 10_000
    assert (tmp_path / 'tests.svg').read_text().count('<svg') == 1
    out = capsys.readouterr().out
    assert f'{len(seen)} rolls' in out and 'highest no-pass' in out


def test_an_interrupted_test_keeps_its_rolls(capsys, tmp_path, monkeypatch):
    def interrupted(*_):
        yield Roll(0.005, 0.01, 0.2, False, 0.19, 0.0)
        yield Roll(0.005, 0.02, 0.4, True, 0.39, 0.0)
        raise KeyboardInterrupt

    monkeypatch.setattr(procedure, 'run_tests', interrupted)
    assert main(['test-bench', '--quiet', '--out', str(tmp_path)]) == 130
    assert len(tables(tmp_path)[0]) == 2
    assert 'after 2 rolls' in capsys.readouterr().err


@pytest.mark.parametrize('words, reason, field', [
    (['--seed', '-1'], 'out_of_range', '--seed'),
    (['--slope-deg', '80'], 'out_of_range', '--slope-deg'),
    (['--rolls', '0'], 'out_of_range', '--rolls'),
    (['--robot', 'shellball', '--driven'], 'missing', 'law')])
def test_an_impossible_option_leaves_no_folder(refuses, tmp_path, words, reason, field):
    refuses(reason, field, 'test-bench', '--out', tmp_path / 'none', *words)
    assert not (tmp_path / 'none').exists()
