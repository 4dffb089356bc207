# SPDX-License-Identifier: Apache-2.0
"""The summary of a run agrees with the run, and warns about questionable results."""
from dataclasses import replace
import json
import math

import numpy as np
import pytest

from ballbot_ros.physics import load_scene, Terrain
from ballbot_ros.physics.model.terrain import read_terrain
from ballbot_ros.physics.simulation.scene import read_scene
from ballbot_ros.results import report, summarise
from ballbot_ros.results.faces import rising_faces


def summary_of(name, **changes):
    scene = load_scene(name)
    scene = replace(scene, run=replace(scene.run, **changes))
    return summarise(scene.simulate(), 0.5)


def scene_of(**sections):
    return read_scene({'robot': 'gimball', 'duration': 0.5, **sections}, 'test', 'test')


def test_numbers_match_the_trajectory():
    scene = load_scene('fig7_bottom')
    run = scene.simulate()
    summary = summarise(run, 0.5)
    assert (summary.x, summary.y) == (run['x'][-1], run['y'][-1])
    assert summary.highest_speed >= summary.speed >= summary.lowest_speed
    assert summary.edge_normal_force == run['edge_normal_force'].max()
    assert summary.pendulum_torque == np.abs(run['pendulum_torque']).max()
    assert summary.samples == len(run) and summary.steps == run.effort.steps
    assert summary.real_time_factor == pytest.approx(summary.duration / 0.5)
    assert summary.complete and summary.energy_residual < 1e-5


def test_speed_at_the_touch_is_the_speed_before_the_impact():
    face, = summary_of('fig7_top').faces
    assert face.height == pytest.approx(0.021)
    # The 21 mm step at 0.76 m/s of the paper, less a small loss by rolling friction.
    assert 0.74 < face.touch_speed <= 0.76
    assert face.passed


@pytest.mark.parametrize('name, output_step, accuracy', [
    ('fig7_top', 0.1, None), ('fig7_top', 0.3, 1e-5), ('household', 0.05, None)])
def test_contacts_and_extremes_do_not_depend_on_the_output_step(name, output_step, accuracy):
    scene = load_scene(name)
    fine = scene.simulate(accuracy=accuracy, output_step=1e-3).summary()
    coarse = scene.simulate(accuracy=accuracy, output_step=output_step).summary()
    assert coarse.samples < fine.samples and coarse.landings == fine.landings
    for one, other in zip(coarse.faces, fine.faces):
        assert one.passed == other.passed
        assert one.touch_time == pytest.approx(other.touch_time, abs=1.1e-3)
        assert one.touch_speed == pytest.approx(other.touch_speed, rel=2e-3)
    for number in ('highest_speed', 'edge_normal_force', 'surface_normal_force', 'penetration',
                   'pendulum_torque', 'flight_fraction'):
        assert getattr(coarse, number) == pytest.approx(getattr(fine, number), rel=0.02, abs=1e-3)


def test_a_step_that_reflects_the_ball_is_not_passed():
    scene = scene_of(terrain=[{'flat': {'length': 1.0}}, {'step': {'height': 0.09}},
                              {'flat': {'length': 1.0}}], initial={'x': 0.6, 'speed': 0.5})
    face, = summarise(scene.simulate()).faces
    assert 0.3 < face.touch_speed < 0.5 and not face.passed


def test_a_step_out_of_reach_was_not_touched():
    face, = summary_of('voltage_start', duration=0.5).faces
    assert face.touch_time is None and face.touch_speed is None and not face.passed


def test_rolling_down_a_step_is_not_a_contact_with_its_face():
    scene = scene_of(terrain=[{'flat': {'length': 1.0}}, {'step': {'height': 0.05}},
                              {'flat': {'length': 1.0}}], initial={'x': 1.2, 'speed': -0.8})
    face, = summarise(scene.simulate()).faces
    assert face.touch_time is None


@pytest.mark.parametrize('piece, heights', [
    ({'step': {'height': 0.03}}, [0.03]), ({'step': {'height': -0.03}}, []),
    ({'step': {'height': 0.0009}}, []), ({'slope': {'length': 1.0, 'angle_deg': 20.0}}, []),
    ({'cord': {'diameter': 0.008}}, [None]),
    ({'carpet': {'thickness': 0.006, 'length': 0.5}}, [0.006]),
    ({'threshold': {'height': 0.01, 'width': 0.06, 'bevel': 0.015}}, [0.01])])
def test_faces_are_obstacles_that_a_ball_hits_and_no_slopes(piece, heights):
    terrain = read_terrain([{'flat': {'length': 1.0}}, piece, {'flat': {'length': 1.0}}], 'here')
    found = [face[-1, 1] - face[0, 1] for face in rising_faces(terrain, 0.226)]
    expected = [terrain.vertices[:, 1].max() if height is None else height
                for height in heights]
    assert found == pytest.approx(expected)


def test_infinite_ends_of_a_terrain_are_not_faces():
    assert rising_faces(Terrain.slope(1.2), 0.226) == []


def test_a_robot_without_a_pendulum_has_no_pendulum_numbers():
    summary = summary_of('shellball_drop')
    assert summary.pendulum_angle is None and summary.pendulum_torque is None
    assert summary.landings > 3 and 0.3 < summary.flight_fraction < 0.8
    assert 'pendulum' not in report(summary)


@pytest.mark.parametrize('scene', ['fig7_bottom', 'shellball_drop', 'flat'])
def test_json_holds_finite_numbers_or_null_only(scene):
    def refuse(word):
        raise AssertionError(word)
    content = json.loads(json.dumps(summary_of(scene).to_dict()), parse_constant=refuse)
    assert content['robot'] and content['wall_time'] == 0.5


def test_a_number_that_is_not_finite_becomes_null_and_a_warning():
    scene = load_scene('fig7_top')
    run = scene.simulate()
    rows = run.rows.copy()
    rows[-1, 3] = math.nan
    summary = summarise(replace(run, rows=rows))
    assert summary.to_dict()['x'] is None
    assert any('not finite' in warning for warning in summary.warnings)


def test_a_normal_run_has_no_warnings():
    assert summary_of('fig7_bottom').warnings == ()


@pytest.mark.parametrize('sections, warning', [
    ({'initial': {'y': 0.6}, 'solver': {'step': 1e-3}}, 'use a smaller step than 0.001 s'),
    ({'initial': {'velocity_x': 2.0, 'ball_rate': 100.0}, 'duration': 0.2}, 'slid for 100%'),
    ({'initial': {'y': 1.0}, 'robot_changes': {'contact_stiffness': 3000.0}},
     'contact_stiffness is too low'),
    ({}, 'nothing moved')])
def test_a_questionable_run_causes_a_warning(sections, warning):
    summary = summarise(scene_of(**sections).simulate())
    assert any(warning in text for text in summary.warnings)


def test_an_early_end_is_reported():
    scene = load_scene('fig7_top')
    run = scene.simulate()
    summary = summarise(replace(run, rows=run.rows[:600]))
    assert not summary.complete and 'ended early' in report(summary)


def test_the_text_is_aligned():
    lines = report(summary_of('household')).split('\n\n')
    labels, table = lines[0].splitlines(), lines[1].splitlines()
    column = labels[0].index('household')
    assert all(line[column - 1] == ' ' and line[column] != ' ' for line in labels)
    assert len(table) == 4 and all(line.endswith(('passed', 'yes')) for line in table)
    assert max(map(len, labels + table)) <= 88
