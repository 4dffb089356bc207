# SPDX-License-Identifier: Apache-2.0
"""The line to the drive of a hardware file: opened, checked, lost, and opened again."""
import logging
from pathlib import Path
from typing import Callable, Optional, Tuple

from ballbot_ros.bridge.hardware_file import Hardware
from ballbot_ros.bridge.observer import SessionObserver
from ballbot_ros.drives import open_driver, open_line
from ballbot_ros.drives.capture import Recorder, ShownToAll
from ballbot_ros.drives.contract import Identity, Setting
from ballbot_ros.drives.driver import Driver
from ballbot_ros.errors import BallbotError, ConfigurationError

LOG = logging.getLogger(__name__)

# Between two attempts to find a drive that was lost [s].
RETRY = 0.1
# Patience with a drive that answers, when one was lost: together well below a second at first,
# more for one that is slow [s].
HANDSHAKE, MOST_PATIENCE = 0.25, 1.0


class DriveLine:
    """Holds the drive that there is, if there is one; see `Session` for the arguments."""

    def __init__(self, connect: Callable[[], Driver], clock: Callable[[], float]):
        """Open nothing yet."""
        self._connect, self._clock = connect, clock
        self._next_try = 0.0
        self._failures = 0  # of looking for the drive, in a row
        self.driver: Optional[Driver] = None
        self.identity: Optional[Identity] = None  # of the drive that answered last
        self.trouble = ''  # why there is no drive at the moment
        self.reconnects = 0  # times that a drive which was lost was found again

    def open(self, patience: float) -> Tuple[Identity, Tuple[Setting, ...]]:
        """Open the line, find the drive and check it; raises as `handshake` does."""
        self.close()
        try:
            self.driver, self.identity, settings = handshake(self._connect, patience)
        except BallbotError as error:
            self.trouble = str(error)
            raise
        self.trouble = ''
        return self.identity, settings

    def look(self) -> bool:
        """Look for a drive that was lost, unless that was just done; return whether it is back."""
        if self._clock() < self._next_try:
            return False
        known = self.trouble
        try:
            self.open(min(HANDSHAKE * (1 + self._failures), MOST_PATIENCE))
        except BallbotError as error:
            self._failures += 1
            self._next_try = self._clock() + RETRY
            if self.trouble != known:
                LOG.warning('looking for the drive: %s', error)
            return False
        self._failures = 0
        self.reconnects += 1
        LOG.info('the drive is back')
        return True

    def lose(self, error: BallbotError) -> None:
        """Take note that the drive is gone; it may be looked for at once."""
        self.trouble, self._next_try = str(error), self._clock()
        self.close()
        LOG.warning('lost the drive: %s', error)

    def close(self) -> None:
        """Close the line, if it is open."""
        driver, self.driver = self.driver, None
        if driver is not None:
            driver.line.close()


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
