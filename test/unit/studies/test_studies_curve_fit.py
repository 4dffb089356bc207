# SPDX-License-Identifier: Apache-2.0
"""Curves fitted to the simulation: monotone, conservative variants below it, provenance."""
import math

from hypothesis import given, settings, strategies
import numpy as np
import pytest
import yaml

from ballbot_ros.cli import main
from ballbot_ros.crossing import held_at, max_step_height, rolling, Rules
from ballbot_ros.decision import load_curve
from ballbot_ros.physics import Actuation, load_robot
from ballbot_ros.physics.model.uncertainty import draw, uncertain
from ballbot_ros.studies.curve_fit import (
    conservative_cubic, curve_text, fit_curve, LEAST_SLOPE, monotone_cubic, Request)

GIMBALL, SHELLBALL = load_robot('gimball'), load_robot('shellball')
CLEAR = Rules(over='clear')
SPEEDS = np.linspace(0.2, 1.2, 21)
DENSE = np.linspace(0.2, 1.2, 161)
SHIPPED = {
    'gimball_down': held_at(0.0), 'gimball_free': Actuation(),
    'gimball_horizontal': held_at(math.pi / 2), 'shellball_free': Actuation()}
numbers = strategies.floats(-1.0, 1.0)


def least_slope(coefficients):
    """Return the least slope of a cubic from 0.2 to 1.2."""
    slope = np.polynomial.Polynomial(coefficients).deriv()
    bends = [speed.real for speed in slope.deriv().roots() if 0.2 < speed.real < 1.2]
    return min(slope(speed) for speed in (0.2, 1.2, *bends))


@given(strategies.tuples(numbers, numbers, numbers, numbers))
@settings(max_examples=40, deadline=None)
def test_a_rising_cubic_is_recovered(coefficients):
    heights = np.polynomial.Polynomial(coefficients)(SPEEDS)
    if least_slope(coefficients) > 2.0 * LEAST_SLOPE:
        np.testing.assert_allclose(monotone_cubic(SPEEDS, heights), coefficients, atol=1e-9)


@given(strategies.lists(strategies.floats(-0.004, 0.004), min_size=21, max_size=21))
@settings(max_examples=25, deadline=None)
def test_the_fit_is_the_best_rising_cubic_even_for_heights_that_do_not_rise(bumps):
    heights = 0.02 + 0.01 * np.tanh(3.0 * (SPEEDS - 0.5)) + np.array(bumps)
    found = monotone_cubic(SPEEDS, heights)
    assert least_slope(found) > 0.0
    misfit = np.sum((np.polynomial.Polynomial(found)(SPEEDS) - heights)**2)
    generator = np.random.default_rng(0)
    for _ in range(50):
        other = found + generator.normal(size=4) * 1e-3
        if least_slope(other) >= LEAST_SLOPE:
            rest = np.polynomial.Polynomial(other)(SPEEDS) - heights
            assert np.sum(rest**2) >= misfit * (1.0 - 1e-6)


@given(strategies.lists(strategies.floats(-0.002, 0.002), min_size=161, max_size=161))
@settings(max_examples=25, deadline=None)
def test_the_conservative_cubic_rises_and_is_below_all_heights(bumps):
    heights = 0.03 * DENSE + np.array(bumps)
    found = conservative_cubic(DENSE, heights)
    assert least_slope(found) > 0.0
    assert (np.polynomial.Polynomial(found)(DENSE) < heights).all()


def test_the_conservative_cubic_is_close_below_a_cubic_of_heights():
    coefficients = np.array([-0.001, 0.002, 0.07, -0.03])
    heights = np.polynomial.Polynomial(coefficients)(DENSE)
    gap = heights - np.polynomial.Polynomial(conservative_cubic(DENSE, heights))(DENSE)
    assert 0.0 < gap.max() < 2e-6


@pytest.mark.parametrize('name', SHIPPED)
def test_no_shipped_conservative_curve_is_above_the_simulation(name):
    curve, fit = load_curve(name, 'conservative'), load_curve(name)
    robot = load_robot(curve.robot)
    for speed in np.random.default_rng(7).uniform(0.2, 1.2, 40):
        found = max_step_height(robot, speed, SHIPPED[name], accuracy=1e-6, rules=CLEAR)
        assert curve.height(speed) <= found.height
        assert curve.height(speed) > found.height - 1.5e-3
        assert abs(fit.height(speed) - found.height) < fit.residual + 1e-4
    assert curve.residual == 0.0


