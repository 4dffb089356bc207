# SPDX-License-Identifier: Apache-2.0
"""Closed loop with the full model, with impact and slip, and odometry from the ball angle."""
from dataclasses import replace
import math

import pytest
from tiers import slow

from ballbot_ros.control import JointReadings, load_tuning, PendulumController, SetPoint
from ballbot_ros.decision import (
    Decider, Kind, Knowledge, load_curve, load_decision_tuning, Motion, Reason, StepObservation)
from ballbot_ros.physics import load_scene
from ballbot_ros.physics.model.robot import load_robot
from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.physics.simulation.solver import Solver
from ballbot_ros.plant import Plant

GIMBALL = load_robot('gimball')
TUNING = replace(load_decision_tuning('decision_default'), unseen_room=1.0)
KNOWN = Knowledge(GIMBALL, load_curve('gimball_down'), TUNING)


def sloped(height, at, slope):
    """Return a slope with a step."""
    far, rise = 20.0, math.tan(slope)
    return Terrain([[-far, -(far + at) * rise], [at, 0.0], [at, height],
                    [far, height + (far - at) * rise]])


def drive(height, face, *, seconds=8.0, speed=0.0, slope=0.0, reported=None, latency=0.0,
          far_behind=0.0):
    """Return the final state, and rows (time, x, speed) and decisions at 50 Hz."""
    scene = load_scene('flat')
    model = replace(scene.model, terrain=sloped(height, face, slope), solver=Solver(step=5e-4))
    start = model.at_rest(-far_behind)
    if speed:
        start = start._replace(velocity_x=speed * math.cos(slope),
                               velocity_y=speed * math.sin(slope),
                               ball_rate=-speed / GIMBALL.ball_radius)
    plant = Plant(replace(scene, model=model), 1000.0)
    plant.state = start
    controller, decider = PendulumController(GIMBALL, load_tuning('published')), Decider(KNOWN)
    rows, decisions, underway = [], [], []
    for index in range(int(seconds * 1000)):
        now, state = index / 1000, plant.state
        if index % 20 == 0:
            turned = -GIMBALL.ball_radius * (state.ball_angle - start.ball_angle)
            x, v = start.x + turned, -GIMBALL.ball_radius * state.ball_rate
            ahead = face - state.x
            underway.append(
                StepObservation(now, True, ahead, height if reported is None else reported, 0.005,
                                5e-4)
                if ahead > 0.0 else StepObservation(now, False))
            while underway and underway[0].stamp <= now - latency:
                decider.observe(underway.pop(0))
            decider.move(Motion(now, x, v))
            _, decision, angle = decider.decide()
            controller.give(SetPoint('hold', angle, now))
            decisions.append(decision)
            rows.append((now, state.x, state.velocity_x))
        plant.advance(controller.torque(JointReadings(
            now, state.ball_angle, state.joint_angle, state.ball_rate, state.joint_rate)))
    return plant.state, rows, decisions


def changes(decisions):
    """Return the number of decision changes before the face is passed."""
    kinds = [decision.kind for decision in decisions if decision.kind is not Kind.CLEAR]
    return sum(one is not other for one, other in zip(kinds, kinds[1:]))


@pytest.mark.parametrize('height, face, latency', [
    *slow((0.031, 1.2, 0.0), (0.010, 0.6, 0.0)), (0.020, 1.5, 0.5)])
def test_a_step_is_crossed_as_decided(height, face, latency):
    state, rows, decisions = drive(height, face, latency=latency)
    kinds = [item.kind for item in decisions if item.reason is not Reason.STALE]
    assert Kind.CROSS in kinds and kinds[-1] is Kind.CLEAR
    assert changes(decisions) == (1 if latency else 0)   # STALE before the first observation
    assert state.x > face + 0.3
    assert state.y == pytest.approx(GIMBALL.ball_radius + height, abs=0.005)


@pytest.mark.parametrize('height, face, speed, slope', [
    *slow((0.080, 1.2, 0.0, 0.0), (0.080, 2.0, 0.4, -2.0), (-0.100, 1.5, 0.4, -0.5),
          (-0.100, 2.0, 0.4, -3.0), (-0.100, 1.5, 0.4, 3.0)), (0.300, 1.5, 0.4, -1.0)])
def test_the_ball_stops_with_the_gap_before_a_refused_step(height, face, speed, slope):
    state, rows, decisions = drive(height, face, speed=speed, slope=math.radians(slope),
                                   seconds=12.0)
    assert {item.kind for item in decisions} <= {Kind.GO_ROUND, Kind.STOP}
    assert abs(state.velocity_x) < 0.05
    gap = face - state.x - GIMBALL.ball_radius
    assert gap == pytest.approx(TUNING.stop_gap, abs=0.06)
    assert min(face - x - GIMBALL.ball_radius for _, x, _ in rows) > TUNING.stop_gap - 0.08


def test_a_negative_braking_room_predicts_a_fall():
    # The ball cruises at 0.9 m/s when the sensor first reports the drop.
    for more, falls in ((0.15, False), (-0.6, True)):
        room = 1.0 + more
        state, rows, decisions = drive(-0.1, room, speed=0.9, seconds=4.0)
        assert decisions[0].kind is Kind.STOP
        assert (decisions[0].outlook.braking_room > 0.0) is not falls
        assert (state.y < GIMBALL.ball_radius - 0.02) is falls
