# SPDX-License-Identifier: Apache-2.0
"""Rollouts agree with the plant in closed loop; the predictions of plans depend on it."""
from dataclasses import replace
import math

import numpy as np
import pytest

from ballbot_ros.control.rolling_model import RollingModel
from ballbot_ros.control.speed_law import speed_law_start
from ballbot_ros.crossing.rules import CLEARANCE
from ballbot_ros.decision import (
    Face, Knowledge, load_curve, load_decision_tuning, Motion, Profile, Situation)
from ballbot_ros.decision.execution.pilot import Order, pilot_step
from ballbot_ros.decision.planning.ahead import Candidate, look_ahead
from ballbot_ros.decision.planning.face_planner import Choice, go
from ballbot_ros.decision.planning.rollout.rollout import (
    CONTINUES, CORNER_FRICTION, DRAW, Drive, EDGE, FALLS, fill_ground, FLOOR_FRICTION, HEIGHT,
    OVER, PLACE, REST, ROBOT, roll, Rolling, SPEED, STUCK, SWING_ANGLE, SWING_AT, TOUCH_ANGLE,
    TOUCH_SPEED, VERDICT)
from ballbot_ros.decision.planning.rollout.search import plan_row
from ballbot_ros.decision.planning.rollout.worlds import Worlds
from ballbot_ros.decision.values import After, Reason, Strategy
from ballbot_ros.physics.model.actuation import Actuation, limited, position_torque
from ballbot_ros.physics.model.robot import ContactOptions, load_robot, Parameters
from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.physics.model.uncertainty import draw
from ballbot_ros.physics.simulation.model import Model
from ballbot_ros.physics.simulation.scene import Initial, Run, Scene
from ballbot_ros.physics.simulation.solver import Solver
from ballbot_ros.plant.plant import Plant

GIMBALL = load_robot('gimball')
TUNING = replace(load_decision_tuning('decision_default'), unseen_room=1.0)
KNOWLEDGE = Knowledge(GIMBALL, load_curve('gimball_down'), TUNING)
WORLDS = Worlds(KNOWLEDGE)
RADIUS = GIMBALL.ball_radius


def world(robot):
    """Return the world without errors of the observed terrain, with a given robot."""
    row = np.zeros((1, DRAW))
    row[0, :ROBOT] = Parameters.of(robot, ContactOptions())
    row[0, FLOOR_FRICTION], row[0, CORNER_FRICTION] = robot.surface_friction, robot.edge_friction
    return row


def ahead_of(position, *faces, slope=0.0, points=()):
    profile = Profile(0.0, faces, points, seen_to=max([4.0, *(x for x, _ in points)]))
    return look_ahead(Situation(Motion(0.0, position, 0.0, slope=slope), profile), faces, RADIUS,
                      TUNING)


def rolled_out(robot, height, position, speed, candidate):
    """Return the row of a plan and its result by the kernel: verdict, speed and angle at touch."""
    ahead = ahead_of(position, Face(1, 0.0, height, 0.0, 0.0))
    row = plan_row(candidate, ahead)
    result = WORLDS.attempt(
        (position, speed, 0.0, 0.0), [row], world(robot), ahead)[0, 0]
    return row, result


@pytest.mark.parametrize('gap, after', [(1.4, After.STOP), (1.6, After.CRUISE)])
def test_a_rollout_stops_behind_the_edge_if_the_plan_does(gap, after):
    ahead = ahead_of(-1.0, Face(1, 0.0, 0.02, 0.0, 0.0), Face(2, gap + RADIUS, 0.02, 0.0, 0.0))
    candidate = Candidate(Strategy.ACCELERATE, 0.8)
    executed = go(Choice(candidate, Reason.LIKELY), candidate, ahead, Motion(0.0, -1.0, 0.0),
                  TUNING)
    assert executed.plan.after is after
    assert plan_row(candidate, ahead)[CONTINUES] == (after is After.CRUISE)


