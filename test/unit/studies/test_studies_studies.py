# SPDX-License-Identifier: Apache-2.0
"""Studies of sensitivity, sampled robots, design and slopes."""
from dataclasses import replace
import math

import numpy as np
import pytest
from refusals import refused

from ballbot_ros.paper.cases import Case, holding, LEVEL, step_height, step_heights
from ballbot_ros.paper.design import (
    design_map, heights_on_slopes, sampled_heights, sensitivity)
from ballbot_ros.physics import Actuation, load_robot
from ballbot_ros.physics.model.uncertainty import changed, draw, independent, ranges

GIMBALL, SHELLBALL = load_robot('gimball'), load_robot('shellball')


def test_the_split_of_the_mass_is_uncertain_and_its_total_is_not():
    assert {'pendulum_mass', 'ball_mass'} <= set(ranges(GIMBALL))
    assert set(ranges(GIMBALL)) - set(independent(ranges(GIMBALL))) == {'ball_mass'}
    for name in ('pendulum_mass', 'ball_mass'):
        other = changed(GIMBALL, {name: 2.0})
        assert getattr(other, name) == 2.0
        assert other.total_mass == pytest.approx(GIMBALL.total_mass, rel=1e-12)
    both = changed(GIMBALL, {'pendulum_mass': 2.0, 'ball_mass': 4.0})
    assert (both.pendulum_mass, both.ball_mass) == (2.0, 4.0)


def test_a_certain_mass_does_not_change():
    sure = replace(GIMBALL, provenance={
        **GIMBALL.provenance, 'ball_mass': GIMBALL.provenance['ball_radius']})
    assert 'pendulum_mass' in independent(ranges(sure))
    assert changed(sure, {'pendulum_mass': 2.0}).ball_mass == GIMBALL.ball_mass
    assert all(robot.ball_mass == GIMBALL.ball_mass for robot in draw(sure, 4))


def test_parameters_of_the_motor_are_changed_in_the_motor():
    assert changed(GIMBALL, {'motor.resistance': 2.0}).motor.resistance == 2.0
    with refused('missing', 'motor'):
        changed(SHELLBALL, {'motor.resistance': 2.0})


def test_the_ends_of_a_bar_are_the_heights_of_the_changed_robots():
    fractions = []
    bars = {bar.name: bar for bar in sensitivity(Case(GIMBALL), 0.8, fractions.append)}
    inertia = bars['ball_inertia']
    assert (inertia.low, inertia.high, inertia.unit) == (0.05, 0.116, 'kg m2')
    assert inertia.height_high == step_height(
        Case(replace(GIMBALL, ball_inertia=0.116)), 0.8)
    assert inertia.uncertain and not bars['contact_stiffness'].uncertain
    assert bars['contact_stiffness'].high == pytest.approx(1.1 * 33000.0)
    assert not any(name.startswith('motor') for name in bars)
    assert {'gravity', 'ball_mass', 'slip_threshold'}.isdisjoint(bars)
    assert fractions == sorted(fractions) and fractions[-1] == 1.0


def test_bars_are_sorted_by_decreasing_effect():
    bars = sensitivity(Case(GIMBALL), 0.8)
    effects = [abs(bar.height_high - bar.height_low) for bar in bars]
    assert bars[0].name == 'ball_inertia' and effects == sorted(effects, reverse=True)


def test_with_a_voltage_the_motor_has_a_large_effect():
    bars = sensitivity(Case(GIMBALL, Actuation(law='voltage', voltage=5.7)), 0.8)
    assert 'motor.speed_constant' in [bar.name for bar in bars[:3]]


def test_sampled_heights_are_those_of_the_sampled_robots():
    speeds = np.array([0.4, 0.8])
    found = sampled_heights(Case(GIMBALL), speeds, 3)
    last = draw(GIMBALL, 3)[-1]
    np.testing.assert_array_equal(found[-1], step_heights(Case(last), speeds))


def test_the_design_map_agrees_with_the_robot_at_its_own_pendulum():
    lengths, masses = np.array([0.04, GIMBALL.pendulum_length]), np.array([1.6, 3.0])
    found = design_map(holding(GIMBALL, LEVEL), 0.8, lengths, masses)
    assert found.shape == (2, 2)
    assert found[0, 1] == pytest.approx(step_height(holding(GIMBALL, LEVEL), 0.8), abs=1.2e-4)
    assert found[0, 1] > found[0, 0] + 1e-3 and found[1, 0] > found[0, 0]


def test_a_slope_behind_the_step_reduces_the_height_only_above_the_slope_limit_if_held():
    speeds, slopes = np.array([0.5]), np.radians([-6.0, 0.0, 5.0, 8.0])
    free = heights_on_slopes(Case(GIMBALL), speeds, slopes)[:, 0]
    level = heights_on_slopes(holding(GIMBALL, LEVEL), speeds, slopes)[:, 0]
    assert free[1] == step_heights(Case(GIMBALL), speeds)[0]
    assert free[0] == pytest.approx(free[1], abs=1e-4)
    assert free[3] < free[2] - 5e-4 < free[1] - 5e-4
    assert math.radians(5.0) < GIMBALL.slope_limit < math.radians(8.0)
    assert level[2] == pytest.approx(level[1], abs=1e-4) and level[3] < level[1] - 5e-4
