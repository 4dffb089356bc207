# SPDX-License-Identifier: Apache-2.0
"""A controller whose loop is stable and whose kernels are compiled before it starts."""
from dataclasses import replace

from ballbot_ros.control.controller import PendulumController
from ballbot_ros.control.sampled import check_loop, CLOSED, lowest_stable_rate
from ballbot_ros.control.signals import JointReadings, Mode, SetPoint
from ballbot_ros.control.supervised import SupervisedController, Supervision
from ballbot_ros.control.tuning import ControlTuning
from ballbot_ros.physics.model.robot import Robot


def checked_controller(robot: Robot, tuning: ControlTuning, rate: float, delay: float,
                       expected: Supervision = Supervision()) -> SupervisedController:
    """
    Return a controller that requires joint states at the lowest stable rate of its gains.

    Parameters
    ----------
    robot : Robot
    tuning : ControlTuning
    rate : float
        Rate of the controller [Hz].
    delay : float
        Delay from a joint state to its torque [samples].
    expected : Supervision
        This function computes its `lowest_rate`.

    Raises
    ------
    ConfigurationError
        If the robot has no pendulum.
    UnstableLoopError
        If the loop would diverge.

    """
    controller = PendulumController(robot, tuning)
    warm_up(robot)
    lowest = checked_rate(robot, tuning, rate, delay)
    return SupervisedController(controller, replace(expected, lowest_rate=lowest))


def checked_rate(robot: Robot, tuning: ControlTuning, rate: float, delay: float) -> float:
    """
    Return the lowest rate at which the loop is stable, if it is stable at `rate` [Hz].

    Parameters and errors as in `checked_controller`.
    """
    for law in CLOSED:
        check_loop(robot, tuning, law, rate, delay)
    return max(lowest_stable_rate(robot, tuning, law, delay) for law in CLOSED)


def warm_up(robot: Robot) -> None:
    """Run each law once to compile its kernels before the loop starts; needs a pendulum."""
    for mode in Mode:
        controller = PendulumController(robot, ControlTuning())
        for number in range(1, 4):
            stamp = 0.002 * number
            controller.give(SetPoint(mode, 0.1, stamp))
            controller.torque(JointReadings(stamp, 0.0, 0.0, 0.0, 0.0))
        bool(controller.overcome)