def driven(robot, height, position, speed, row):
    """Return verdict and state at touch by the plant, with control at 500 Hz, pilot at 50 Hz."""
    model = Model(robot, Terrain([[-9.0, 0.0], [0.0, 0.0], [0.0, height], [9.0, height]]),
                  solver=Solver('rk4', step=1e-3))
    scene = Scene('', model, Initial(x=position, speed=speed), Actuation(), Run(duration=1.0))
    plant = Plant(scene, 500.0)
    law = Drive(*WORLDS._drive).law
    state, touched = speed_law_start(speed, 0.0, 0.0, law), None
    order = Order(TUNING.largest_lean, TUNING.emergency_lean, TUNING.reaction_time,
                  forward=row[SPEED], swing=row[SWING_AT], swing_angle=row[SWING_ANGLE],
                  edge=row[EDGE], after=min(row[SPEED], TUNING.cruise_speed))[:]
    for period in range(6000):
        now = plant.state
        if period % 10 == 0:
            state, angle = pilot_step(
                state, now.x, now.velocity_x, order, 0.02, law)
        asked = position_torque(now.pendulum_angle, now.pendulum_rate, angle, 40.0, 10.0,
                                GIMBALL.largest_gravity_torque)
        now = plant.advance(limited(asked, 4.0))
        if touched is None and any(one.x >= -1e-6 for one in model.touches(now)):
            touched = now
        if now.x > CLEARANCE * RADIUS and now.y > height + 0.5 * RADIUS:
            return OVER, touched
        if touched is not None and (
                now.velocity_x < 0.0 and now.x < touched.x - 0.004
                or plant.time > touched.time + 3.0):
            break
    return STUCK, touched


@pytest.mark.slow
def test_verdicts_and_speeds_are_those_of_the_plant_in_closed_loop():
    random = np.random.default_rng(7)
    robots = draw(GIMBALL, 16, seed=1)
    same, speeds, angles = 0, [], []
    for number in range(60):
        robot, height = robots[number % 16], random.uniform(0.01, 0.06)
        position, speed = -random.uniform(0.5, 1.6), random.choice([0.0, 0.2, 0.4])
        swing = random.uniform(0.05, 0.7) if random.random() < 0.7 else -math.inf
        candidate = Candidate(Strategy.SWING, random.uniform(0.3, 1.1), swing,
                              random.uniform(-0.5, 2.5))
        row, result = rolled_out(robot, height, position, speed, candidate)
        verdict, touched = driven(robot, height, position, speed, row)
        same += verdict == result[VERDICT] or (verdict == OVER and result[VERDICT] == FALLS)
        if touched is not None:
            speeds.append(result[TOUCH_SPEED] - touched.velocity_x)
            angles.append(result[TOUCH_ANGLE] - touched.pendulum_angle)
    assert same >= 59
    # The pilot acts every 20 ms, during which the ball moves by several mm.
    assert len(speeds) > 50 and np.quantile(np.abs(speeds), 0.9) < 0.012
    assert abs(np.mean(speeds)) < 0.006 and np.quantile(np.abs(angles), 0.9) < 0.04


def rolling(angle, seconds, slope=0.0, speed=0.0, step=0.01, start=0.0):
    robot = Parameters.of(GIMBALL, ContactOptions())
    now, drive = Rolling(0.0, speed, start, 0.0), Drive(*WORLDS._drive)
    for _ in range(round(seconds / step)):
        now = Rolling(*roll(now, angle, slope, step, robot, drive))
    return now


def test_a_held_pendulum_accelerates_the_ball_as_in_the_rolling_model():
    before, after = rolling(0.5, 2.0, start=0.5), rolling(0.5, 2.2, start=0.5)
    model = RollingModel(GIMBALL)
    # Friction of ball and joint reduces the acceleration, more at a higher speed.
    torque = (GIMBALL.rolling_friction + GIMBALL.joint_friction) * after.speed / RADIUS
    lost = torque / RADIUS / (GIMBALL.total_mass + GIMBALL.ball_inertia / RADIUS**2)
    gained = (after.speed - before.speed) / 0.2
    assert after.speed > 0.5
    assert model.held_acceleration(after.angle) - 1.1 * lost < gained
    assert gained < model.held_acceleration(after.angle)


def test_a_ball_rests_on_a_slope_that_its_pendulum_balances():
    slope = math.radians(2.0)
    lever = GIMBALL.pendulum_mass * GIMBALL.pendulum_length
    radius = RADIUS - GIMBALL.static_penetration
    holding = math.asin(GIMBALL.total_mass * radius * math.sin(slope) / lever)
    assert abs(rolling(holding, 3.0, slope, start=holding).speed) < 0.02
    assert rolling(0.0, 3.0, slope).speed < -0.3


