# SPDX-License-Identifier: Apache-2.0
"""
Control of the pendulum: laws with limits, their stability, and supervision; no ROS.

The torque that holds the pendulum level, from joint angles and rates:

    >>> from ballbot_ros.physics import load_robot
    >>> gimball, gains = load_robot('gimball'), load_tuning('published')
    >>> controller = PendulumController(gimball, gains)
    >>> controller.give(SetPoint(Mode.HOLD, 1.57, stamp=0.0))
    >>> controller.torque(JointReadings(0.0, 0.0, 0.0, 0.0, 0.0)) == gains.torque_limit
    True

A loop with too low a sampling rate diverges; `check_loop` refuses it and names a stable rate:

    >>> 200.0 < lowest_stable_rate(gimball, gains, Mode.HOLD) < 300.0
    True
    >>> check_loop(gimball, gains, Mode.HOLD, rate=500.0, delay=0)
"""
from ballbot_ros.control.checked import checked_controller, checked_rate
from ballbot_ros.control.command_gate import Authority, CommandGate
from ballbot_ros.control.controller import PendulumController
from ballbot_ros.control.rolling_model import RollingModel
from ballbot_ros.control.sampled import (
    check_loop, growth_rate, is_stable, loop_poles, lowest_stable_rate)
from ballbot_ros.control.signals import JointReadings, Mode, SetPoint
from ballbot_ros.control.supervised import SupervisedController, Supervision
from ballbot_ros.control.tuning import ControlTuning, load_tuning

__all__ = [
    'Authority', 'check_loop', 'checked_controller', 'checked_rate', 'CommandGate',
    'ControlTuning', 'growth_rate', 'is_stable', 'JointReadings', 'load_tuning', 'loop_poles',
    'lowest_stable_rate', 'Mode', 'PendulumController', 'RollingModel',
    'SetPoint', 'SupervisedController', 'Supervision']
