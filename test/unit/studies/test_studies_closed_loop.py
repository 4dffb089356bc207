# SPDX-License-Identifier: Apache-2.0
"""Many control periods in one call agree with single periods of plant and controller."""
import math

import numpy as np
import pytest

from ballbot_ros.control import JointReadings, load_tuning, Mode, PendulumController, SetPoint
from ballbot_ros.physics import Actuation, load_robot
from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.physics.simulation.model import Model
from ballbot_ros.physics.simulation.scene import Initial, Run, Scene
from ballbot_ros.plant import Plant
from ballbot_ros.studies.evaluation.closed_loop import (
    ClosedLoop, SOLVER, TOUCH_PERIOD, TOUCH_SPEED)

ROBOT, GAINS = load_robot('gimball'), load_tuning('published')
STEP = Terrain([[-2.0, 0.0], [0.5, 0.0], [0.5, 0.02], [3.0, 0.02]])


@pytest.mark.parametrize('terrain', [Terrain.slope(math.radians(3.0)), STEP])
def test_the_closed_loop_agrees_with_plant_and_controller(terrain):
    scene = Scene('', Model(ROBOT, terrain, solver=SOLVER), Initial(speed=0.5), Actuation(),
                  Run(duration=1.0))
    plant, controller = Plant(scene, 500.0), PendulumController(ROBOT, GAINS)
    loop = ClosedLoop(ROBOT, terrain, ROBOT, GAINS, 0.5, 0.0)
    # The changes of the set angle reach both the torque limit and the motor line.
    for stretch, set_angle in enumerate([1.5, -1.5, 2.6, 0.3] * 25):
        for _ in range(10):
            state = plant.state
            controller.give(SetPoint(Mode.HOLD, set_angle, plant.time))
            plant.advance(controller.torque(JointReadings(
                plant.time, state.ball_angle, state.joint_angle, state.ball_rate,
                state.joint_rate)))
        loop.advance(set_angle, 10)
        assert loop.time == pytest.approx(plant.time, abs=1e-12)
        np.testing.assert_allclose(loop.state[1:], plant.state[1:], rtol=0.0, atol=1e-9,
                                   err_msg=f'stretch {stretch}')
        assert loop.torque == pytest.approx(plant.torque, abs=1e-9)


def test_a_touch_is_recorded_once_with_the_speed_before_it():
    loop = ClosedLoop(ROBOT, Terrain.step(0.03, 0.5), ROBOT, GAINS, 0.4, 0.0)
    while loop.watched[0, TOUCH_PERIOD] == 0.0:
        loop.advance(0.0, 1)
    when, speed = loop.periods, loop.watched[0, TOUCH_SPEED]
    # The ball touches where its centre is sqrt(2 R h - h^2) before the face.
    assert loop.state.x == pytest.approx(0.5 - math.sqrt(2.0 * 0.226 * 0.03 - 0.03**2), abs=0.01)
    assert speed == pytest.approx(0.4, abs=0.02)
    loop.advance(0.0, 50)
    assert loop.watched[0, TOUCH_PERIOD] == when and loop.watched[0, TOUCH_SPEED] == speed
