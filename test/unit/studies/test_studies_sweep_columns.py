# SPDX-License-Identifier: Apache-2.0
"""A block of a sweep, computed in columns, gives the same results as single cases."""
from dataclasses import replace
import math

import numpy as np
import pytest
from reference_search import terrain_of
from refusals import refused

from ballbot_ros.config.fields import changed
from ballbot_ros.crossing import held_at, max_step_height, Rules, Site, try_step
from ballbot_ros.crossing.rules import table
from ballbot_ros.errors import BallbotError
from ballbot_ros.physics import Actuation, load_robot
from ballbot_ros.studies import sweep as sweep_module
from ballbot_ros.studies.sweep import run_block
from ballbot_ros.studies.sweep_plan import MOTOR, ROBOT, SI_NUMBERS, SweepPlan

GIMBALL, SHELLBALL = load_robot('gimball'), load_robot('shellball')
STEP = {'speed': (0.3, 1.2), 'height': (0.004, 0.05)}
# A factor of two around the published values, except for the pendulum length.
OWN = {name: (0.5 * getattr(GIMBALL, name), 2.0 * getattr(GIMBALL, name))
       for name in ROBOT if name != 'pendulum_length' and getattr(GIMBALL, name)}
MOTORS = {name: (0.7 * value, 1.1 * value) for name, value in (
    (name, getattr(GIMBALL.motor, name[len('motor.'):])) for name in MOTOR)}
FRICTIONS = dict.fromkeys(
    ('friction_before', 'friction_edge', 'friction_behind'), (0.02, 0.6))
GAINS = {'position_kp': (10.0, 60.0), 'position_kd': (1.0, 12.0), 'velocity_kp': (2.0, 12.0),
         'velocity_ki': (0.0, 5.0), 'torque_limit': (0.5, 4.0)}

PLANS = {
    'robot': SweepPlan(
        GIMBALL.replace(contact_law='hunt_crossley'), design='sobol', cases=80,
        ranges={**STEP, **OWN, 'contact_dissipation': (0.0, 2.0)}),
    'ball alone': SweepPlan(SHELLBALL, design='random', cases=40, ranges={
        **STEP, 'ball_mass': (0.5, 2.0), 'edge_friction': (0.0, 0.5)}),
    'ground in radians': SweepPlan(GIMBALL, design='random', cases=60, ranges={
        **STEP, **FRICTIONS, 'slope_before': (-0.2, 0.2), 'slope_behind': (-0.3, 0.3)}),
    'ground in degrees': SweepPlan(GIMBALL, design='random', cases=60, ranges={
        **STEP, 'slope_before_deg': (-9.0, 9.0), 'slope_behind_deg': (-17.0, 17.0)}),
    'held': SweepPlan(GIMBALL, held_at(0.4), design='random', cases=60, ranges={
        **STEP, **GAINS, 'pendulum_mass': (0.5, 3.0)}),
    'held, the angle varies': SweepPlan(GIMBALL, Actuation('position'), design='random', cases=40,
                                        ranges={**STEP, 'set_angle_deg': (-180.0, 180.0)}),
    'rates that follow the speed': SweepPlan(
        GIMBALL, Actuation('velocity'), design='random', cases=60,
        ranges={**STEP, **GAINS, 'ball_radius': (0.2, 0.3)}),
    'rates of their own': SweepPlan(GIMBALL, Actuation('velocity'), design='random', cases=30,
                                    ranges={**STEP, 'set_rate': (0.0, 6.0)}),
    'torque': SweepPlan(GIMBALL, Actuation('torque'), design='random', cases=30,
                        ranges={**STEP, 'torque': (0.0, 3.0)}),
    'voltages that follow the speed, some too high': SweepPlan(
        GIMBALL, Actuation('voltage'), design='random', cases=60,
        ranges={**STEP, **MOTORS, 'motor.maximum_voltage': (4.0, 12.0)}),
    'voltages, some too high, some 0': SweepPlan(GIMBALL, Actuation('voltage'), grid={
        'voltage': [-3.0, 0.0, 4.0, 1000.0], 'speed': [0.4, 0.9]}, fixed={'height': 0.02}),
    'rules': SweepPlan(GIMBALL, rules=Rules(over='clear'), design='random', cases=40, ranges={
        **STEP, 'lead': (0.0, 0.01), 'time_limit': (0.1, 3.0), 'clearance': (0.1, 1.0)}),
    'any attempt': SweepPlan(SHELLBALL, rules=Rules(attempts='any'), design='random', cases=20,
                             ranges={**STEP, 'gravity': (2.0, 20.0)}),
    'arms that are too long': SweepPlan(GIMBALL, design='random', cases=40, ranges={
        **STEP, 'pendulum_length': (0.0, 0.4), 'ball_radius': (0.15, 0.3)}),
    'no gravity, no pendulum, no arm': SweepPlan(GIMBALL, fixed={
        'height': 0.02, 'speed': 0.7}, grid={'gravity': [0.0, 9.81], 'pendulum_mass': [0.0, 1.2],
                                         'pendulum_length': [0.0, 0.1],
                                         'pendulum_inertia': [0.0, 0.01]}),
    'set values without their law': SweepPlan(GIMBALL, fixed={'height': 0.02, 'speed': 0.7},
                                              grid={'torque': [0.0, 0.5]}),
    'a law without its motor': SweepPlan(replace(GIMBALL, motor=None), Actuation('voltage'),
                                         fixed={'height': 0.02}, grid={'speed': [0.5, 0.6]}),
    'a law without its pendulum': SweepPlan(SHELLBALL, held_at(0.0), fixed={'height': 0.02},
                                            grid={'speed': [0.5, 0.6]}),
    'searches, some sink in': SweepPlan(GIMBALL, fixed={'speed': 3.0}, grid={
        'contact_stiffness': [300.0, 3000.0, 33000.0]}),
    'one case': SweepPlan(GIMBALL, fixed={'height': 0.02}, grid={'speed': [0.6]}),
    'searches': SweepPlan(GIMBALL, site=Site(friction_edge=0.3), design='random', cases=25,
                          ranges={
        'speed': (0.3, 1.5), 'ball_inertia': (0.03, 0.116), 'slope_behind_deg': (-6.0, 6.0)}),
    'searches, some too fast': SweepPlan(GIMBALL, accuracy=1e-3, grid={
        'speed': [0.6, 60.0], 'slope_before': [0.0, 1.3]}),
    'searches in little gravity': SweepPlan(GIMBALL, accuracy=1e-3, fixed={'gravity': 0.01}, grid={
        'speed': [0.05, 8.0]}),
}


