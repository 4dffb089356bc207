# SPDX-License-Identifier: Apache-2.0
"""All that a controller calls in its loop is compiled, and run once, before there is a loop."""
from ballbot_ros.control.controller import PendulumController
from ballbot_ros.control.signals import JointReadings, Mode, SetPoint
from ballbot_ros.control.tuning import ControlTuning
from ballbot_ros.physics.model.robot import Robot


def warm_up(robot: Robot) -> None:
    """Run each law on made-up readings; the robot must have a pendulum."""
    for mode in Mode:
        controller = PendulumController(robot, ControlTuning())
        for number in range(1, 4):
            stamp = 0.002 * number
            controller.give(SetPoint(mode, 0.1, stamp))
            controller.torque(JointReadings(stamp, 0.0, 0.0, 0.0, 0.0))
        bool(controller.overcome)
