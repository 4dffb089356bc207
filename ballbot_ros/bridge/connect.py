# SPDX-License-Identifier: Apache-2.0
"""Open the line to the drive of a hardware file, and see whether it is fit to be driven."""
from pathlib import Path
from typing import Callable, Tuple

from ballbot_ros.bridge.hardware_file import Hardware
from ballbot_ros.bridge.observer import SessionObserver
from ballbot_ros.drives import open_driver, open_line
from ballbot_ros.drives.capture import Recorder, ShownToAll
from ballbot_ros.drives.contract import Identity, Setting
from ballbot_ros.drives.driver import Driver
from ballbot_ros.errors import ConfigurationError


def connector(hardware: Hardware, capture: str = '', observer: SessionObserver = SessionObserver()
              ) -> Callable[[], Driver]:
    """
    Return a function that opens the line and puts a driver on it.

    Parameters
    ----------
    hardware : Hardware
    capture : str
        File for a copy of the raw traffic, of all lines that are opened one after the other;
        empty for none.
    observer : SessionObserver
        Is shown that traffic, too.

    Raises
    ------
    ConfigurationError
        If the file cannot be made, or the hardware file has options of another driver.

    """
    connection, options = hardware.connection, hardware.options()
    recorder = ShownToAll(Recorder(Path(capture)), observer) if capture else observer

    def connect() -> Driver:
        line = open_line(
            connection.protocol, connection.port, connection.baud, recorder)
        return open_driver(connection.protocol, line, options)

    return connect


def handshake(connect: Callable[[], Driver], patience: float
              ) -> Tuple[Driver, Identity, Tuple[Setting, ...]]:
    """
    Find the drive, stop its motor, and check its settings.

    Parameters
    ----------
    connect : callable
        See `connector`.
    patience : float
        With each of the three [s].

    Raises
    ------
    LinkError, DriveError
        If there is no such port, or not such a drive.
    ConfigurationError
        If a setting that safety rests on is not as it must be.  The line is closed again.

    """
    driver = connect()
    try:
        identity = driver.identify(patience)
        driver.stop(patience)  # whoever left it may have left it turning
        settings = driver.read_settings(patience)
        wrong = [item for item in settings if not item.acceptable]
        if wrong:
            raise ConfigurationError(
                'the drive is not set as it must be: ' + '; '.join(
                    f'{item.name} is {item.value}, must be {item.wanted}'
                    + (f': {item.remedy}' if item.remedy else '') for item in wrong))
    except BaseException:
        driver.line.close()
        raise
    return driver, identity, settings