@pytest.mark.parametrize('name', SHIPPED)
def test_a_shipped_curve_contains_its_provenance(name):
    curve = load_curve(name)
    robot = load_robot(curve.robot)
    assert curve.made.robot_digest == robot.digest
    assert curve.made.law == SHIPPED[name].law
    assert curve.made.set_angle == SHIPPED[name].set_angle
    assert (curve.made.surface_friction, curve.made.edge_friction) == (
        robot.surface_friction, robot.edge_friction)
    assert 0.0 < curve.rms <= curve.residual
    covariance = np.array(curve.covariance)
    assert (np.linalg.eigvalsh(covariance + covariance.T) > -1e-9).all()
    assert (curve.band is None) == (not uncertain(robot))


def test_covariance_and_residual_are_those_of_least_squares():
    curve = fit_curve('mine', SHELLBALL, Actuation(), 'none', Request())
    heights = [max_step_height(SHELLBALL, speed, accuracy=2e-6, rules=CLEAR).height
               for speed in SPEEDS.round(12)]
    _, known = np.polyfit(SPEEDS, heights, 3, cov=True)
    np.testing.assert_allclose(curve.covariance, known[::-1, ::-1], rtol=1e-6)
    misfit = np.abs(np.polynomial.Polynomial(curve.coefficients)(SPEEDS) - heights).max()
    assert misfit <= curve.residual <= misfit + 1e-6, 'a bound, rounded up to a micrometre'


def test_sampled_robots_keep_their_ranges_and_their_total_mass():
    robots = draw(GIMBALL, 100, seed=3)
    assert len(robots) == 100 and len({robot.digest for robot in robots}) == 100
    for name, (low, high) in uncertain(GIMBALL).items():
        values = [getattr(robot, name) for robot in robots]
        assert low <= min(values) < low + 0.05 * (high - low)
        assert high >= max(values) > high - 0.05 * (high - low)
    assert max(abs(robot.total_mass - GIMBALL.total_mass) for robot in robots) < 1e-12
    assert draw(GIMBALL, 100, seed=3) == robots
    assert draw(SHELLBALL, 3) == [SHELLBALL] * 3


def test_the_probability_of_passing_is_the_fraction_of_robots_that_pass():
    band = load_curve('gimball_free').band
    robots = draw(GIMBALL, 64, seed=11)
    for speed in (0.5, 0.9):
        heights = np.array([
            max_step_height(robot, speed, accuracy=2e-5, rules=CLEAR).height for robot in robots])
        for height in np.linspace(heights.min() - 1e-3, heights.max() + 1e-3, 9):
            counted = np.mean(heights >= height)
            assert band.probability_of_passing(speed, height) == pytest.approx(counted, abs=0.08)


def test_the_file_of_a_curve_without_a_band_contains_no_band(tmp_path):
    path = tmp_path / 'mine.yaml'
    assert main(['fit-curve', '--robot', 'shellball', '--out', str(path), '--speed', '0.2:0.6:6',
                 '--accuracy', '1e-4', '--quiet']) == 0
    assert load_curve(str(path)).band is None and 'band' not in path.read_text()


def test_a_written_curve_loads_unchanged(tmp_path, capsys):
    path = tmp_path / 'mine.yaml'
    assert main(['fit-curve', '--robot', 'gimball', '--actuation', 'velocity', '--out', str(path),
                 '--samples', '2', '--speed', '0.2:0.6:6', '--quiet']) == 0
    curve = load_curve(str(path))
    assert curve.name == 'mine' and curve.made.law == 'velocity' and curve.band.samples == 2
    again = tmp_path / 'again.yaml'
    again.write_text(curve_text(curve, 'GimBall', 'a test'))
    assert load_curve(str(again)) == curve
    assert yaml.safe_load(again.read_text()) == yaml.safe_load(path.read_text())
    law = rolling(GIMBALL)
    for speed in (0.25, 0.5):
        assert curve.height(speed) == pytest.approx(
            max_step_height(GIMBALL, speed, law(speed), rules=CLEAR).height,
            abs=curve.residual + 2e-4)


@pytest.mark.parametrize('words, reason, field', [
    (['--out', 'x.txt'], 'not_a_choice', '--out'),
    (['--out', 'x.yaml', '--speed', '0.2:1.2:3'], 'out_of_range', '--speed: COUNT'),
    (['--out', 'x.yaml', '--speed', '0.2:0.1:21'], 'inconsistent', '--speed'),
    (['--out', 'x.yaml', '--speed', '0.2,0.4'], 'wrong_type', '--speed'),
    (['--out', 'x.yaml', '--samples', '1'], 'out_of_range', 'samples'),
    (['--out', 'x.yaml', '--robot', 'shellball', '--samples', '8'], 'inconsistent', 'samples'),
    (['--out', 'x.yaml', '--angle-deg', '3'], 'inconsistent', '--angle-deg')])
def test_impossible_options_are_refused_before_output(
        refuses, tmp_path, monkeypatch, words, reason, field):
    monkeypatch.chdir(tmp_path)
    refuses(reason, field, 'fit-curve', *words)
    assert list(tmp_path.iterdir()) == []
