# SPDX-License-Identifier: Apache-2.0
"""Control of the pendulum: laws with limits, their stability, and freshness; no ROS."""
from ballbot_ros.control.command_gate import CommandGate
from ballbot_ros.control.controller import PendulumController
from ballbot_ros.control.freshness import RateMonitor, Watchdog
from ballbot_ros.control.linear import held_acceleration, linear_rolling, rolling_accelerations
from ballbot_ros.control.sampled import (
    check_loop, growth_rate, is_stable, loop_poles, lowest_stable_rate)
from ballbot_ros.control.signals import JointReadings, Mode, SetPoint
from ballbot_ros.control.supervised import SupervisedController, Supervision
from ballbot_ros.control.tuning import ControlTuning, load_tuning

__all__ = [
    'check_loop', 'CommandGate', 'ControlTuning', 'growth_rate', 'held_acceleration', 'is_stable',
    'JointReadings', 'linear_rolling', 'load_tuning', 'loop_poles', 'lowest_stable_rate',
    'Mode', 'PendulumController', 'RateMonitor', 'rolling_accelerations', 'SetPoint',
    'SupervisedController', 'Supervision', 'Watchdog']
