# SPDX-License-Identifier: Apache-2.0
"""The parameters of the node: name, unit, range, default and meaning."""
from dataclasses import dataclass

from ballbot_ros.config.fields import fixed, flag, live, quantity, text
from ballbot_ros.ros.frames import frame, frame_prefix
from ballbot_ros.ros.settings import file_in, rate_of, Settings


@dataclass(frozen=True)
class EmulatedRobotSettings(Settings):
    """Parameters of the node ``emulated_robot``."""

    hardware: str = fixed('the emulated drive is made with it', file_in(
        'hardware', 'gimball_odrive', 'hardware file',
        ', whose protocol and baud rate the drive has'))
    firmware: str = fixed('the emulated drive is made with it', text(
        'firmware generation of the drive, `0.5` or `0.6` for an ODrive; empty for the only or '
        'oldest one', default=''))
    scene: str = fixed('the world is built of it', file_in('scenes', 'doorstep'))
    link: str = fixed('the device is there already', text(
        'symbolic link to keep pointing to the serial device', default='/tmp/ballbot_motor'))
    publish_odom: bool = fixed('the topic is made at the start', flag(
        'publish the true odom, 83 times a second, for a bridge whose odom_rate is 0',
        default=False))
    imu_link: str = fixed('the device is made at the start', text(
        'symbolic link to the serial device of an emulated WitMotion sensor, in place of the '
        'topic imu; empty for the topic', default=''))
    imu_rate: float = live(rate_of('imu', 250.0, minimum=10.0, maximum=1000.0))
    gyro_sd: float = live(quantity(
        'rad/s', 'noise of the gyro per reading', default=0.005, minimum=0.0, maximum=10.0))
    gyro_bias: float = live(quantity(
        'rad/s', 'constant error of the gyro', default=0.005, minimum=-1.0, maximum=1.0))
    force_sd: float = live(quantity(
        'm/s2', 'noise of the accelerometer per reading', default=0.1, minimum=0.0, maximum=10.0))
    frame_prefix: str = frame_prefix()
    odom_frame: str = frame('odom')
    base_frame: str = frame('base')
    imu_frame: str = frame('imu')
