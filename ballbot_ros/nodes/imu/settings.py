# SPDX-License-Identifier: Apache-2.0
"""The parameters of the node: name, unit, range, default and meaning."""
from dataclasses import dataclass

from ballbot_ros.config.fields import count, fixed, live, quantity, text
from ballbot_ros.imus import IMUS
from ballbot_ros.ros.frames import frame, frame_prefix
from ballbot_ros.ros.settings import Settings


@dataclass(frozen=True)
class ImuSettings(Settings):
    """Parameters of the node ``imu``."""

    sensor: str = fixed('the port is opened for it', text(
        'vendor of the sensor', default='witmotion', choices=IMUS))
    port: str = fixed('the port is opened with it', text(
        'serial device or URL; best a name in /dev/serial/by-id', default='/dev/ballbot_imu'))
    baud: int = fixed('the port is opened with it', count(
        'bits per second; a sensor at the 9600 of the factory is changed to it', default=115200,
        minimum=4800, maximum=4_000_000))
    rate: int = fixed('the sensor is configured when it is found', count(
        'readings per second; WitMotion: 10, 20, 50, 100 or 200', default=200, minimum=1,
        maximum=10_000))
    bandwidth: int = fixed('the sensor is configured when it is found', count(
        'bandwidth of the filters in the sensor [Hz]; WitMotion: 5, 10, 20, 42, 98, 188 or 256',
        default=98, minimum=1, maximum=10_000))
    axes: str = live(text(
        'which axis of the sensor points forward, which left and which up when the shell stands '
        'at ball angle 0, such as `-y x z`', default='x y z'))
    latency: float = live(quantity(
        's', 'time from the motion to the first byte that reports it; the filters of 98 Hz '
        'take 0.003', default=0.003, minimum=0.0, maximum=0.1))
    gyro_sd: float = live(quantity(
        'rad/s', 'noise of the gyro per reading, for the covariance', default=0.005, above=0.0,
        maximum=10.0))
    force_sd: float = live(quantity(
        'm/s2', 'noise of the accelerometer per reading, likewise', default=0.05, above=0.0,
        maximum=10.0))
    frame_prefix: str = frame_prefix()
    imu_frame: str = frame('imu')
