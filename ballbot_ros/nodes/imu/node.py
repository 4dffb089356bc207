# SPDX-License-Identifier: Apache-2.0
"""The node ``imu``: an inertial sensor on a serial line."""
import sys
from typing import Any, List, Optional

from rclpy.node import Node

from ballbot_ros.errors import LinkError
from ballbot_ros.imus.source import Axes
from ballbot_ros.nodes.imu.publisher import ImuOutput
from ballbot_ros.nodes.imu.settings import ImuSettings
from ballbot_ros.ros.frames import Frames
from ballbot_ros.ros.parameters import Commit, declare
from ballbot_ros.ros.run import run

# Longest time for which a thread keeps the interpreter lock [s].
SWITCH = 5e-4


class ImuNode(Node):
    """
    Publishes the readings of a sensor on a serial port; see `ImuSettings`.

    Without readings it reopens the port until they return; the bridge gives no torque meanwhile.
    """

    def __init__(self, **kwargs: Any):
        super().__init__('imu', **kwargs)
        settings = declare(self, ImuSettings, self._prepare)
        self._output = ImuOutput(self, settings.as_port, Frames.of(settings).imu)

    def _prepare(self, wanted: ImuSettings) -> Commit:
        """Check other parameters; return a function that applies them."""
        axes = Axes(wanted.axes)

        def commit() -> None:
            self._output.source.read_as(axes, wanted.latency)
            self._output.set_deviations(wanted.gyro_sd, wanted.force_sd)
        return commit

    @property
    def failure(self) -> Optional[LinkError]:
        """Return the error that ended the reading, and ends the node; see `run`."""
        return self._output.failure

    def make_safe(self) -> None:
        """Close the line."""
        self._output.end()


def main(args: Optional[List[str]] = None) -> int:
    """Run the node."""
    sys.setswitchinterval(SWITCH)
    return run(ImuNode, args)
