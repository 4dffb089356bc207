# SPDX-License-Identifier: Apache-2.0
"""The fast search agrees with the reference search, and its error is an upper bound."""
from dataclasses import replace
import math
import threading
import warnings

from crossing_cases import crossing_of, ground_of
import numpy as np
import pytest
from reference_search import crosses, highest_step, terrain_of
from refusals import refused
from tiers import slow

from ballbot_ros.crossing import (
    cruising, held_at, max_step_height, max_step_heights, rolling, Rules, Site)
from ballbot_ros.crossing.attempt import attempt, Course, peak, place
from ballbot_ros.errors import SimulationError
from ballbot_ros.physics import (
    Actuation, ContactOptions, load_robot, Model, simulate, Solver, State, Terrain)
from ballbot_ros.physics.model.robot import Parameters
from ballbot_ros.physics.model.state import SIZE

GIMBALL, SHELLBALL = load_robot('gimball'), load_robot('shellball')
PARAMETERS = Parameters.of(GIMBALL, ContactOptions())
DRIVES = {
    'shellball free': (SHELLBALL, lambda _: Actuation()),
    'free': (GIMBALL, lambda _: Actuation()),
    'down': (GIMBALL, lambda _: held_at(0.0)),
    'level': (GIMBALL, lambda _: held_at(math.pi / 2)),
    'up': (GIMBALL, lambda _: held_at(math.pi)),
    'velocity': (GIMBALL, rolling(GIMBALL)),
    'voltage': (GIMBALL, cruising(GIMBALL))}
SITES = {
    'level': Site(), 'downhill': Site(slope_before=-0.1), 'uphill behind': Site(slope_behind=0.1),
    'roof': Site(slope_before=0.05, slope_behind=-0.2),
    'rough': Site(friction_before=0.5, friction_edge=0.4, friction_behind=0.6),
    'slippery edge': Site(friction_edge=0.02)}


@pytest.mark.parametrize('drive', [*slow(*list(DRIVES)[:-1]), *list(DRIVES)[-1:]])
def test_the_heights_agree_with_the_reference(drive):
    robot, law = DRIVES[drive]
    for speed in (0.25, 0.65, 1.1):
        found = max_step_height(robot, speed, law(speed), accuracy=1e-5)
        known = highest_step(robot, speed, law(speed), 2e-5)
        # The reference is the lower end of its bracket; its 0.1 ms steps add an error of 10 um.
        assert known - 1e-5 <= found.height + found.error
        assert found.height - found.error <= known + 2e-5 + 1e-5


@pytest.mark.slow
@pytest.mark.parametrize('site', SITES)
def test_the_heights_agree_with_the_reference_on_any_ground(site):
    for drive in ('free', 'velocity'):
        robot, law = DRIVES[drive]
        found = max_step_height(robot, 0.7, law(0.7), accuracy=1e-5, site=SITES[site])
        known = highest_step(robot, 0.7, law(0.7), 2e-5, site=SITES[site])
        assert found.height == pytest.approx(known + 1e-5, abs=3e-5)


@pytest.mark.parametrize('drive', DRIVES)
def test_a_stricter_search_stays_within_the_error(drive):
    robot, law = DRIVES[drive]
    speeds = np.linspace(0.2, 1.2, 6)
    exact = max_step_heights(robot, speeds, law, accuracy=1e-7)
    assert max(item.error for item in exact) <= 1e-7
    for accuracy in (1e-3, 5e-5, 2e-6):
        for found, best in zip(max_step_heights(robot, speeds, law, accuracy=accuracy), exact):
            assert found.error <= accuracy
            assert abs(found.height - best.height) <= found.error + best.error


def test_only_the_first_search_runs_in_the_thread_of_the_caller():
    """It may compile: Ctrl-C would not end the compilation of another thread."""
    threads = []

    def drive(speed):
        threads.append((speed, threading.get_ident()))
        return Actuation()
    max_step_heights('gimball', [0.3, 0.4, 0.5], drive, accuracy=1e-3)
    assert [thread == threading.get_ident() for _, thread in sorted(threads)] == [
        True, False, False]


