# SPDX-License-Identifier: Apache-2.0
"""Extreme runs terminate, either with an accurate result or with a helpful error."""
from dataclasses import replace
import importlib
from pathlib import Path
import sys

import numpy as np
import pytest
from refusals import refused

from ballbot_ros.control import growth_rate, is_stable
from ballbot_ros.errors import SimulationError
from ballbot_ros.physics import (
    Actuation, load_robot, load_scene, Model, simulate, Solver, State, Terrain)
from ballbot_ros.physics.mechanics.equations import X
from ballbot_ros.physics.simulation.run import run_once
from ballbot_ros.physics.simulation.solver import Integrator, out_of_balance
from ballbot_ros.physics.solvers.values import FINISHED, Status

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / 'extremes'))
BY_NAME, make_case = (
    getattr(importlib.import_module('cases'), name) for name in ('BY_NAME', 'make_case'))
judging = importlib.import_module('judge')
judge, CHAOTIC, REFUSED, UNCONFIRMED, WRONG = (
    getattr(judging, name) for name in ('judge', 'CHAOTIC', 'REFUSED', 'UNCONFIRMED', 'WRONG'))

refusal, remedy = (
    getattr(importlib.import_module('remedies'), name) for name in ('refusal', 'remedy'))

SHELLBALL = load_robot('shellball')
ROUGH = Terrain([[0.001 * i, 0.0005 * (i % 2)] for i in range(1000)])


