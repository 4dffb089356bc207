# SPDX-License-Identifier: Apache-2.0
"""The angle of the pendulum, and the way, from an encoder, the torque and an IMU; no ROS."""
from ballbot_ros.estimation.fusion import Fusion
from ballbot_ros.estimation.imu import ImuMounting, ImuReading
from ballbot_ros.estimation.kalman import Estimate, PendulumFilter
from ballbot_ros.estimation.observability import unobservable
from ballbot_ros.estimation.odometry import (
    OdometryFilter, OdometryState, OdometryTuning)
from ballbot_ros.estimation.tuning import FilterTuning
from ballbot_ros.renamed import refuse_old_names

__all__ = [
    'Estimate', 'FilterTuning', 'Fusion', 'ImuMounting', 'ImuReading', 'OdometryFilter',
    'OdometryState', 'OdometryTuning', 'PendulumFilter', 'unobservable']

refuse_old_names(globals())