def test_slopes_and_frictions_change_the_height_in_the_expected_direction():
    def height(**site):
        return max_step_height(GIMBALL, 0.7, site=Site(**site)).height
    plain = height()
    assert height(slope_before=-0.1) > plain > height(slope_before=0.1)
    # A ball has crossed when it has passed the edge; uphill it must also climb some slope.
    assert plain > height(slope_behind=0.3) + 5e-3
    assert height(slope_behind=-0.3) == pytest.approx(plain, abs=1e-4)
    assert height(friction_edge=0.5) > plain > height(friction_edge=0.02)
    # The friction of the robot, given explicitly.
    assert height(friction_before=0.22, friction_behind=0.22, friction_edge=0.144) == plain


@pytest.mark.slow
def test_attempts_without_a_motor_end_early_with_the_same_verdict():
    # A motor with zero torque gives the same motion but disables the energy criterion.
    for speed in (0.4, 0.9):
        threshold = max_step_height(GIMBALL, speed).height
        times = []
        for law in (Actuation(), Actuation('torque', torque=0.0)):
            crossing = crossing_of(GIMBALL, speed, law)
            ends = []
            for share in np.linspace(0.05, 2.5, 80):
                score, _ = attempt(share * threshold, 1e-8, crossing)
                ends.append((score > 0.0, crossing.last[0]))
            times.append(ends)
        free, driven = times
        assert [over for over, _ in free] == [over for over, _ in driven]
        assert sum(end for _, end in free) < 0.8 * sum(end for _, end in driven)


def test_the_ball_starts_at_its_first_touch_with_the_collision_speed():
    for before in (-0.3, 0.0, 0.4):
        for height in (0.003, 0.05, 0.2, 0.5):
            state = np.zeros(SIZE)
            touch_x = place(state, Course(0.8, 0.3, 0.0, 1.0, 5.0, 0.0), PARAMETERS,
                            ground_of(Site(slope_before=before), GIMBALL, height))
            start = State(0.0, *state)
            assert start.x == pytest.approx(touch_x, abs=1e-15)
            nearest = min(max(start.y, 0.0), height)
            assert math.hypot(start.x, start.y - nearest) == pytest.approx(0.226, rel=1e-12)
            assert math.hypot(start.velocity_x, start.velocity_y) == pytest.approx(0.8)
            assert math.atan2(start.velocity_y, start.velocity_x) == pytest.approx(before)
            model = Model(GIMBALL, terrain_of(Site(slope_before=before), height))
            # All contacts except the floor contact are at zero penetration within rounding.
            floor = max(model.touches(start), key=lambda touch: touch.penetration)
            assert floor.normal_force == pytest.approx(
                GIMBALL.weight * math.cos(before), rel=1e-9)
            assert floor.slip_velocity == pytest.approx(0.0, abs=1e-12)


@pytest.mark.slow
def test_the_verdict_agrees_with_a_complete_run():
    for height, over in ((0.015, True), (0.025, False)):
        score, _ = attempt(height, 1e-8, crossing_of(GIMBALL, 0.6))
        assert (score > 0.0) == over
        model = Model(GIMBALL, terrain_of(Site(), height),
                      solver=Solver('adaptive', tolerance=1e-8))
        start = np.zeros(SIZE)
        place(start, Rules().course(0.6, 0.0), PARAMETERS, model.profile)
        run = simulate(model, State(0.0, *start), Actuation(), 1.0)
        assert bool((run['x'] > 0.0).any()) == over


def test_integral_windup_may_let_a_later_attempt_succeed():
    law = rolling(GIMBALL)(0.2)
    first = max_step_height(GIMBALL, 0.2, law, scan=10)
    later = max_step_height(GIMBALL, 0.2, law, rules=Rules(attempts='any'))
    assert first.monotone and later.height > first.height + 4e-3
    between = 0.5 * (first.height + later.height)
    assert not crosses(GIMBALL, 0.2, between, law)
    assert crosses(GIMBALL, 0.2, between, law, rules=Rules(attempts='any'))


