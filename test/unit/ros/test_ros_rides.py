# SPDX-License-Identifier: Apache-2.0
"""
Simulator, controller and decision in lockstep over real topics, all in the process of the test.

In each case, a decision from the next step and its height curve alone would damage the robot.
"""
import math

import pytest
from rclpy.node import Node
from rclpy.qos import QoSProfile
import yaml

from ballbot_ros.msg import BallState, StepDecision
from ballbot_ros.nodes.controller.node import Controller
from ballbot_ros.nodes.obstacle_decision.node import ObstacleDecision
from ballbot_ros.nodes.simulator.node import Simulator
from ballbot_ros.ros.conversions import to_seconds

pytestmark = pytest.mark.slow

RADIUS = 0.226
STOPPED = 0.02  # at rest below this speed [m/s]
HIT = 0.1  # collision with an obstacle above this speed [m/s]
SEES_STEPS = {'observation_rate': 50.0, 'terrain_rate': 0.0}
SEES_TERRAIN = {'observation_rate': 0.0, 'terrain_rate': 50.0}


class Ride:
    """The messages that a run published."""

    def __init__(self, states, decisions):
        self.states, self.decisions = states, decisions

    @property
    def x(self):
        return [state.x for state in self.states]

    @property
    def kinds(self):
        return {message.decision for message in self.decisions}

    @property
    def decision_changes(self):
        """Return the changes of the decision, for the message of a failure."""
        return [f'{to_seconds(other.header.stamp):.2f} s {other.decision}/{other.reason} '
                f'{other.explanation}' for one, other in zip(self.decisions, self.decisions[1:])
                if one.decision != other.decision]

    def at_rest(self, seconds=1.0):
        """Return whether the ball was at rest during the last seconds."""
        end = to_seconds(self.states[-1].header.stamp)
        last = [state for state in self.states if to_seconds(state.header.stamp) > end - seconds]
        return all(abs(state.velocity_x) < STOPPED for state in last)

    def speed_at(self, x):
        """Return the speed [m/s] as the front of the ball first reached x, 0 if it did not."""
        return next((abs(state.velocity_x) for state in self.states if state.x + RADIUS >= x), 0.0)


@pytest.fixture
def ride(spinner, make_node, tmp_path):
    """Return a function that runs a scene for some seconds."""
    def run(terrain, seconds, start=0.0, tuning=None, **sensor):
        scene = tmp_path / 'scene.yaml'
        scene.write_text(yaml.safe_dump({
            'robot': 'gimball', 'terrain': terrain, 'initial': {'x': start}, 'duration': seconds}))
        decision = {}
        if tuning:
            decision['tuning'] = str(tmp_path / 'tuning.yaml')
            (tmp_path / 'tuning.yaml').write_text(yaml.safe_dump(tuning))
        listener, states, decisions = make_node(Node, 'listener'), [], []
        for topic, kind, received in (('ball_state', BallState, states),
                                      ('step_decision', StepDecision, decisions)):
            listener.create_subscription(kind, topic, received.append, QoSProfile(depth=5000))
        spinner.add(listener, make_node(Controller, lockstep_set_point_period=0.02),
                    make_node(ObstacleDecision, **decision),
                    make_node(Simulator, scene=str(scene), lockstep=True, real_time_factor=0.0,
                              **sensor))
        spinner.until(lambda: states and to_seconds(states[-1].header.stamp) >= seconds)
        assert all(math.isfinite(message.speed) for message in decisions)
        return Ride(states, decisions)
    return run


def flat(length):
    return {'flat': {'length': length}}


def step(height):
    return {'step': {'height': height}}


def slope(length, angle_deg):
    return {'slope': {'length': length, 'angle_deg': angle_deg}}


@pytest.mark.parametrize('sensor', [SEES_STEPS, SEES_TERRAIN])
def test_the_ball_stops_before_a_drop_after_half_a_degree_downhill(ride, sensor):
    seen = ride([flat(0.4), slope(2.0, -0.5), step(-0.1), flat(2.0)], 12.0, **sensor)
    assert max(seen.x) < 2.4 - RADIUS and seen.at_rest()
    assert StepDecision.DECISION_CROSS not in seen.kinds


def test_the_ball_does_not_hit_a_refused_step_at_three_degrees_downhill(ride):
    seen = ride([flat(0.4), slope(2.2, -3.0), step(0.08), flat(1.0)], 12.0, **SEES_TERRAIN)
    assert seen.speed_at(2.6) < HIT and seen.at_rest()


@pytest.mark.parametrize('sensor, tuning', [
    # Unobserved ground counts as floor only within `unseen_room` of the tuning.
    (SEES_STEPS, {'unseen_room': 0.25}), (SEES_TERRAIN, None)])
def test_the_ball_does_not_fall_off_the_edge_behind_a_step(ride, sensor, tuning):
    seen = ride([flat(1.2), step(0.02), flat(0.3), step(-0.1), flat(2.0)], 10.0, tuning=tuning,
                **sensor)
    assert max(seen.x) < 1.5


def test_the_ball_does_not_hit_a_wall_behind_a_step(ride):
    seen = ride([flat(1.2), step(0.02), flat(0.4), step(0.5), flat(1.0)], 10.0, **SEES_TERRAIN)
    assert seen.speed_at(1.6) < HIT


def test_a_failed_plan_is_not_repeated(ride):
    # The sensor reports half of the height, so the first attempt fails.
    seen = ride([flat(1.2), step(0.06), flat(2.0)], 20.0, sensor_scale=-0.5, **SEES_STEPS)
    touches, away = [], True
    for state in seen.states:
        near = state.x + RADIUS > 1.2
        if near and away and state.velocity_x > HIT:
            touches.append(state.velocity_x)
        away = state.x + RADIUS < 1.15
    assert len(touches) <= 3
    assert all(later > before for before, later in zip(touches, touches[1:]))


def test_the_ball_backs_off_and_crosses_if_the_run_up_is_too_short(ride):
    seen = ride([flat(2.0), step(0.031), flat(3.0)], 14.0, start=1.62,
                tuning={'room_behind': 1.5}, **SEES_TERRAIN)
    assert min(seen.x) < 1.5 and StepDecision.DECISION_BACK_OFF in seen.kinds
    assert max(seen.x) > 2.1


def test_the_ball_does_not_roll_back_on_an_uphill_slope(ride):
    seen = ride([slope(6.0, 4.0), flat(2.0)], 8.0, start=0.5, **SEES_TERRAIN)
    assert min(seen.x) > 0.4


@pytest.mark.parametrize('angle_deg', [4.0, 8.0])
def test_a_ramp_is_detected_before_the_ball_reaches_it(ride, angle_deg):
    seen = ride([flat(1.5), slope(0.6, angle_deg), flat(1.0)], 10.0, **SEES_TERRAIN)
    climbed = max(seen.x) > 2.2
    refused = seen.kinds & {StepDecision.DECISION_STOP, StepDecision.DECISION_GO_ROUND}
    assert climbed or refused and seen.at_rest() and max(seen.x) < 1.6


@pytest.mark.parametrize('sensor', [
    {'observation_height_sd': 0.003, **SEES_STEPS}, {'terrain_height_sd': 0.003, **SEES_TERRAIN}])
def test_the_ball_does_not_hit_a_step_despite_unreported_noise(ride, sensor):
    seen = ride([flat(1.0), step(0.055), flat(1.0)], 8.0, sensor_reported_sd=0.0, **sensor)
    if StepDecision.DECISION_CROSS not in seen.kinds:
        assert seen.speed_at(1.0) < HIT
    assert len(seen.decision_changes) <= 4, seen.decision_changes
