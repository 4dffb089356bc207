# SPDX-License-Identifier: Apache-2.0
"""The link to the drive of a hardware file: open, check, reconnect, share between axes."""
from functools import partial
import logging
from pathlib import Path
from typing import Callable, Dict, List, Optional, Sequence, Tuple, TypeVar

from ballbot_ros.bridge.hardware_file import Hardware
from ballbot_ros.bridge.observer import SessionObserver
from ballbot_ros.drives import open_driver, open_line
from ballbot_ros.drives.capture import Recorder, ShownToAll
from ballbot_ros.drives.contract import Identity, SerialLine, Setting
from ballbot_ros.drives.driver import Driver
from ballbot_ros.errors import BallbotError, ConfigurationError, LinkError

LOG = logging.getLogger(__name__)
Result = TypeVar('Result')

# Time between two attempts to reconnect, in addition to the watchdog timeout of the drive [s].
RETRY = 0.1
# First and longest timeout of each reply in the handshake after a lost link [s]; it grows with
# each failed attempt.  The first handshake takes well below a second.
HANDSHAKE, LONGEST_HANDSHAKE = 0.25, 1.0


class DriveLine:
    """
    Owns the connection to the drive; see `Session` for `connect` and `clock`.

    After a lost link or a failed handshake, nothing is sent for longer than the watchdog timeout
    [s] of the drive: a garbled stop may feed the watchdog, as bytes with pauses of more than 10 ms
    do on a RoboClaw, and the motor would keep its torque.
    """

    def __init__(self, connect: Callable[[], Driver], clock: Callable[[], float],
                 watchdog: float):
        self._connect, self._clock = connect, clock
        self._pause = watchdog + RETRY
        self._next_try = 0.0
        self._failures = 0  # consecutive failed attempts to reconnect
        self.driver: Optional[Driver] = None
        self.identity: Optional[Identity] = None  # of the last connected drive
        self.trouble = ''  # reason for a missing connection
        self.reconnects = 0  # successful reconnections

    def open(self, timeout: float) -> Tuple[Identity, Tuple[Setting, ...]]:
        """Open the link and check the drive; raises as `handshake` does."""
        self.close()
        try:
            self.driver, self.identity, settings = handshake(self._connect, timeout)
        except BallbotError as error:
            self.trouble = str(error)
            raise
        self.trouble = ''
        return self.identity, settings

    def reconnect(self) -> bool:
        """Try to reconnect if the pause is over; return whether the drive is connected."""
        if self._clock() < self._next_try:
            return False
        known = self.trouble
        try:
            self.open(min(HANDSHAKE * (1 + self._failures), LONGEST_HANDSHAKE))
        except BallbotError as error:
            self._failures += 1
            self._next_try = self._clock() + self._pause
            if self.trouble != known:
                LOG.warning('looking for the drive: %s', error)
            return False
        self._failures = 0
        self.reconnects += 1
        LOG.info('reconnected to the drive')
        return True

    def disconnect(self, error: BallbotError) -> None:
        """Close a lost link and record the error; `reconnect` waits for the pause."""
        self.trouble, self._next_try = str(error), self._clock() + self._pause
        self.close()
        LOG.warning('connection to the drive lost: %s', error)

    def close(self) -> None:
        """Close the link if it is open."""
        driver, self.driver = self.driver, None
        if driver is not None:
            driver.line.close()


