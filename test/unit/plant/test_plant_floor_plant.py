# SPDX-License-Identifier: Apache-2.0
"""The robot on a floor: straight driving, steady turns, walls, and edges."""
from dataclasses import replace
import math

from hypothesis import assume, example, given, settings, strategies as st
import numpy as np
import pytest
from refusals import refused
from tiers import slow

from ballbot_ros.errors import SimulationError
from ballbot_ros.floors import Feature, Floor
from ballbot_ros.floors.floor import OCCUPIED
from ballbot_ros.physics import load_robot, load_scene, Terrain
from ballbot_ros.plant import FloorPlant, Plant
from ballbot_ros.steering import law, load_oblique_steps, steady_turn, yaw_rate_limit

ROBOT = load_robot('gimball')


def floor_of(*features, walls=(), size=16.0):
    cells = np.zeros((round(size / 0.0625),) * 2, np.uint8)
    for rows, columns in walls:
        cells[rows, columns] = OCCUPIED
    return Floor('test', cells, 0.0625, (0.0, 0.0),
                 tuple(Feature(**feature) for feature in features))


def torque_for(plant, speed):
    """Return the torque of a simple speed controller."""
    state = plant.state
    swing = min(max(1.2 * (speed - state.velocity_x), -0.9), 0.9)
    return 20.0 * (swing - state.pendulum_angle) - 2.0 * state.pendulum_rate


def drive(plant, speed, yaw_rate, seconds):
    """Drive and return one pose per control period."""
    poses = []
    for _ in range(round(seconds / plant.period)):
        lean = law(ROBOT, plant.lateral, plant.state.velocity_x, yaw_rate)
        plant.advance(torque_for(plant, speed), lean)
        poses.append(plant.pose)
    return np.array(poses)


def clearance(plant):
    """Return the distance of the ball from the nearest wall, negative inside it [m]."""
    walls = plant.floor.walls
    offset = plant.pose[:2] - walls[:, :2]
    offset -= np.clip(offset, -walls[:, 2:], walls[:, 2:])
    return np.hypot(*offset.T).min() - ROBOT.ball_radius


# Level 0 is that of the larger part of the floor, before the step.
STEP = {'kind': 'step', 'line': [[11.0, 16.0], [11.0, 0.0]], 'height': 0.02}


@pytest.mark.parametrize('line, pose', [
    (STEP['line'], (10.0, 8.0, 0.0)), ([[5.0, 0.0], [5.0, 16.0]], (6.0, 8.0, math.pi))])
def test_a_straight_drive_equals_the_planar_scene_exactly(line, pose):
    plant = FloorPlant(ROBOT, floor_of({**STEP, 'line': line}), pose)
    scene = load_scene('flat', ROBOT)
    scene = replace(scene, model=replace(
        scene.model, terrain=Terrain.step(0.02, at=1.0), solver=plant.model.solver))
    planar = Plant(scene, 500.0)
    for _ in range(1500):
        torque = torque_for(planar, 0.8)
        assert planar.advance(torque) == plant.advance(torque)
    assert planar.state.x > 1.1 and planar.state.y > 0.24
    assert plant.pose[0] == pytest.approx(pose[0] + math.cos(pose[2]) * planar.state.x)
    assert plant.pose[2] == pose[2]


@pytest.mark.slow
@pytest.mark.parametrize('speed, share', [(0.3, 0.9), (0.6, -0.7), (-0.4, 0.8)])
def test_a_steady_turn_has_the_requested_yaw_rate_and_radius(speed, share):
    plant = FloorPlant(ROBOT, floor_of(), (8.0, 8.0, 0.3))
    yaw_rate = share * yaw_rate_limit(ROBOT, speed)
    drive(plant, speed, yaw_rate, 6.0)
    poses = drive(plant, speed, yaw_rate, 4.0)
    turned = (poses[-1, 2] - poses[0, 2]) / (plant.period * (len(poses) - 1))
    true_speed = plant.state.velocity_x
    assert turned == pytest.approx(yaw_rate, rel=0.02)
    # Radius of the circle from the chord between the first and last point.
    radius = np.hypot(*np.diff(poses[[0, -1], :2], axis=0)[0]) / (
        2.0 * math.sin(0.5 * abs(poses[-1, 2] - poses[0, 2])))
    assert radius == pytest.approx(abs(true_speed / yaw_rate), rel=0.02)
    turn = steady_turn(ROBOT, true_speed, yaw_rate / true_speed)
    # The tilt differs by the vertical angular momentum from the start of the turn.
    swing = plant.lateral.lean - plant.lateral.tilt
    assert swing == pytest.approx(turn.lean - turn.tilt, rel=0.02)


