# SPDX-License-Identifier: Apache-2.0
"""
Estimation of pendulum angle and distance from encoder, motor torque and IMU; no ROS.

A robot at rest, whose encoder reads 0 and whose accelerometer reads gravity:

    >>> from ballbot_ros.physics import load_robot
    >>> fusion = Fusion(load_robot('gimball'))
    >>> for number in range(1, 50):
    ...     stamp = 0.002 * number
    ...     fusion.imu(ImuReading(stamp, 0.0, 0.0, 9.81))
    ...     estimate = fusion.encoder(EncoderReading(stamp, 0.0))
    >>> bool(abs(estimate.mean[0]) < 0.01)
    True
"""
from ballbot_ros.estimation.encoder import EncoderReading
from ballbot_ros.estimation.fusion import Fusion
from ballbot_ros.estimation.imu import ImuMounting, ImuReading
from ballbot_ros.estimation.kalman import Estimate, FilterTuning, PendulumFilter
from ballbot_ros.estimation.odometry import OdometryFilter, OdometryState, OdometryTuning

__all__ = [
    'EncoderReading', 'Estimate', 'FilterTuning', 'Fusion', 'ImuMounting', 'ImuReading',
    'OdometryFilter', 'OdometryState', 'OdometryTuning', 'PendulumFilter']
