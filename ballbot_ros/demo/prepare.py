# SPDX-License-Identifier: Apache-2.0
"""Compile what the nodes call, so that the first run is like all others."""
from ballbot_ros.control import (
    check_loop, JointReadings, load_tuning, Mode, PendulumController, SetPoint)
from ballbot_ros.decision import Knowledge, load_curve, load_decision_tuning
from ballbot_ros.decision.decider import warm_up
from ballbot_ros.physics import load_scene
from ballbot_ros.physics.model.robot import load_robot
from ballbot_ros.plant import Plant


def prepare() -> None:
    """Compile what is not compiled yet; some time at first, and none later."""
    robot, tuning = load_robot('gimball'), load_tuning('published')
    Plant(load_scene('doorstep'), 500.0).advance(0.0)
    check_loop(robot, tuning, Mode.SPEED, 500.0, 0)
    controller = PendulumController(robot, tuning)
    for stamp, mode in enumerate((Mode.HOLD, Mode.DRIVE, Mode.SPEED)):
        controller.give(SetPoint(mode, 0.1, float(stamp)))
        controller.torque(JointReadings(float(stamp), 0.0, 0.0, 0.0, 0.0))
    warm_up(Knowledge(robot, load_curve('gimball_down'), load_decision_tuning('decision_default'),
                      tuning), 'rollout')
