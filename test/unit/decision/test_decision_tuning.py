# SPDX-License-Identifier: Apache-2.0
"""Tunings: ranges of the numbers, and consistency of robot, curve and tuning."""
from dataclasses import replace

import pytest
from refusals import refused

from ballbot_ros.control import RollingModel
from ballbot_ros.decision import (
    check_decision, DecisionTuning, load_curve, load_decision_tuning)
from ballbot_ros.physics.model.robot import load_robot

GIMBALL, SHELLBALL = load_robot('gimball'), load_robot('shellball')
CURVE = load_curve('gimball_down')
TUNING = load_decision_tuning('decision_default')


@pytest.mark.parametrize('curve, change, reason, field', [
    ('shellball_free', {}, 'inconsistent', 'curve'),
    ('gimball_down', {'acceleration': 0.6}, 'out_of_range', 'acceleration'),
    ('gimball_down', {'largest_lean': 0.3}, 'out_of_range', 'acceleration'),
    ('gimball_down', {'height_margin': 0.0}, 'inconsistent', 'height_margin'),
    ('gimball_down', {'highest_speed': 0.1, 'cruise_speed': 0.1}, 'inconsistent',
     'highest_speed')])
def test_inconsistent_values_are_refused(curve, change, reason, field):
    with refused(reason, field):
        check_decision(GIMBALL, load_curve(curve), replace(TUNING, **change))


def test_shipped_tuning_fits_the_shipped_curves():
    assert TUNING == DecisionTuning()
    check_decision(GIMBALL, CURVE, TUNING)


@pytest.mark.parametrize('name, shown', [('gimball_horizontal', '1.5708 rad'),
                                         ('gimball_free', 'law ')])
def test_a_curve_for_another_approach_is_refused(name, shown):
    with refused('inconsistent', 'curve') as caught:
        check_decision(GIMBALL, load_curve(name), TUNING)
    assert shown in str(caught.value)
    unknown = replace(load_curve(name), made=None)
    check_decision(GIMBALL, unknown, TUNING)


def test_a_curve_with_too_small_a_clearance_behind_the_edge_is_refused():
    assert CURVE.made.over == 'clear' and CURVE.made.clearance == 0.25
    older = replace(CURVE, made=replace(CURVE.made, over='edge', clearance=0.0))
    with refused('inconsistent', 'curve'):
        check_decision(GIMBALL, older, TUNING)
    nearly = replace(CURVE, made=replace(CURVE.made, clearance=0.1))
    with refused('inconsistent', 'curve'):
        check_decision(GIMBALL, nearly, TUNING)


def test_a_cruise_speed_above_the_highest_speed_is_refused():
    with refused('inconsistent', 'cruise_speed'):
        DecisionTuning(cruise_speed=1.2)
    assert DecisionTuning(cruise_speed=1.1).cruise_speed == 1.1


def test_an_emergency_lean_below_the_largest_lean_is_refused():
    with refused('inconsistent', 'emergency_lean'):
        DecisionTuning(largest_lean=1.45)
    assert DecisionTuning(largest_lean=1.4).emergency_lean == 1.4
    assert DecisionTuning(largest_lean=1.5, emergency_lean=1.5).largest_lean == 1.5


TINY = 1e-9


@pytest.mark.parametrize('name, allowed, beyond', [
    *((name, [TINY], [0.0, -TINY]) for name in (
        'acceleration', 'deceleration', 'reaction_time', 'observation_timeout',
        'contradiction_sigma', 'cruise_speed')),
    *((name, [0.0], [-TINY]) for name in (
        'height_margin', 'sigma_margin', 'stop_gap', 'room_behind', 'unseen_room',
        'highest_descent', 'height_bias_sd')),
    ('required_probability', [0.5, 0.999], [0.5 - TINY, 0.999 + TINY]),
    ('actuation_delay', [0.0, 0.5], [-TINY, 0.5 + TINY]),
    ('emergency_lean', [0.7, 1.55], [0.0, 1.55 + TINY]),
    ('largest_swing', [0.0, 3.1], [-TINY, 3.1 + TINY]),
    ('highest_speed', [0.4], [0.0]),
    ('speed_margin', [0.0, 1.0], [-TINY, 1.0 + TINY]),
    ('largest_lean', [TINY, 1.4], [0.0, 1.5 + TINY]),
    ('forget_after', [1], [0])])
def test_each_number_has_its_range(name, allowed, beyond):
    for value in allowed:
        assert getattr(DecisionTuning(**{name: value}), name) == value
    for value in beyond:
        with refused('out_of_range', name):
            DecisionTuning(**{name: value})


def test_barely_consistent_values_are_accepted():
    possible = RollingModel(GIMBALL).held_acceleration(TUNING.largest_lean)
    check_decision(GIMBALL, CURVE, replace(
        TUNING, height_margin=CURVE.residual, highest_speed=CURVE.lowest_speed,
        cruise_speed=CURVE.lowest_speed, acceleration=possible, deceleration=possible))
    with refused('out_of_range', 'deceleration'):
        check_decision(GIMBALL, CURVE, replace(TUNING, deceleration=possible + 1e-6))


def test_a_curve_of_a_robot_with_other_parameters_is_refused():
    heavier = replace(GIMBALL, ball_mass=3.9)
    with refused('inconsistent', 'curve'):
        check_decision(heavier, CURVE, TUNING)
    motor = replace(GIMBALL, motor=replace(GIMBALL.motor, resistance=3.0))
    assert len({GIMBALL.digest, heavier.digest, motor.digest, SHELLBALL.digest}) == 4
    assert replace(GIMBALL, name='other').digest == GIMBALL.digest
