# SPDX-License-Identifier: Apache-2.0
"""Approaches: sampled by number, simulated, monitored by the true state, and stored."""
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
import json

import numpy as np
import pytest
from refusals import refused

from ballbot_ros.decision import Decision, Kind, nominal_knowledge, Reason
from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.plant import SensorFaults
from ballbot_ros.studies.evaluation.approaches import draw_approach, UNSEEN_ROOM
from ballbot_ros.studies.evaluation.closed_loop import ClosedLoop
from ballbot_ros.studies.evaluation.evaluation import (
    Evaluation, FOLDER, may_cross, run_evaluation, true_margin)
from ballbot_ros.studies.evaluation.outcome import OutcomeMonitor
from ballbot_ros.studies.evaluation.run import run_approach, run_with_log
from ballbot_ros.studies.evaluation.sensors import Camera, SensorModel, SimulatedSensor
from ballbot_ros.studies.evaluation.terrains import Ground, KINDS, true_faces

NOMINAL = nominal_knowledge()
SMALL = Evaluation((('cubic', 'drawn', 12),), sensor='step', kind='step')


def timeless(row):
    """Return a row as text, without the values that depend on the machine."""
    return json.dumps({name: value for name, value in row.items()
                       if not name.endswith('_ms') and name != 'cpu_s'})


def an_approach(*vertices, goal=float('inf'), speed=0.4):
    """Return an approach on a terrain, with an ideal sensor."""
    ground = Ground('', '', Terrain(vertices), 1.0, goal, 0.0)
    return replace(draw_approach(NOMINAL, 0, 0), robot=NOMINAL.robot,
                   ground=ground, sensor=SensorModel(), speed=speed, room_behind=0.0)


def judged(approach, kind, angle=0.0, distance=1.0, limit=8.0):
    """Return the verdict on a ball that rolls with a constant decision."""
    loop = ClosedLoop(approach.robot, approach.ground.terrain, NOMINAL.robot, NOMINAL.control,
                      approach.speed, 0.0)
    monitor = OutcomeMonitor(approach, loop, NOMINAL.tuning)
    while loop.time < limit:
        before, x = loop.time, loop.state.x
        loop.advance(angle, 10)
        decision = Decision(kind, Reason.COMMITTED, 0.4, '', distance=distance - x)
        if monitor.update(before, decision):
            break
    else:
        monitor.finish(loop.state)
    return monitor.verdict


@pytest.mark.parametrize('kind', KINDS)
def test_the_ball_can_roll_on_and_observe_each_kind_of_ground(kind):
    for number in range(5):
        approach = draw_approach(NOMINAL, 1, number, kind)
        ground = approach.ground
        loop = ClosedLoop(approach.robot, ground.terrain, NOMINAL.robot, NOMINAL.control,
                          approach.speed, 0.0)
        loop.advance(0.1, 10)
        assert -0.1 < loop.state.x < 0.1
        assert ground.foot > approach.robot.ball_radius
        model = replace(approach.sensor, faults=SensorFaults(), reordering=0.0)
        sensor = SimulatedSensor(ground.terrain, model, 0)
        sensor.sample(0, 0.0, 0.0, loop.state.y)
        assert len(sensor.arrived(0.0)) == 1


def test_an_approach_depends_only_on_its_seed_and_number():
    one = draw_approach(NOMINAL, 3, 7)
    draw_approach(NOMINAL, 3, 8)
    again = draw_approach(NOMINAL, 3, 7)
    other = draw_approach(NOMINAL, 4, 7)
    assert (one.description, one.robot, one.sensor) == (
        again.description, again.robot, again.sensor)
    assert one.robot != other.robot


def test_messages_arrive_after_the_latency_and_keep_their_stamp():
    model = SensorModel(faults=SensorFaults(latency=0.1))
    sensor = SimulatedSensor(Terrain.step(0.02, 1.0), model, 0)
    sensor.sample(0, 5.0, 0.0, 0.226)
    assert sensor.arrived(5.08) == []
    seen, = sensor.arrived(5.1)
    assert (seen.stamp, seen.distance, seen.height) == (5.0, 1.0, 0.02)
    assert sensor.arrived(5.2) == []