@pytest.mark.slow
def test_a_yaw_rate_beyond_the_limit_is_limited():
    plant = FloorPlant(ROBOT, floor_of(), (8.0, 8.0, 0.0))
    drive(plant, 0.5, 3.0, 6.0)
    assert plant.lateral.yaw_rate == pytest.approx(
        yaw_rate_limit(ROBOT, plant.state.velocity_x), rel=0.02)


@pytest.mark.parametrize('degrees', [0.0, 20.0, 50.0, -35.0])
def test_a_ball_does_not_enter_a_wall(degrees):
    heading = math.radians(degrees)
    floor = floor_of(walls=[(slice(None), slice(160, 176))])
    plant = FloorPlant(ROBOT, floor, (9.0, 8.0, heading))
    poses = drive(plant, 0.5, 0.0, 4.0)
    assert poses[:, 0].max() < 10.0 - ROBOT.ball_radius + 0.01
    assert poses[:, 0].max() > 10.0 - ROBOT.ball_radius - 0.001
    assert not math.isfinite(plant.state.velocity_x) or abs(plant.state.velocity_x) < 0.5


@pytest.mark.slow
def test_a_ball_that_turns_along_a_wall_does_not_enter_it():
    floor = floor_of(walls=[(slice(160, 176), slice(None))])
    plant = FloorPlant(ROBOT, floor, (4.0, 9.6, 0.0))
    poses = np.vstack([drive(plant, 0.4, 0.2, 6.0), drive(plant, -0.4, 0.2, 6.0)])
    assert poses[:, 1].max() < 10.0 - ROBOT.ball_radius + 0.01


@pytest.mark.slow
@pytest.mark.parametrize('x, y', [(1.672, 2.14), (1.666, 2.163)])
def test_a_turning_ball_gains_no_speed_when_it_grazes_a_corner(x, y):
    cells = np.zeros((80, 80), np.uint8)
    cells[38:40, 38:40] = OCCUPIED
    floor = Floor('test', cells, 0.05, (0.0, 0.0), ())
    plant, gaps, speeds = FloorPlant(ROBOT, floor, (x, y, 0.5)), [], []
    for yaw_rate in (-0.24, 0.24):
        for _ in range(round(2.5 / plant.period)):
            lean = law(ROBOT, plant.lateral, plant.state.velocity_x, yaw_rate)
            plant.advance(torque_for(plant, 0.22), lean)
            speeds.append(abs(plant.state.velocity_x))
            gaps.append(clearance(plant))
    assert gaps[0] > 0.01 and -0.005 < min(gaps) < 0.0
    assert max(speeds) < 0.25


def test_a_turning_ball_climbs_a_step_and_stays_on_the_new_level():
    plant = FloorPlant(ROBOT, floor_of(STEP), (10.0, 8.0, 0.1))
    drive(plant, 0.9, 0.05, 3.5)
    assert plant.pose[0] > 11.5
    assert plant.level == 0.02
    assert plant.state.y == pytest.approx(0.02 + ROBOT.ball_radius - ROBOT.static_penetration,
                                          abs=1e-3)


@pytest.mark.slow
def test_a_turning_ball_rolls_on_the_floor_again_after_an_edge():
    cord = {'kind': 'cord', 'line': [[8.0, 4.0], [8.0, 12.0]], 'height': 0.006, 'width': 0.006}
    plant = FloorPlant(ROBOT, floor_of(cord), (7.5, 8.0, 0.1))
    drive(plant, 0.4, 0.1, 6.0)
    assert plant.pose[0] > 8.3
    assert plant.state.y == pytest.approx(ROBOT.ball_radius - ROBOT.static_penetration, abs=2e-4)


