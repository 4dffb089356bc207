# SPDX-License-Identifier: Apache-2.0
"""The node ``imu``: an inertial sensor on a serial line."""
from dataclasses import dataclass, fields
from typing import Any, List, Optional

from rclpy.node import Node

from ballbot_ros.config.fields import fixed, live, text
from ballbot_ros.errors import LinkError
from ballbot_ros.imus.source import Axes, ImuPort
from ballbot_ros.nodes.imu.publisher import ImuOutput
from ballbot_ros.ros.frames import frame, frame_prefix, Frames
from ballbot_ros.ros.parameters import Commit, declare
from ballbot_ros.ros.run import run
from ballbot_ros.ros.settings import Settings

PORT = {declared.name: declared for declared in fields(ImuPort)}


@dataclass(frozen=True)
class ImuSettings(Settings):
    """Parameters of the node ``imu``: an `ImuPort`, and the frame of the readings."""

    sensor: str = fixed('the port is opened for it', PORT['sensor'])
    port: str = fixed('the port is opened with it', text(
        'serial device or URL; preferably in /dev/serial/by-id', default='/dev/ballbot_imu'))
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
        """Return the settings of the port, without the frames."""
        return ImuPort(**{name: getattr(self, name) for name in PORT})


class ImuNode(Node):
    """
    Publishes the readings of a sensor on a serial port; see `ImuSettings`.

    If readings stop, it reopens the port until they resume; meanwhile the motor has no torque.
    """

    def __init__(self, **kwargs: Any):
        super().__init__('imu', **kwargs)
        settings = declare(self, ImuSettings, self._prepare)
        self._output = ImuOutput(self, settings.as_port, Frames.of(settings).imu)

    def _prepare(self, wanted: ImuSettings) -> Commit:
        axes = Axes(wanted.axes)

        def commit() -> None:
            self._output.source.read_as(axes, wanted.latency)
            self._output.set_deviations(wanted.gyro_sd, wanted.force_sd)
        return commit

    @property
    def failure(self) -> Optional[LinkError]:
        """Return the error that ended the reading thread, which also ends the node; see `run`."""
        return self._output.failure

    def make_safe(self) -> None:
        self._output.end()


def main(args: Optional[List[str]] = None) -> int:
    return run(ImuNode, args)