def alone(plan, values):
    """Return both results of a case, and the reason if there are none."""
    try:
        robot, speed, height, actuation, site, rules = plan.case(values)
        if height is not None:
            return (*try_step(robot, speed, height, actuation, site=site, rules=rules), None)
        found = max_step_height(robot, speed, actuation, accuracy=plan.accuracy, site=site,
                                rules=rules)
        return found.height, found.error, None
    except BallbotError as error:
        return None, None, str(error)


@pytest.mark.parametrize('kind', PLANS)
def test_columns_are_bit_identical_to_single_cases(kind):
    plan = PLANS[kind]
    block = run_block(plan, 0, plan.size)
    *_, first, second, failure = block
    for place, values in enumerate(plan.block(0, plan.size).tolist()):
        case = dict(zip(plan.names, values))
        assert (block[first][place], block[second][place], block[failure][place]) == alone(
            plan, case), case
        assert all(block[name][place] == value for name, value in case.items())


def test_these_plans_vary_every_parameter():
    varied = {name for plan in PLANS.values() for name in (*plan.names, *plan.fixed)}
    in_radians = {name[:-len('_deg')] for name in varied if name.endswith('_deg')}
    assert varied | in_radians == {*SI_NUMBERS} | {f'{name}_deg' for name in in_radians}


def test_these_plans_contain_every_reason_for_an_empty_row():
    reasons = [reason for plan in PLANS.values() for reason in run_block(
        plan, 0, plan.size)['failure'] if reason is not None]
    for reason in (
            'must be 0 for a robot without a pendulum', 'a pendulum needs a pendulum_inertia or',
            'pendulum_length must be at most ball_radius', 'has no gravity', 'without its law',
            'describes none', 'needs a pendulum and robot', 'voltage must be within',
            'under the ground', 'no step up to'):
        assert any(reason in found for found in reasons), reason


@pytest.mark.parametrize('kind, alone_too', [
    ('robot', 0), ('held', 0), ('voltages, some too high, some 0', 4), ('searches', 0)])
def test_only_cases_that_columns_do_not_support_are_run_alone(monkeypatch, kind, alone_too):
    ran = []
    true = sweep_module._run_alone
    monkeypatch.setattr(sweep_module, '_run_alone',
                        lambda plan, values: ran.append(values) or true(plan, values))
    run_block(PLANS[kind], 0, PLANS[kind].size)
    assert len(ran) == alone_too


def test_single_values_are_checked_and_columns_are_not():
    assert changed(GIMBALL, {}) is GIMBALL
    assert changed(GIMBALL, {'ball_mass': 2}).ball_mass == 2.0
    with refused('out_of_range', 'ball_mass'):
        changed(GIMBALL, {'ball_mass': -1.0})
    many = changed(GIMBALL, {'ball_mass': np.array([1.0, 2.0])})
    np.testing.assert_array_equal(many.total_mass, GIMBALL.pendulum_mass + np.array([1.0, 2.0]))
    assert many.ball_radius == GIMBALL.ball_radius and GIMBALL.ball_mass > 2.0


def test_a_table_repeats_numbers_in_each_row_and_contains_columns():
    np.testing.assert_array_equal(
        table((1.0, np.array([2.0, 3.0]), 4), 2), [[1.0, 2.0, 4.0], [1.0, 3.0, 4.0]])
    np.testing.assert_array_equal(table((1, 2.0), 1), [[1.0, 2.0]])


@pytest.mark.parametrize('site', [
    Site(), Site(0.2, -0.3), Site(-math.pi / 3.0, math.pi / 3.0, 0.1, 0.2, 0.3)])
def test_the_terrain_profile_of_the_kernels_agrees_with_the_simulation(site):
    for robot in (GIMBALL, SHELLBALL):
        terrain = terrain_of(site, 1.0).profile(robot.surface_friction, robot.edge_friction)
        np.testing.assert_allclose(site.grounds(robot, 1)[0], terrain, rtol=0.0, atol=3e-16)
