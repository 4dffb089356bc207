# SPDX-License-Identifier: Apache-2.0
"""Open the line to the drive of a hardware file."""
from pathlib import Path
from typing import Callable, Optional

from ballbot_ros.bridge.hardware_file import Hardware
from ballbot_ros.hardware.capture import Recorder
from ballbot_ros.hardware.driver import Driver
from ballbot_ros.hardware.drivers import open_driver
from ballbot_ros.hardware.transport import Link


def connector(hardware: Hardware, capture: Optional[Path] = None) -> Callable[[], Driver]:
    """
    Return a function that opens the line and puts a driver on it.

    Parameters
    ----------
    hardware : Hardware
    capture : Path, optional
        File for a copy of the raw traffic, of all lines that are opened one after the other.

    Raises
    ------
    ConfigurationError
        If the file cannot be made, or the hardware file has options of another driver.

    """
    connection, options = hardware.connection, hardware.options()
    recorder = None if capture is None else Recorder(capture)

    def connect() -> Driver:
        line = Link(connection.port, connection.baud, recorder)
        return open_driver(connection.protocol, line, options)

    return connect
