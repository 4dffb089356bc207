# SPDX-License-Identifier: Apache-2.0
"""The same loop on the full model, with impact and slip, and odometry from the ball angle."""
import pytest

from ballbot_ros.control import JointReadings, load_tuning, PendulumController, SetPoint
from ballbot_ros.decision import (
    decide, Kind, load_curve, load_decision_tuning, Motion, set_angle, StepObservation,
    StepTracker)
from ballbot_ros.physics.model.parameters import Actuator, TORQUE
from ballbot_ros.physics.model.robot import load_robot
from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.physics.simulation.model import Model
from ballbot_ros.physics.simulation.solver import Solver

GIMBALL = load_robot('gimball')
CURVE = load_curve('gimball_down')
TUNING = load_decision_tuning('decision_default')


def drive(height, face, seconds=5.0):
    """Return the last state and the decisions; torque acts one millisecond late."""
    model = Model(GIMBALL, Terrain.step(height, at=face), solver=Solver(step=5e-4))
    controller = PendulumController(GIMBALL, load_tuning('published'))
    tracker = StepTracker(GIMBALL, TUNING)
    state, torque, decisions = model.at_rest(0.0), 0.0, []
    for index in range(int(seconds * 1000)):
        now = index / 1000
        if index % 20 == 0:
            x, v = (-GIMBALL.ball_radius * number
                    for number in (state.ball_angle, state.ball_rate))
            ahead = face - state.x
            seen = (StepObservation(now, True, ahead, height, 0.005, 0.0005) if ahead > 0.0
                    else StepObservation(now, False))
            decisions.append(decide(
                tracker.update(seen, x), Motion(now, x, v),
                decisions[-1] if decisions else None, robot=GIMBALL, curve=CURVE,
                tuning=TUNING))
            controller.give(SetPoint('hold', set_angle(decisions[-1], v, GIMBALL, TUNING), now))
        late, torque = torque, controller.torque(JointReadings(
            now, state.ball_angle, state.joint_angle, state.ball_rate, state.joint_rate))
        state = model.advance(state, Actuator(TORQUE, late, limit=10.0), 2)
    return state, decisions


@pytest.mark.parametrize('height, face', [(0.031, 1.2), (0.010, 0.6)])
def test_what_it_decides_to_cross_it_gets_over(height, face):
    state, decisions = drive(height, face)
    kinds = [item.kind for item in decisions]
    assert kinds[0] is Kind.CROSS and kinds[-1] is Kind.CLEAR
    assert sorted(kinds, key=list(Kind).index, reverse=True) == kinds   # never in doubt
    assert state.x > face + 0.3
    assert state.y == pytest.approx(GIMBALL.ball_radius + height, abs=0.005)


def test_what_it_does_not_cross_it_does_not_touch():
    state, decisions = drive(0.080, 1.2)
    assert {item.kind for item in decisions} == {Kind.GO_ROUND}
    assert abs(state.velocity_x) < 0.01
    assert 0.1 < 1.2 - state.x - GIMBALL.ball_radius < 0.35
