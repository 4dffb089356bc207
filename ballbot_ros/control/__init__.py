# SPDX-License-Identifier: Apache-2.0
"""Control of the pendulum: laws with limits, their stability, and freshness; no ROS."""
from ballbot_ros.control.authority import Authority
from ballbot_ros.control.checked import checked_controller, checked_rate
from ballbot_ros.control.command_gate import CommandGate
from ballbot_ros.control.controller import PendulumController
from ballbot_ros.control.freshness import RateMonitor, Watchdog
from ballbot_ros.control.rolling_model import RollingModel
from ballbot_ros.control.sampled import (
    check_loop, growth_rate, is_stable, loop_poles, lowest_stable_rate)
from ballbot_ros.control.signals import JointReadings, Mode, SetPoint
from ballbot_ros.control.supervised import SupervisedController, Supervision
from ballbot_ros.control.tuning import ControlTuning, load_tuning
from ballbot_ros.renamed import refuse_old_names

__all__ = [
    'Authority', 'check_loop', 'checked_controller', 'checked_rate', 'CommandGate',
    'ControlTuning', 'growth_rate', 'is_stable', 'JointReadings', 'load_tuning', 'loop_poles',
    'lowest_stable_rate', 'Mode', 'PendulumController', 'RateMonitor', 'RollingModel',
    'SetPoint', 'SupervisedController', 'Supervision', 'Watchdog']

refuse_old_names(globals())