class SharedLine:
    """
    Opens a line for its first view and closes it with the last one, or when it fails.

    A driver skips the replies to another axis, so the protocol must distinguish them; see
    `Driver.shares_line`.
    """

    def __init__(self, open_it: Callable[[], SerialLine]):
        self._open = open_it
        self._line: Optional[SerialLine] = None
        self._views: list['LineView'] = []

    def view(self) -> 'LineView':
        """Return a view of the line, which is opened if necessary; raises as `open_it` does."""
        if self._line is None:
            self._line, self._views = self._open(), []
        self._views.append(LineView(self, self._line))
        return self._views[-1]

    def distribute(self, line: SerialLine) -> None:
        """Pass the received data to each view."""
        data = line.read()
        if data:
            for view in self._views:
                view.arrived += data

    def drop(self, view: 'LineView') -> None:
        """Remove a view, and close the line after the last one."""
        self._views = [one for one in self._views if one is not view]
        if not self._views:
            self.close(view.line)

    def close(self, line: SerialLine) -> None:
        """Close a line; it is opened again for the next view."""
        line.close()
        if line is self._line:
            self._line = None


class LineView:
    """View of a shared line for the driver of one axis; a `SerialLine`."""

    def __init__(self, shared: SharedLine, line: SerialLine):
        self._shared, self.line = shared, line
        self.port = line.port
        self.arrived = b''  # received, but not read yet
        self._closed = False

    def write(self, data: bytes) -> None:
        self._attempt(lambda: self.line.write(data))

    def read(self) -> bytes:
        self._attempt(lambda: self._shared.distribute(self.line))
        data, self.arrived = self.arrived, b''
        return data

    def wait(self, seconds: float, least: int = 1) -> bool:
        return bool(self.arrived) or self._attempt(lambda: self.line.wait(seconds, least))

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            self._shared.drop(self)

    def _attempt(self, action: Callable[[], Result]) -> Result:
        """Return the result of an action; close the line for all views if it fails."""
        if self._closed:
            raise LinkError(f'{self.port} has been closed', 'closed', 'port')
        try:
            return action()
        except LinkError:
            self._shared.close(self.line)
            raise


def connectors(hardware: Sequence[Hardware], capture: str = '',
               observer: SessionObserver = SessionObserver()) -> List[Callable[[], Driver]]:
    """
    Return for each axis a function that opens its link and returns its driver.

    Axes on the same port share the link.  The raw traffic of all connections goes to the observer
    and to the file `capture`, unless its name is empty.  Raises `ConfigurationError` if the file
    cannot be created, or the hardware file has options of another driver.
    """
    recorder = ShownToAll(Recorder(Path(capture)), observer) if capture else observer
    shared: Dict[str, SharedLine] = {}
    ports = [item.connection.port for item in hardware]

    def connector_of(item: Hardware) -> Callable[[], Driver]:
        connection, options = item.connection, item.options()
        open_it: Callable[[], SerialLine] = partial(
            open_line, connection.protocol, connection.port, connection.baud, recorder)
        if ports.count(connection.port) > 1:
            open_it = shared.setdefault(connection.port, SharedLine(open_it)).view
        return lambda: open_driver(connection.protocol, open_it(), options)
    return [connector_of(item) for item in hardware]


def connector(hardware: Hardware) -> Callable[[], Driver]:
    """Return the function of `connectors` for a single axis."""
    return connectors([hardware])[0]


def handshake(connect: Callable[[], Driver], timeout: float
              ) -> Tuple[Driver, Identity, Tuple[Setting, ...]]:
    """
    Identify the drive, stop its motor, and check its settings; the timeout is per request [s].

    Raises `LinkError` or `DriveError` if the port does not exist, or the drive is not the expected
    one, and `ConfigurationError` if a setting that is required for safety has another value; then
    the link is closed.
    """
    driver = connect()
    try:
        identity = driver.identify(timeout)
        driver.stop(timeout)  # the motor may still turn from an earlier connection
        settings = driver.read_settings(timeout)
        wrong = [item for item in settings if not item.acceptable]
        if wrong:
            raise ConfigurationError(
                'the settings of the drive are wrong: ' + '; '.join(
                    f'{item.name} is {item.value}, must be {item.wanted}'
                    + (f': {item.remedy}' if item.remedy else '') for item in wrong),
                'inconsistent', wrong[0].name)
    except BaseException:
        driver.line.close()
        raise
    return driver, identity, settings
