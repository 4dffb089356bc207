# SPDX-License-Identifier: Apache-2.0
"""A controller for a loop that has been found stable."""
from dataclasses import replace

from ballbot_ros.control.controller import PendulumController
from ballbot_ros.control.sampled import check_loop, CLOSED, lowest_stable_rate
from ballbot_ros.control.supervised import SupervisedController, Supervision
from ballbot_ros.control.tuning import ControlTuning
from ballbot_ros.control.warm_up import warm_up
from ballbot_ros.physics.model.robot import Robot


def checked_controller(robot: Robot, tuning: ControlTuning, rate: float, delay: float,
                       expected: Supervision = Supervision()) -> SupervisedController:
    """
    Return a controller that expects joint states at the lowest rate at which its gains are stable.

    Parameters
    ----------
    robot : Robot
    tuning : ControlTuning
    rate : float
        At which it will run [Hz].
    delay : float
        Samples from a joint state to the torque that answers it.
    expected : Supervision
        Whose `lowest_rate` is found here.

    Raises
    ------
    ConfigurationError
        If the robot has no pendulum.
    UnstableLoopError
        If the loop would diverge.

    """
    controller = PendulumController(robot, tuning)
    warm_up(robot)  # the first readings must not wait for what is not compiled yet
    lowest = checked_rate(robot, tuning, rate, delay)
    return SupervisedController(controller, replace(expected, lowest_rate=lowest))


def checked_rate(robot: Robot, tuning: ControlTuning, rate: float, delay: float) -> float:
    """
    Return the lowest rate at which gains are stable, if they are at the one given [Hz].

    Parameters, and what is raised, as in `checked_controller`.
    """
    for law in CLOSED:
        check_loop(robot, tuning, law, rate, delay)
    return max(lowest_stable_rate(robot, tuning, law, delay) for law in CLOSED)