def test_a_ball_that_rolls_off_a_drop_without_crossing_it_fell():
    drop = an_approach([-9.0, 0.0], [0.5, 0.0], [0.5, -0.02], [9.0, -0.02])
    found = judged(drop, Kind.STOP)
    assert (found.outcome, found.depth) == ('fell', pytest.approx(0.02))
    assert judged(drop, Kind.CROSS, distance=0.5).outcome == 'over'
    deep = an_approach([-9.0, 0.0], [0.5, 0.0], [0.5, -0.2], [9.0, -0.2])
    assert judged(deep, Kind.CROSS, distance=0.5).outcome == 'fell'


def test_a_touched_face_is_a_hit_unless_the_decision_is_to_cross_it():
    step = an_approach([-9.0, 0.0], [0.6, 0.0], [0.6, 0.1], [9.0, 0.1])
    found = judged(step, Kind.STOP)
    assert found.outcome == 'hit' and 0.3 < found.hit_speed < 0.4
    # A decision to cross applies to the face at its distance only.
    assert judged(step, Kind.CROSS, distance=0.3).outcome == 'hit'
    attempt, = judged(step, Kind.CROSS, distance=0.6).attempts
    assert attempt.over is False
    assert judged(replace(step, speed=0.09), Kind.STOP, limit=12.0).outcome != 'hit'


def test_a_ball_past_the_goal_is_over_and_its_attempt_succeeded():
    step = an_approach([-9.0, 0.0], [0.6, 0.0], [0.6, 0.01], [9.0, 0.01], goal=0.6, speed=0.6)
    found = judged(step, Kind.CROSS, distance=0.6)
    assert found.outcome == 'over' and [one.over for one in found.attempts] == [True]


def test_a_ball_at_rest_has_stopped_with_its_gap():
    wall = an_approach([-9.0, 0.0], [0.6, 0.0], [0.6, 0.5], [9.0, 0.5], speed=0.0)
    found = judged(wall, Kind.STOP)
    assert found.outcome == 'stopped' and found.gap == pytest.approx(0.6 - 0.226, abs=1e-3)
    assert judged(wall, Kind.CROSS).outcome == 'idle'


def test_a_ball_that_rolls_back_over_unknown_ground_ran_away():
    flat = an_approach([-9.0, 0.0], [9.0, 0.0], speed=0.0)
    assert judged(flat, Kind.BACK_OFF, angle=-0.5).outcome == 'ran away'


def test_rolling_over_a_cord_is_not_a_fall():
    cord = an_approach([-9.0, 0.0], [0.5, 0.0], [0.5, 0.007], [0.51, 0.007], [0.51, 0.0],
                       [9.0, 0.0], goal=0.51, speed=0.6)
    found = judged(cord, Kind.CLEAR)
    assert (found.outcome, found.bumps) == ('over', 1)


def test_crossing_a_step_down_is_an_attempt():
    down = an_approach([-9.0, 0.0], [0.5, 0.0], [0.5, -0.02], [9.0, -0.02], goal=0.5)
    attempt, = judged(down, Kind.CROSS, distance=0.5).attempts
    assert attempt.over and attempt.face == 0.5


def test_granted_floor_exists_and_the_floor_behind_ends_at_the_stated_distance():
    granted = exact = 0
    for number in range(60):
        approach = draw_approach(NOMINAL, 2, number)
        ahead = [face for face in true_faces(approach.ground.terrain) if face[0] > 0.0]
        for before, after in zip(ahead, ahead[1:]):
            assert after[0] - before[0] - before[2] >= approach.unseen_room - 1e-6
        behind = [face for face in true_faces(approach.ground.terrain) if face[0] < 0.0]
        for face in behind:
            assert -face[0] == pytest.approx(
                max(approach.room_behind, NOMINAL.robot.ball_radius))
        granted += approach.unseen_room == UNSEEN_ROOM
        exact += bool(behind)
    assert granted > 10 and exact > 10


def camera_points(terrain, **numbers):
    """Return the points of a camera above the start."""
    found = Camera(terrain, SensorModel('camera', **numbers), 0).sample(0.0, 0.226, 0)
    return found[0], found[1]


def test_a_camera_samples_at_equal_angles_and_edges_occlude_the_floor():
    x, z = camera_points(Terrain([[-9.0, 0.0], [1.0, 0.0], [1.0, -0.2], [9.0, -0.2]]),
                         eye_height=0.2)
    angles = np.degrees(np.arctan2(z - 0.2, x))
    assert np.ptp(np.diff(angles)) < 1e-6
    on_floor, beyond = x < 1.0, x > 1.0
    assert np.allclose(z[on_floor], -0.226) and np.allclose(z[beyond], -0.426)
    assert x[beyond].min() > 1.4  # behind the floor that the edge occludes


