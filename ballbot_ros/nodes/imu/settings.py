# SPDX-License-Identifier: Apache-2.0
"""The parameters of the node: name, unit, range, default and meaning."""
from dataclasses import dataclass, fields

from ballbot_ros.config.fields import fixed, live, text
from ballbot_ros.imus.source import ImuPort
from ballbot_ros.ros.frames import frame, frame_prefix
from ballbot_ros.ros.settings import Settings

PORT = {declared.name: declared for declared in fields(ImuPort)}


@dataclass(frozen=True)
class ImuSettings(Settings):
    """Parameters of the node ``imu``: an `ImuPort`, and the frame of the readings."""

    sensor: str = fixed('the port is opened for it', PORT['sensor'])
    port: str = fixed('the port is opened with it', text(
        'serial device or URL; best a name in /dev/serial/by-id', default='/dev/ballbot_imu'))
    baud: int = fixed('the port is opened with it', PORT['baud'])
    rate: int = fixed('the sensor is configured when it is found', PORT['rate'])
    bandwidth: int = fixed('the sensor is configured when it is found', PORT['bandwidth'])
    axes: str = live(PORT['axes'])
    latency: float = live(PORT['latency'])
    gyro_sd: float = live(PORT['gyro_sd'])
    force_sd: float = live(PORT['force_sd'])
    frame_prefix: str = frame_prefix()
    imu_frame: str = frame('imu')

    @property
    def as_port(self) -> ImuPort:
        """Return the port without the frames."""
        return ImuPort(**{name: getattr(self, name) for name in PORT})