def test_backing_off_returns_to_the_start_and_a_run_up_crosses():
    high = {**STEP, 'height': 0.035}
    plant = FloorPlant(ROBOT, floor_of(high), (10.6, 8.0, 0.0))
    drive(plant, 0.5, 0.0, 2.0)
    assert plant.level == 0.0
    drive(plant, -0.5, 0.0, 4.0)
    assert plant.pose[0] < 10.0
    drive(plant, 1.1, 0.0, 5.0)
    assert plant.level == 0.035


@pytest.mark.parametrize('heading', [*slow(0.0, -0.9), 0.6])
def test_a_ball_rolls_off_a_drop_at_any_angle(heading):
    drop = {'kind': 'drop', 'line': [[10.0, 4.0], [10.0, 12.0]], 'height': 0.1}
    plant = FloorPlant(ROBOT, floor_of(drop), (9.6, 8.0, heading))
    drive(plant, 0.4, 0.0, 4.0)
    assert plant.level == -0.1 and plant.state.y < ROBOT.ball_radius - 0.09


@pytest.mark.slow
def test_the_course_change_at_an_edge_agrees_with_the_table():
    angle, height = math.radians(30.0), 0.015
    plant = FloorPlant(ROBOT, floor_of({**STEP, 'height': height}),
                       (9.5, 8.0, angle))
    poses = drive(plant, 0.9, 0.0, 4.0)
    over = poses[:, 0] > 11.0
    first = np.argmax(over)
    step = poses[first + 40] - poses[first + 20]
    course = math.degrees(math.atan2(step[1], step[0]) - angle)
    table = load_oblique_steps()
    assert (table.angles_deg[2], table.height_shares[0]) == (30, 0.5)
    assert 0.5 * table.lowest_course_change_deg[2][0] < course \
        < 1.5 * table.highest_course_change_deg[2][0]


def test_a_robot_without_steering_refuses_to_lean():
    plant = FloorPlant(load_robot('shellball'), floor_of(), (8.0, 8.0, 0.0))
    plant.advance(0.1)
    with refused('unsupported', 'steering'):
        plant.advance(0.1, 0.1)


@pytest.mark.parametrize('pose', [(math.nan, 1.0, 0.0), (-1.0, 1.0, 0.0), (1.0, 1.0, math.inf)])
def test_a_start_outside_the_map_is_refused(pose):
    with refused('out_of_range', 'pose'):
        FloorPlant(ROBOT, floor_of(), pose)


@pytest.mark.slow
def test_reset_and_put_restore_pose_and_ground():
    plant = FloorPlant(ROBOT, floor_of(STEP), (10.0, 8.0, 0.1))
    drive(plant, 0.9, 0.1, 2.5)
    first = plant.reset(time=True)
    assert plant.pose == (10.0, 8.0, 0.1)
    again = drive(plant, 0.9, 0.1, 2.5)
    plant.reset(time=True)
    assert np.array_equal(again, drive(plant, 0.9, 0.1, 2.5))
    plant.put(first._replace(y=first.y + 0.02), (12.0, 8.0, 0.0))
    assert plant.level == 0.02
    drive(plant, 0.3, 0.0, 0.5)
    assert plant.state.y > 0.24


def test_terrain_is_observed_along_the_heading():
    plant = FloorPlant(ROBOT, floor_of(STEP), (10.0, 8.0, 0.0))
    drive(plant, 0.3, 0.1, 1.0)
    x, _, heading = plant.pose
    ahead = (11.0 - x) / math.cos(heading)
    assert plant.profile().vertices[1, 0] == pytest.approx(plant.state.x + ahead)


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(st.sampled_from(['cord', 'threshold', 'step']), st.floats(-0.3, 0.3),
       st.floats(-0.2, 0.2), st.floats(-1.0, 1.0), st.floats(-0.3, 0.3))
@example('cord', 0.01, math.radians(10.0), 0.0, 0.0)
@example('cord', 0.01, math.radians(2.0), 0.0, 0.0)
@example('step', -0.015, 0.2, 0.0, 0.0)
@example('cord', 0.005, math.radians(0.5), 0.0, 0.0)
def test_a_ball_nearly_parallel_to_an_edge_gains_no_energy(kind, aside, turned, speed, lean):
    assume(aside == 0.0 or abs(aside) > 1e-9)  # a start within rounding of a face is refused
    feature = {'kind': kind, 'line': [[8.0, 4.0], [8.0, 12.0]], 'height': 0.02,
               **({} if kind == 'step' else {'width': 0.03})}
    plant = FloorPlant(ROBOT, floor_of(feature), (8.0 + aside, 8.0, 0.5 * math.pi + turned))
    plant.put(plant.state._replace(velocity_x=speed, ball_rate=-speed / ROBOT.ball_radius))
    first = plant.model.energies(plant.state).total
    for _ in range(150):
        plant.advance(0.0, lean)
        assert plant.model.energies(plant.state).total < first + 1e-6