def test_a_frozen_sensor_repeats_its_content_with_new_stamps():
    sensor = SimulatedSensor(Terrain.step(0.02, 1.0), SensorModel(frozen_from=0.05), 0)
    for number in range(6):
        sensor.sample(number, 0.02 * number, 0.1 * number, 0.226)
    found = sensor.arrived(1.0)
    assert [one.stamp for one in found] == pytest.approx([0.02 * number for number in range(6)])
    assert [one.distance for one in found] == pytest.approx([1.0, 0.9, 0.8, 0.8, 0.8, 0.8])


def test_reordered_messages_arrive_out_of_order():
    sensor = SimulatedSensor(Terrain.step(0.02, 1.0), SensorModel(reordering=0.2), 0)
    for number in range(30):
        sensor.sample(number, 0.02 * number, 0.0, 0.226)
    stamps = [one.stamp for one in sensor.arrived(2.0)]
    assert len(stamps) == 30 and stamps != sorted(stamps)


def test_outliers_are_gross_errors_of_some_points():
    sensor = SimulatedSensor(Terrain.flat(), SensorModel('terrain', outliers=0.1), 0)
    sensor.sample(0, 0.0, 0.0, 0.226)
    seen, = sensor.arrived(0.0)
    wrong = np.abs(np.array(seen.z) + 0.226) > 1e-6
    assert 0.02 < wrong.mean() < 0.25


@pytest.mark.slow
def test_an_evaluation_resumes_where_it_was_interrupted(tmp_path):
    with ThreadPoolExecutor(1) as pool:
        whole = run_evaluation(SMALL, tmp_path, pool, 1)
        first, _ = sorted((tmp_path / FOLDER).glob('cubic-*'))
        first.unlink()
        seen = []
        resumed = run_evaluation(SMALL, tmp_path, pool, 1, seen.append)
    assert seen == [2, 12]
    assert sorted(map(timeless, resumed)) == sorted(map(timeless, whole))


def test_a_folder_with_results_of_another_evaluation_is_refused(tmp_path):
    with ThreadPoolExecutor(1) as pool:
        run_evaluation(replace(SMALL, parts=(('cubic', 'drawn', 1),)), tmp_path, pool, 1)
        with refused('inconsistent', str(tmp_path / FOLDER)):
            run_evaluation(replace(SMALL, seed=1), tmp_path, pool, 1)
        (tmp_path / FOLDER / 'blocks.json').write_text('something else')
        with refused('unreadable'):
            run_evaluation(SMALL, tmp_path, pool, 1)


def test_the_log_contains_the_terrain_and_the_outcome():
    lines, row = run_with_log(SMALL.approach('drawn', 2), 'cubic', NOMINAL, 0.5)
    text = '\n'.join(lines)
    assert 'true faces' in text and row['outcome'] in text and 'approach 2 of seed 0' in text


def test_only_what_the_sensor_detects_and_the_tuning_permits_may_be_crossed():
    def may(approach, *sensor, unseen_room=1.0, **faults):
        return may_cross(replace(approach, sensor=SensorModel(*sensor, **faults),
                                 unseen_room=unseen_room), NOMINAL)
    step, ramp = (draw_approach(NOMINAL, 0, 0, kind) for kind in ('step', 'ramp'))
    assert may(step, 'terrain', unseen_room=0.0) and may(step, 'step') and may(ramp, 'terrain')
    assert not may(step, 'step', unseen_room=0.0) and not may(ramp, 'step')
    assert not may(step, 'terrain', frozen_from=2.0)
    most = NOMINAL.tuning.highest_descent
    for depth, allowed in ((most - 0.001, True), (most + 0.001, False)):
        down = an_approach((-9.0, 0.0), (1.0, 0.0), (1.0, -depth), (9.0, -depth))
        assert may(down, 'terrain') is allowed


@pytest.mark.parametrize('number', [10, 22])
def test_the_true_margin_of_a_crossed_step_is_not_negative(number):
    limits = (0.05, 0.008), (0.15, 0.0195), (0.3, 0.0303), (0.5, 0.0408)
    approach = Evaluation((), 6969, limits=limits).approach('crossable', number)
    attempt, = run_approach(approach, 'rollout', NOMINAL)['attempts']
    assert attempt['over'] and true_margin(approach, attempt, NOMINAL) >= 0.0
