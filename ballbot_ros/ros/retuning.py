# SPDX-License-Identifier: Apache-2.0
"""Change the gains of running laws, after a check and without a jump of the torque."""
from dataclasses import replace

from ballbot_ros.control import checked_rate, SupervisedController, Supervision
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.ros.parameters import Commit
from ballbot_ros.ros.separate_process import run_in_process
from ballbot_ros.ros.settings import LoopNumbers


def prepare_laws(controller: SupervisedController, robot: Robot, now: LoopNumbers,
                 wanted: LoopNumbers, expected: Supervision) -> Commit:
    """
    Check the requested gains; return a function that applies them.

    This function computes the `lowest_rate` of `expected`.  Raises `ConfigurationError` or
    `UnstableLoopError` as `control.checked_controller`.
    """
    lowest = controller.expected.lowest_rate if wanted == now else run_in_process(
        checked_rate, robot, *wanted)

    def commit() -> None:
        controller.expected = replace(expected, lowest_rate=lowest)
        if wanted.tuning != now.tuning:
            controller.retune(wanted.tuning)
    return commit
