# SPDX-License-Identifier: Apache-2.0
"""Drives through the shipped apartment in closed loop: full physics, lateral model, decision."""
import math

import pytest

from ballbot_ros.decision import Knowledge, load_curve, load_decision_tuning
from ballbot_ros.floors import load_floor
from ballbot_ros.navigation import RoutePlanner
from ballbot_ros.navigation.execution import Navigator, NavStatus, REST
from ballbot_ros.navigation.learned import Learned
from ballbot_ros.physics import load_robot
from ballbot_ros.studies.navigation.closed_loop import Errors, FloorLoop

KNOWLEDGE = Knowledge(load_robot('gimball'), load_curve('gimball_down'),
                      load_decision_tuning('decision_default'))
HALL, BEDROOM, STUDY = (4.2, 3.4, 0.0), (5.4, 5.8), (1.8, 5.5)


@pytest.fixture(scope='module')
def flat():
    return RoutePlanner(load_floor('apartment'), KNOWLEDGE)


def loop_at(flat, pose, **more):
    flat.learn(Learned())
    return FloorLoop(Navigator(flat, KNOWLEDGE), KNOWLEDGE, KNOWLEDGE.robot, flat.floor, pose,
                     **more)


@pytest.mark.slow
def test_the_ball_crosses_the_bedroom_step_with_a_run_up_from_the_living_room(flat):
    loop, south = loop_at(flat, HALL), []
    loop.begin(BEDROOM)
    loop.run(120.0, lambda loop: south.append(loop.plant.pose[1]))
    assert loop.state.status is NavStatus.SUCCEEDED, loop.state.message
    assert math.dist(loop.plant.pose[:2], BEDROOM) < 0.2 and min(south) < 2.9
    assert abs(loop.plant.state.velocity_x) < 0.05


@pytest.mark.slow
def test_sensor_noise_and_drift_cause_no_obstacles(flat):
    loop = loop_at(flat, (1.7, 1.4, 1.5), errors=Errors(0.02, 0.01, 0.002, 0.01), seed=3)
    loop.begin(STUDY)
    loop.run(120.0)
    assert loop.state.status is NavStatus.SUCCEEDED, loop.state.message
    assert not loop.state.learned.obstacles


@pytest.mark.slow
@pytest.mark.parametrize('crosses', [False, True])
def test_after_a_jump_of_1_m_the_ball_arrives_or_stops_with_a_reason(flat, crosses):
    loop = loop_at(flat, (1.76, 2.0, 1.57))
    loop.begin(STUDY)

    def jump(loop):
        if loop.command is not REST and loop.command.crosses is crosses \
                and loop.plant.state.velocity_x > 0.15:
            loop.offset = (0.0, -1.0, 0.0)
    loop.run(25.0, jump)
    assert loop.offset[1] and loop.state.recoveries
    loop.run(140.0)
    assert loop.state.status.ended and abs(loop.plant.state.velocity_x) < 0.05
    assert loop.state.status is NavStatus.SUCCEEDED or loop.state.reason


@pytest.mark.slow
def test_a_ball_that_leans_at_the_start_arrives_and_comes_to_rest(flat):
    loop = loop_at(flat, (1.7, 1.4, 0.0))
    loop.plant._lateral = loop.plant.lateral._replace(lean=0.3, tilt=-0.3)
    loop.begin((2.6, 1.6))
    loop.run(60.0)
    assert loop.state.status is NavStatus.SUCCEEDED, loop.state.message
    assert math.dist(loop.plant.pose[:2], (2.6, 1.6)) < 0.2
    assert abs(loop.plant.state.velocity_x) < 0.05


@pytest.mark.slow
def test_cancellation_during_a_crossing_ends_at_rest(flat):
    loop = loop_at(flat, (1.76, 2.2, 1.57))
    loop.begin(STUDY)
    for _ in range(2000):
        loop.step()
        if loop.command.crosses and loop.plant.state.velocity_x > 0.2:
            break
    loop.state = loop._navigator.cancel(loop.state)
    loop.run(loop.plant.time + 20.0)
    assert loop.state.status is NavStatus.CANCELED
    assert abs(loop.plant.state.velocity_x) < 0.05


@pytest.mark.slow
@pytest.mark.parametrize('start, goal', [
    ((1.5, 1.0, 0.0), (7.5, 1.5)), ((7.5, 1.5, 0.0), (1.5, 1.0)), ((1.5, 4.0, 0.0), (4.4, 2.7))])
def test_the_ball_drives_up_and_down_a_ramp_and_stops_on_it(tmp_path, start, goal):
    path = tmp_path / 'floor.yaml'
    path.write_text("""walls: {size: [9, 5], lines: []}
features:
  - {kind: level, polygon: [[5.5, 0], [9, 0], [9, 5], [5.5, 5]], height: 0.1}
  - {kind: ramp, polygon: [[3.5, 2], [5.5, 2], [5.5, 3.4], [3.5, 3.4]],
     line: [[3.5, 2.7], [5.5, 2.7]], height: 0.1}
""")
    loop = loop_at(RoutePlanner(load_floor(path), KNOWLEDGE), start,
                   errors=Errors(0.02, 0.01, 0.002, 0.01), seed=4)
    loop.begin(goal)
    loop.run(90.0)
    assert loop.state.status is NavStatus.SUCCEEDED, loop.state.message
    assert not loop.state.learned.obstacles and not loop.state.recoveries
    assert math.dist(loop.plant.pose[:2], goal) < 0.2
    assert abs(loop.plant.state.velocity_x) < 0.05