@pytest.mark.parametrize('kind, aside, heading, speed, turns', [
    *slow(('step', -0.09, 0.0, 0.0, True), ('step', -0.02, 0.0, -0.1, True),
          ('step', 0.09, 0.0, 0.1, True), ('step', -0.02, 0.5 * math.pi, 0.1, False)),
    *slow(('threshold', -0.02, 0.0, -0.1, True)), ('threshold', 0.02, 0.0, 0.0, False)])
def test_a_turn_on_an_edge_adds_neither_energy_nor_penetration(
        monkeypatch, kind, aside, heading, speed, turns):
    monkeypatch.setattr(
        'ballbot_ros.plant.floor_plant.step', lambda robot, lateral, *rest: lateral._replace(
            yaw_rate=0.8, heading=lateral.heading + 0.8 * plant.period))
    # The floor rises towards +x.
    feature = {'kind': kind, 'line': [[8.0, 12.0], [8.0, 4.0]], 'height': 0.02,
               **({} if kind == 'step' else {'width': 0.03})}
    plant = FloorPlant(ROBOT, floor_of(feature), (8.0 + aside, 8.0, heading))
    plant.put(plant.state._replace(velocity_x=speed, ball_rate=-speed / ROBOT.ball_radius))
    first, deepest = plant.model.energies(plant.state).total, 0.0
    for _ in range(1000):
        plant.advance(0.0, 0.1)
        assert plant.model.energies(plant.state).total < first + 1e-6
        deepest = max(deepest, ROBOT.ball_radius - plant.state.y
                      + float(plant.profile().height(plant.state.x)))
    # The ball does not turn on the spot if its kinetic energy is insufficient for the turn.
    assert (plant.pose[2] - heading > 0.5 * math.pi) == turns
    assert deepest < 4.0 * ROBOT.static_penetration


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(st.tuples(st.floats(1.0, 3.5), st.floats(1.0, 2.3)), st.floats(-math.pi, math.pi),
       st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.booleans())
@example((1.672, 2.14), 0.5, 0.22, -0.24, True)
@example((2.0, 2.27), 0.0, 1.0, 1.0, False)
def test_a_turning_ball_at_walls_gains_no_energy_and_stays_outside(
        place, heading, speed, yaw_rate, driven):
    pillar, side = (slice(28, 30), slice(30, 32)), (slice(40, 44), slice(None))
    floor = floor_of(walls=[pillar, side, (slice(None), slice(64, 66))])
    plant = FloorPlant(ROBOT, floor, (*place, heading))
    assume(clearance(plant) > 0.0)
    plant.put(plant.state._replace(velocity_x=speed, ball_rate=-speed / ROBOT.ball_radius))
    first = plant.model.energies(plant.state).total
    for _ in range(400):
        lean = law(ROBOT, plant.lateral, plant.state.velocity_x, yaw_rate)
        plant.advance(torque_for(plant, speed) if driven else 0.0, lean)
        state = plant.state
        assert plant.model.energies(state).total - state.motor_work < first + 1e-6
        # The kinetic energy of ball and pendulum compresses the contact by up to 15 mm.
        assert clearance(plant) > -0.015


def test_an_excessive_tilt_ends_the_run_at_the_last_valid_state(monkeypatch):
    plant = FloorPlant(ROBOT, floor_of(), (8.0, 8.0, 0.0))
    monkeypatch.setattr('ballbot_ros.plant.floor_plant.step',
                        lambda robot, lateral, *rest: lateral._replace(tilt=math.pi))
    state, lateral, time = plant.state, plant.lateral, plant.time
    with pytest.raises(SimulationError) as found:
        plant.advance(0.5, 0.1)
    assert found.value.remedy and found.value.time == plant.time + plant.period
    assert (plant.state, plant.lateral, plant.time, plant.torque) == (state, lateral, time, 0.0)