def test_a_run_fails_when_its_work_budget_is_exhausted():
    scene = load_scene('fig7_top')
    needed = simulate(replace(scene.model, solver=Solver('adaptive')), scene.start,
                      scene.actuation, 1.0).effort.evaluations
    model = replace(scene.model, solver=Solver('adaptive', work_budget=needed // 2))
    with refused('over_budget', 'work_budget', SimulationError) as caught:
        simulate(model, scene.start, scene.actuation, 1.0)
    assert 'slip_threshold' in caught.value.remedy
    assert 0.0 < caught.value.trajectory['time'][-1] <= caught.value.time < 1.0


def test_each_call_of_advance_has_its_own_work_budget():
    model = Model(SHELLBALL, Terrain.flat(), solver=Solver('adaptive', work_budget=1000))
    state, drive = model.at_rest(0.0, 1.0), Actuation().actuator(SHELLBALL)
    for _ in range(200):
        state = model.advance(state, drive, 50)
    with refused('over_budget', 'work_budget', SimulationError):
        model.advance(state, drive, 10_000_000)


def test_contact_checks_of_thousands_of_features_count_as_work():
    robot = replace(SHELLBALL, ball_radius=1.0)
    model = Model(robot, ROUGH, solver=Solver('adaptive', work_budget=20_000))
    start = State(x=0.5, y=1.0, velocity_x=1.0)
    with refused('over_budget', 'work_budget', SimulationError):
        simulate(model, start, Actuation(), 10.0)


def test_a_thousand_elastic_bounces_conserve_energy():
    robot = replace(SHELLBALL, contact_damping=0.0, rolling_friction=0.0)
    model = Model(robot, Terrain.flat(), solver=Solver('adaptive'))
    start = State(y=robot.ball_radius + 0.05)
    run = simulate(model, start, Actuation(), 230.0, 1e-2)
    energy = run['kinetic_energy'] + run['potential_energy'] + run['contact_energy']
    upward = run['velocity_y'] > 0.0
    assert np.sum(~upward[:-1] & upward[1:]) >= 1000
    assert np.max(np.abs(energy - energy[0])) < 1e-3 * robot.weight * 0.05


def test_a_tiny_ball_does_not_fall_through_the_floor_between_contact_checks():
    robot = replace(SHELLBALL, ball_radius=1e-3, ball_inertia=1e-9, ball_mass=1e-3,
                    contact_stiffness=1e3, contact_damping=0.1, gravity=25.0)
    spike = Terrain([[-1.0, 0.0], [-1e-4, 0.0], [0.0, 5e-4], [1e-4, 0.0], [1.0, 0.0]])
    run = simulate(Model(robot, spike, solver=Solver('adaptive')),
                   State(x=1e-5, y=3e-3), Actuation(), 0.2)
    assert np.max(np.abs(run.energy_residual)) < 1e-4 * run.energy_in_play


@pytest.mark.parametrize('method', ['adaptive', 'implicit', 'explicit'])
@pytest.mark.parametrize('begin', [-0.5, -0.47, -0.44, -0.41])
def test_a_contact_much_shorter_than_a_step_is_detected_and_gives_the_correct_impulse(
        method, begin):
    # Flight with a position controller has no closed form; this one does not move the centre.
    robot = replace(load_robot('gimball'), pendulum_length=0.0, gravity=0.0, contact_damping=0.0,
                    edge_friction=0.0)
    radius, depth, speed = robot.ball_radius, 1e-6, 20.0
    spike = Terrain([[-5.0, -1.0], [0.0, 0.0], [5.0, -1.0]])
    run = simulate(
        Model(robot, spike, solver=Solver(method, tolerance=1e-12)),
        State(x=begin, y=radius - depth, velocity_x=speed),
        Actuation(law='position', set_angle=1.0), 0.05)
    # The depth is a parabola over a chord of the ball for 67 us; a step takes 2.8 ms.
    contact_time = 2.0 * np.sqrt(2.0 * radius * depth) / speed
    impulse = 2.0 / 3.0 * robot.contact_stiffness * depth * contact_time
    assert run['velocity_y'][-1] == pytest.approx(impulse / robot.total_mass, rel=1e-3)


@pytest.mark.parametrize('seed, tolerances', [
    (5003019, (2.26e-7, 6.78e-9, 2.034e-10)), (5010932, (4.51e-7, 1.35e-8, 4.06e-10))])
def test_a_short_contact_is_detected_at_every_tolerance(seed, tolerances):
    exact = extreme_run('combined', seed, 1e-12, 400_000)
    for tolerance in tolerances:
        run = extreme_run('combined', seed, tolerance, 400_000)
        assert run.effort.events == exact.effort.events
        # The error was 200 and 58 um when the contact was missed.
        assert abs(run['x'][-1] - exact['x'][-1]) + abs(run['y'][-1] - exact['y'][-1]) < 2e-5


@pytest.mark.parametrize('tolerance', [2.26e-7, 6.78e-9])
def test_an_event_within_a_fast_transient_is_located_as_with_explicit_steps(tolerance):
    # Implicit steps of 0.1 ms skipped a slip transient of 2 ns.
    case = make_case('combined', 9008773)

    def rate(method, tolerance):
        model = replace(case.model, solver=Solver(method, tolerance=tolerance))
        return simulate(model, case.start, case.actuation, 5e-4)['ball_rate'][-1]
    exact = rate('explicit', 1e-12)
    assert rate('adaptive', tolerance) == pytest.approx(exact, rel=1e-4)


def test_fixed_steps_beyond_the_work_budget_are_refused_before_they_start():
    model = Model(SHELLBALL, Terrain.flat(), solver=Solver('rk4', 1e-6, work_budget=10_000))
    start = model.at_rest(0.0, 1.0)
    with refused('out_of_range', 'work_budget'):
        simulate(model, start, Actuation(), 1.0)
    with refused('out_of_range', 'work_budget'):
        model.advance(start, Actuation().actuator(SHELLBALL), 2501)


@pytest.mark.parametrize('name', [name for name in BY_NAME if name != 'hour'])
def test_no_extreme_case_gives_a_wrong_result(name):
    for seed in range(2 if name in ('bounces', 'control_period') else 6):
        found = judge(name, seed)
        assert found.verdict != WRONG, f'--only {name}:{seed}  {found.why}'


@pytest.mark.parametrize('reason, shift, verdict', [
    ('over_budget', 0.0, UNCONFIRMED), ('over_budget', 1.0, WRONG), ('not_finite', 0.0, WRONG)])
def test_a_failed_stricter_run_leaves_a_result_unconfirmed_or_shows_it_wrong(
        monkeypatch, reason, shift, verdict):
    runs = []

    def run_then_fail(*given, **named):
        if not runs:
            runs.append(simulate(*given, **named))
            return runs[0]
        error = SimulationError(1.0, 'cause', 'remedy', reason, '')
        error.trajectory = replace(runs[0], rows=runs[0].rows[:5] + shift)
        raise error

    monkeypatch.setattr(judging, 'simulate', run_then_fail)
    assert judge('slope', 0).verdict == verdict


def test_a_transient_energy_balance_error_is_detected():
    # The energy balance closes at the end of this run, so each sample is checked.
    found = judge('fixed', 811)
    assert found.verdict == REFUSED and 'energy balance error' in found.why


def test_a_case_depends_only_on_its_class_and_seed():
    assert make_case('combined', 3).start == make_case('combined', 3).start
    assert make_case('combined', 3).start != make_case('combined', 4).start


@pytest.mark.parametrize('seed', [73, 373, 516])
def test_contact_events_caused_by_rounding_are_stepped_over(seed):
    # With almost no gravity, the depth changes by less than its rounding between two events.
    found = judge('gravity', seed)
    assert found.verdict != WRONG, found.why


@pytest.mark.parametrize('method', ['adaptive', 'implicit', 'explicit'])
def test_a_run_with_a_tolerance_above_the_penetration_terminates(method):
    scene = load_scene('shellball_drop')
    model = replace(scene.model, solver=Solver(
        method, tolerance=1e-3, models='full', work_budget=50_000))
    assert model.solver.tolerance > 5.0 * model.robot.static_penetration
    # The tolerance may be too coarse for the energy balance, but the run must end.
    vector = np.array(scene.start[1:])
    status = Integrator(model.parameters, model.profile, model.solver).advance(
        scene.actuation.actuator(model.robot), vector, Status(FINISHED, 0.0), scene.run.duration)
    assert status.outcome == FINISHED and status.time == scene.run.duration
    assert 0.0 < vector[X] < 0.5


def extreme_run(name, seed, tolerance, budget):
    case = make_case(name, seed)
    model = replace(case.model, solver=replace(
        case.model.solver, tolerance=tolerance, work_budget=budget))
    return simulate(model, case.start, case.actuation, case.duration, 0.02 * case.duration)


def test_steps_limited_by_stiffness_below_the_stability_limit_become_implicit():
    # Explicit steps stayed at 0.43 of that limit and took 2,000,000 evaluations.
    assert extreme_run('combined', 1338, 2.034e-10, 20_000).effort.evaluations < 10_000


def test_a_touch_is_not_located_a_rounding_error_before_the_contact():
    # The contact chattered with about 20 events per microsecond and exhausted the work budget.
    run = extreme_run('combined', 2794, 7.43e-11, 400_000)
    assert len(run) == 51 and run.effort.events < 10_000


def test_an_event_shorter_than_the_resolution_of_time_is_stepped_over():
    # 40 kN m act on a ball of 0.05 g: its slip passes the threshold in less than 1e-16 s.
    run = extreme_run('combined', 120, 5.9e-12, 20_000)
    assert len(run) == 51 and np.max(np.abs(run.energy_residual)) < 1e-3 * run.energy_in_play


@pytest.mark.slow
@pytest.mark.parametrize('which', [
    'stiffness:341', 'fixed:1002', 'combined:120', 'combined:470', 'combined:869',
    'combined:1338', 'combined:1311', 'combined:5018538', 'combined:5024405', 'combined:5023520',
    'combined:5004285', 'stiffness:5006867', 'fixed:5008754', 'fixed:5010054', 'fixed:5011195',
    'combined:2794', 'combined:5000292', 'combined:5002336', 'combined:5027441',
    'stiffness:996', 'combined:2597', 'combined:3314', 'control_period:5000120',
    'control_period:5002834', 'control_period:5006286', 'control_period:9001687',
    'combined:5003019', 'combined:5010932', 'combined:9008773'])
def test_former_failures_no_longer_occur(which):
    name, _, seed = which.partition(':')
    found = judge(name, int(seed))
    assert found.verdict != WRONG, found.why


@pytest.mark.slow
@pytest.mark.parametrize('seed', [5003954, 5002834])
def test_a_stable_loop_diverges_no_faster_than_its_growth_rate_allows(monkeypatch, seed):
    case, enough = make_case('control_period', seed), np.log(1.0 / judging.LOOP)
    assert is_stable(case.model.robot, case.tuning, 'drive', case.rate)
    assert judge('control_period', seed).verdict == CHAOTIC
    for share, verdict in ((1.01, CHAOTIC), (0.99, WRONG)):
        monkeypatch.setattr(judging, 'amplified', lambda *_, share=share: share * enough)
        assert judge('control_period', seed).verdict == verdict


def test_growth_accumulates_where_a_loop_slips_flies_or_swings():
    case = make_case('control_period', 5003954)
    robot, radius = case.model.robot, case.model.robot.ball_radius
    rolling = State(y=0.99 * radius, velocity_x=1.0, ball_rate=-1.0 / radius)
    slipping = rolling._replace(velocity_x=1.0 + 1.1 * robot.slip_threshold)
    for law, state, angle, rolls in (
            ('drive', rolling, 0.0, True), ('drive', slipping, 0.0, False),
            ('drive', rolling._replace(pendulum_angle=2.0), 2.0, True),
            ('hold', rolling._replace(pendulum_angle=2.0), 0.0, True),
            ('drive', rolling._replace(y=1.01 * radius), 0.0, False)):
        growth = growth_rate(robot, case.tuning, law, case.rate, 0, (angle,), rolls=rolls)
        assert judging.amplified(case, law, np.array([state, state])) == pytest.approx(
            2.0 * max(growth, 0.0) / case.rate)


def methods_asked(monkeypatch, altered):
    """Return the methods of the runs made for an accuracy; `altered` modifies each run."""
    scene, methods = load_scene('fig7_top'), []

    def watched(model, *rest):
        methods.append(model.solver.method)
        return altered(run_once(model, *rest), methods)
    monkeypatch.setattr('ballbot_ros.physics.simulation.run.run_once', watched)
    found = simulate(
        scene.model, scene.start, scene.actuation, 0.5, 0.01, accuracy=1e-4)
    assert found.assurance.complete and found.assurance.runs == len(methods)
    return methods


def test_excessive_growth_of_the_work_requires_an_even_finer_run(monkeypatch):
    # A finer tolerance takes twice the work; a factor of ten has another cause.
    def altered(run, methods):
        work = 1000 if len(methods) == 1 else 10_000
        return replace(run, effort=run.effort._replace(evaluations=work, events=0))
    assert methods_asked(monkeypatch, altered) == ['adaptive'] * 3
    assert methods_asked(monkeypatch, lambda run, _: replace(
        run, effort=run.effort._replace(evaluations=1000, events=0))) == ['adaptive'] * 2


def test_runs_with_different_events_are_confirmed_by_another_method(monkeypatch):
    # Two tolerances agreed to 0.9 um by chance, although both had an error of 9 um.
    def altered(run, methods):
        return replace(run, effort=run.effort._replace(events=len(methods), evaluations=1000))
    assert methods_asked(monkeypatch, altered) == ['adaptive', 'adaptive', 'implicit']


def test_after_one_disagreement_another_method_must_agree_twice(monkeypatch):
    def altered(run, methods):
        off = 0.01 if methods[-1] == 'implicit' and methods.count('implicit') == 1 else 0.0
        return replace(run, rows=run.rows + off, effort=run.effort._replace(
            events=len(methods), evaluations=1000))
    assert methods_asked(monkeypatch, altered) == ['adaptive', 'adaptive', 'implicit'] + 2 * [
        'adaptive', 'implicit']


def test_steps_that_are_stable_at_equilibrium_but_too_long_are_refused():
    found = judge('fixed', 1002)
    assert found.verdict == REFUSED and 'are stable, but the ball is' in found.why
    case = make_case('fixed', 1002)
    with pytest.raises(SimulationError) as caught:
        simulate(case.model, case.start, case.actuation, case.duration, case.output_step)
    assert caught.value.trajectory['time'][-1] == caught.value.time


def test_a_system_unstable_with_explicit_steps_is_simulated_implicitly(monkeypatch):
    case, tried = make_case('combined', 5000292), []

    def watched(model, *rest):
        tried.append(model.solver.method)
        run = run_once(model, *rest)
        if tried[-1] != 'implicit':
            error = out_of_balance(0.1, 0.2, model.solver)
            error.trajectory = run
            raise error
        return run
    monkeypatch.setattr('ballbot_ros.physics.simulation.run.run_once', watched)
    run = simulate(case.model, case.start, case.actuation, case.duration, 0.04)
    assert tried == ['adaptive', 'implicit'] and run.model is case.model
    alone = run_once(replace(case.model, solver=replace(
        case.model.solver, method='implicit')), case.start, case.actuation, case.duration, 0.04)
    assert (run.rows == alone.rows).all() and run.effort.steps > alone.effort.steps
    explicit = replace(case.model, solver=replace(case.model.solver, method='explicit'))
    with refused('unbalanced', 'tolerance', SimulationError):
        simulate(explicit, case.start, case.actuation, case.duration, 0.04)


def test_a_start_below_the_ground_is_refused_with_a_valid_height():
    model = Model(SHELLBALL, Terrain.slope(0.5), solver=Solver('adaptive'))
    with refused('out_of_range', 'y', SimulationError) as caught:
        simulate(model, State(x=0.2, y=-0.1), Actuation(), 0.1)
    height = float(caught.value.remedy.split('with y = ')[1].split()[0])
    simulate(model, State(x=0.2, y=height), Actuation(), 0.1)
    assert model.touches(State(x=0.2, y=height - 1e-6))
    assert not model.touches(State(x=0.2, y=height + 1e-6))


def test_too_soft_ground_is_refused_with_a_sufficient_stiffness():
    soft = replace(SHELLBALL, contact_stiffness=10.0)
    with refused('out_of_range', 'contact_stiffness') as caught:
        Model(soft, Terrain.flat()).at_rest(0.0)
    named = float(str(caught.value).split('raise contact_stiffness to ')[1].split()[0])
    state = Model(replace(soft, contact_stiffness=named), Terrain.flat()).at_rest(0.0)
    assert state.y == pytest.approx(0.97 * soft.ball_radius, rel=1e-3)


@pytest.mark.parametrize('height, side', [(0.02, -1.0), (-0.1, 1.0)])
def test_a_start_within_rounding_of_a_vertical_face_is_on_top_of_it(height, side):
    model = Model(SHELLBALL, Terrain.step(height, at=0.5))
    for distance in (1e-9, 1e-12, 1e-16):
        start = model.at_rest(0.5 + side * distance)
        assert start.y == pytest.approx(model.at_rest(0.5).y, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize('which', [
    'combined:28', 'stiffness:11', 'penetration:6', 'fixed:5', 'fixed:4', 'fixed:22', 'fixed:1002',
    'combined:530', 'vertices:62', 'combined:1141', 'combined:1424', 'vertices:139',
    'combined:456'])
def test_a_refusal_names_a_setting_that_makes_the_case_work(which):
    name, _, seed = which.partition(':')
    refused = refusal((name, int(seed)))
    assert refused is not None and remedy(refused).setting, refused