def test_a_longer_step_of_the_rolling_model_changes_little():
    coarse, fine = rolling(0.7, 2.0), rolling(0.7, 2.0, step=0.0005)
    assert coarse.speed == pytest.approx(fine.speed, abs=0.006)
    assert coarse.position == pytest.approx(fine.position, abs=0.01)


def test_the_ground_of_a_world_is_the_terrain_with_sampled_errors():
    ahead = ahead_of(-1.0, Face(1, 0.0, 0.03, 0.0, 0.0), Face(2, 0.4, 0.02, 0.0, 0.0, 0.01))
    row = world(GIMBALL)[0]
    row[HEIGHT], row[HEIGHT + 1], row[PLACE] = 0.002, -0.004, 0.05
    ground = np.zeros((len(ahead.shape), 7))
    fill_ground(ahead.shape, row, 0.001, -1.0, ground)
    xs, ys = ground[:, 0], ground[:, 1]
    assert ys[[1, 2, 3, 4]] == pytest.approx([0.0, 0.033, 0.033, 0.049])
    assert xs[[1, 2, 3, 4]] == pytest.approx([0.05, 0.05, 0.4, 0.41])
    expected = Terrain(ground[:, :2]).profile(GIMBALL.surface_friction, GIMBALL.edge_friction)
    assert ground[:, :5] == pytest.approx(expected[:, :5])
    assert ground[:-1, 5:] == pytest.approx(expected[:-1, 5:])


def test_a_drop_too_near_behind_the_edge_is_a_fall():
    gentle = Candidate(Strategy.SWING, 0.6, 0.2, 1.5)
    results = []
    for room in (0.25, 2.5):
        ahead = ahead_of(-1.2, Face(1, 0.0, 0.02, 0.0, 0.0), Face(2, room, -0.1, 0.0, 0.0))
        results.append(WORLDS.attempt(
            (-1.2, 0.4, 0.0, 0.0), [plan_row(gentle, ahead)], world(GIMBALL), ahead)[0, 0])
    assert [result[VERDICT] for result in results] == [FALLS, OVER]
    assert 0.2 < results[1][REST] < 2.0


def test_the_simulated_stop_on_a_slope_that_is_too_steep_ends_with_the_ground():
    ahead = ahead_of(-1.2, Face(1, 0.0, -0.02, 0.0, 0.0), slope=-0.2)
    plan = plan_row(Candidate(Strategy.CRUISE, 0.4), ahead)
    result = WORLDS.attempt((-1.2, 0.4, 0.0, 0.0), [plan], world(GIMBALL), ahead)[0, 0]
    assert ahead.room_to < ahead.shape[-1, 0] <= result[REST] < ahead.shape[-1, 0] + 0.1


def test_a_plan_carries_the_ball_over_two_edges():
    ahead = ahead_of(-1.4, Face(1, 0.0, 0.015, 0.0, 0.0), Face(2, 0.3, 0.015, 0.0, 0.0))
    assert [end.faces for end in ahead.ends] == [1, 2]
    start, robot = (-1.4, 0.4, 0.0, 0.0), world(GIMBALL)
    carry = Candidate(Strategy.CARRY, 0.8, 0.2, 1.5, length=0.3)
    weak = Candidate(Strategy.CARRY, 0.4, length=0.3)
    rows = [plan_row(carry, ahead), plan_row(weak, ahead)]
    verdicts = WORLDS.attempt(start, rows, robot, ahead)[:, 0, 0]
    assert verdicts.tolist() == [OVER, STUCK]


def test_unevenness_behind_the_edge_is_not_a_fall():
    points = ((-4.0, 0.0), (0.0, 0.0), (0.0, 0.012), (0.2, 0.012), (0.201, 0.0165), (3.0, 0.0165))
    ahead = ahead_of(-1.2, Face(1, 0.0, 0.012, 0.0, 0.0), points=points)
    plan = plan_row(Candidate(Strategy.SWING, 0.5, 0.2, 1.5), ahead)
    result = WORLDS.attempt((-1.2, 0.4, 0.0, 0.0), [plan], world(GIMBALL), ahead)[0, 0]
    assert len(ahead.shape) > 4 and result[VERDICT] == OVER and result[REST] > 0.2
