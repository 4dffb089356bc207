# SPDX-License-Identifier: Apache-2.0
"""Where the pendulum hangs, from an encoder, the torque and an IMU; no ROS."""
from ballbot_ros.estimation.fusion import Fusion
from ballbot_ros.estimation.imu import ImuMounting, ImuReading
from ballbot_ros.estimation.kalman import Estimate, FilterTuning, PendulumFilter
from ballbot_ros.estimation.observability import unobservable
from ballbot_ros.estimation.rolling import Rolling

__all__ = [
    'Estimate', 'FilterTuning', 'Fusion', 'ImuMounting', 'ImuReading', 'PendulumFilter',
    'Rolling', 'unobservable']