def test_a_bouncing_ball_whose_later_attempts_count_is_reported_as_not_monotone():
    rules = Rules(attempts='any', time_limit=3.0)
    assert max_step_height(SHELLBALL, 3.0, rules=rules, scan=40).monotone is False
    assert max_step_height(SHELLBALL, 1.2, scan=40).monotone is True
    assert max_step_height(SHELLBALL, 1.2).monotone is None


def test_a_ball_that_keeps_pressing_against_the_step_has_failed():
    crossing = crossing_of(
        GIMBALL, 0.05, held_at(math.pi / 2), rules=Rules(time_limit=1.0))
    score, _ = attempt(0.005, 1e-8, crossing)
    assert score < 0.0
    assert crossing.last[0] == pytest.approx(1.0)


def test_the_peak_of_a_parabola_is_exact():
    # x = v t - a t^2 / 2
    speed, deceleration, duration = 1.3, 9.0, 0.2
    end = speed * duration - 0.5 * deceleration * duration**2
    assert peak(0.0, speed, end, speed - deceleration * duration, duration) == pytest.approx(
        speed**2 / (2.0 * deceleration), rel=1e-12)
    assert peak(0.0, 1.0, 1.0, 1.0, 1.0) == 1.0
    assert peak(2.0, -1.0, 1.0, -1.0, 1.0) == 2.0


def test_the_number_of_threads_does_not_change_the_result():
    speeds = np.linspace(0.2, 1.2, 9)
    alone = max_step_heights(GIMBALL, speeds, rolling(GIMBALL), threads=1)
    assert max_step_heights(GIMBALL, speeds, rolling(GIMBALL), threads=4) == alone
    assert [item.speed for item in alone] == pytest.approx(list(speeds))


def test_the_cruising_voltage_rolls_the_ball_at_its_speed():
    model = Model(GIMBALL, terrain_of(Site(), 0.05))
    law = cruising(GIMBALL)(0.6)
    run = simulate(model, model.at_rest(-3.0, 0.6), law, 3.0)
    # The rolling radius is the radius less the penetration.
    rolled = 0.6 * (1.0 - GIMBALL.static_penetration / GIMBALL.ball_radius)
    assert np.mean(run['velocity_x'][-1000:]) == pytest.approx(rolled, rel=1e-3)


@pytest.mark.parametrize('change, reason, field', [
    ({'speed': 0.0}, 'out_of_range', 'speed'), ({'speed': math.nan}, 'not_finite', 'speed'),
    ({'accuracy': 1e-9}, 'out_of_range', 'accuracy'),
    ({'pendulum_angle': math.inf}, 'not_finite', 'pendulum_angle'),
    ({'scan': -1}, 'out_of_range', 'scan'),
    ({'robot': replace(SHELLBALL, gravity=0.0)}, 'out_of_range', 'gravity'),
    ({'speed': 60.0, 'site': Site(slope_before=1.3)}, 'out_of_range', 'speed')])
def test_impossible_searches_are_refused(change, reason, field):
    with refused(reason, field):
        max_step_height(**{'robot': GIMBALL, 'speed': 0.6, **change})


def test_a_failed_attempt_reports_time_and_reason():
    soft = replace(GIMBALL, contact_stiffness=300.0)
    with refused('penetrated', 'y', SimulationError):
        max_step_height(soft, 3.0)


@pytest.mark.parametrize('reason, field, value', [
    ('out_of_range', 'slope_before', 1.5), ('not_finite', 'slope_behind', math.nan),
    ('out_of_range', 'friction_edge', -0.1),
    *(('out_of_range', f'friction_{place}', 1e9) for place in ('before', 'edge', 'behind'))])
def test_impossible_sites_are_refused_by_name(reason, field, value):
    with refused(reason, field):
        Site(**{field: value})


@pytest.mark.parametrize('speed, warned', [(1.2, False), (4.0, True)])
def test_an_impact_too_fast_for_the_shell_warns_as_its_simulation_does(speed, warned):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter('always')
        height = max_step_height(GIMBALL, speed).height
    assert any('contact_stiffness' in str(item.message) for item in caught) == warned
    model = Model(GIMBALL, Terrain.step(height, at=1.0))
    run = simulate(model, model.at_rest(0.6, speed), Actuation(), 0.4)
    assert any('contact_stiffness' in words for words in run.summary().warnings) == warned
