# SPDX-License-Identifier: Apache-2.0
"""
What every motor controller looks like to the rest of the package.

All quantities are those of the motor shaft, SI: torque [N m], position [rad], velocity [rad/s];
gear, direction and zero of the pendulum joint are the caller's.  A session goes::

    driver = open_driver(options, link)
    driver.identify()                   # who is there; raises DriveError if nobody is
    driver.read_settings()              # what it is set to, and whether that will do
    driver.arm()
    each period:
        telemetry = driver.poll()       # what has arrived; never waits
        driver.send_torque(torque)      # one write: the command and the next questions
    driver.stop()                       # repeated until the drive confirms

`identify`, `read_settings`, `arm` and `stop` wait for answers, never longer than their
``patience``.  `poll`, `send_torque`, `send_stop`, `ask` and `feed` do not wait: a reply that is
late or lost is counted and asked for again.  Any of them raises `LinkError` when the line is
gone; the link is then to be closed and opened again.
"""
from abc import ABC, abstractmethod
from collections import Counter
from dataclasses import dataclass
import math
import time
from typing import Any, Callable, ClassVar, NamedTuple, Optional, Protocol, Type

from ballbot_ros.config.fields import Checked, quantity
from ballbot_ros.drives.wire import WireBudget
from ballbot_ros.errors import DriveError, MessageError


# A stop that is not confirmed is repeated after this time [s].
STOP_PERIOD = 0.02


class Line(Protocol):
    """What a driver needs of a `Link`; a `Replay` has it too."""

    port: str

    def write(self, data: bytes) -> None:
        """Write all."""

    def read(self) -> bytes:
        """Return what has arrived, without waiting."""

    def wait(self, seconds: float) -> bool:
        """Wait for bytes and tell whether there are any."""

    def close(self) -> None:
        """Let go of the line; twice does no harm."""


class Identity(NamedTuple):
    """Who answered the handshake."""

    protocol: str
    hardware: str
    firmware: str
    serial_number: str = ''
    generation: str = ''  # of the firmware, where it decides how the drive is talked to

    @property
    def in_words(self) -> str:
        """Return all of it as people write it."""
        with_serial = f' {self.serial_number}' if self.serial_number else ''
        generation = f', generation {self.generation}' if self.generation else ''
        return (f'{self.protocol} {self.hardware}{with_serial}, firmware {self.firmware}'
                f'{generation}')


class Setting(NamedTuple):
    """
    A setting of the drive that matters for safety, as it is and as it must be.

    Attributes
    ----------
    name : str
    value : str
        As read, with its unit; ``'unknown'`` where the drive cannot be asked.
    wanted : str
        In words.
    acceptable : bool
    remedy : str
        What to do where it is not.

    """

    name: str
    value: str
    wanted: str
    acceptable: bool
    remedy: str = ''


class Telemetry(NamedTuple):
    """
    What the drive has told so far; None where it has not, or cannot.

    A value appears here only after a reply that passed every check of its protocol.
    """

    time: Optional[float] = None  # of the driver's clock, when the position arrived [s]
    position: Optional[float] = None  # of the motor shaft, goes on over full turns [rad]
    velocity: Optional[float] = None  # of the motor shaft [rad/s]
    current: Optional[float] = None  # that makes torque [A]
    bus_voltage: Optional[float] = None  # [V]
    temperature: Optional[float] = None  # of the power stage [degC]
    motor_temperature: Optional[float] = None  # [degC]
    status_time: Optional[float] = None  # when armed and faults arrived [s]
    armed: Optional[bool] = None  # the motor is under power
    faults: tuple[str, ...] = ()  # names that the maker gives them


@dataclass(frozen=True)
class DriveOptions(Checked):
    """What every driver is told; each protocol adds its own."""

    torque_limit: float = quantity(
        'N m', 'largest torque ever sent, at the motor shaft', above=0.0)
    watchdog: float = quantity(
        's', 'time without a command after which the drive must let go by itself', default=0.1,
        above=0.0, maximum=10.0)
    reply_timeout: float = quantity(
        's', 'after which a reply counts as lost', default=0.05, above=0.0, maximum=10.0)


class Driver(ABC):
    """
    A motor controller behind a line.

    Parameters
    ----------
    line : Link or Replay
    options : DriveOptions
        Of the class `Options` of this driver.
    clock : callable
        Gives seconds and never goes back.

    Attributes
    ----------
    telemetry : Telemetry
        The newest.
    counts : Counter
        ``sent`` (writes), ``bytes`` (received), ``replies``, ``lost`` (asked and not answered
        in time), ``unexpected`` (not asked for), ``refused`` (checksum or form is wrong),
        ``skipped`` (bytes that belong to no message), as far as a protocol can tell them.

    """

    protocol: ClassVar[str]
    Options: ClassVar[Type[DriveOptions]] = DriveOptions
    # Baud rates to try when looking for such a drive, the maker's default first.
    baud_rates: ClassVar[tuple[int, ...]] = (115200,)
    # Whether the drive makes the torque by measuring current, or a voltage is computed for it.
    closes_torque_loop: ClassVar[bool] = True

    def __init__(self, line: Line, options: Any,
                 clock: Callable[[], float] = time.monotonic):
        """Take the line; nothing is sent yet."""
        self.line = line
        self.options = options
        self.clock = clock
        self.telemetry = Telemetry()
        self.counts: Counter = Counter()
        self._armed = False  # by us, and not stopped since

    # What waits

    @abstractmethod
    def identify(self, patience: float = 0.5) -> Identity:
        """
        Ask who is there.

        Raises
        ------
        DriveError
            ``silent``, ``garbled`` or ``wrong_protocol`` if no such drive answers,
            ``firmware`` if it is one that commands would mean something else to.

        """

    @abstractmethod
    def read_settings(self, patience: float = 0.5) -> tuple[Setting, ...]:
        """
        Read back every setting that safety rests on, and judge it.

        Raises
        ------
        DriveError
            ``silent`` if the drive does not tell.

        """

    def arm(self, patience: float = 0.5) -> None:
        """
        Put the motor under power at zero torque.

        Raises
        ------
        DriveError
            ``not_armed``, with the faults that the drive names.

        """
        self._arm(self.clock() + patience)
        self._armed = True

    def stop(self, patience: float = 0.5) -> None:
        """
        Take the power off the motor; repeat it until the drive confirms.

        Raises
        ------
        DriveError
            ``not_stopped`` if it does not within `patience`: the drive's own watchdog must
            then do it.

        """
        begin = self.clock()
        while True:
            self.send_stop()
            soon = self.clock() + STOP_PERIOD
            if self._until(lambda: self.stopped_since(begin), soon):
                return
            if self.clock() >= begin + patience:
                raise DriveError('not_stopped', (
                    f'{self.line.port}: the drive did not confirm the stop within '
                    f'{patience:g} s; its own watchdog lets go after '
                    f'{self.options.watchdog:g} s'))

    # What does not wait

    def send_torque(self, torque: float, ask: bool = True) -> None:
        """
        Send a torque; feeds the watchdog.

        Parameters
        ----------
        torque : float
            At the motor shaft [N m]; cut to the torque limit.
        ask : bool
            Send the questions of this period, too, in the same write.

        Raises
        ------
        MessageError
            If it is not finite.  Nothing is sent.
        DriveError
            ``not_armed`` before `arm` and after a stop.  Nothing is sent.

        """
        if not self._armed:
            raise DriveError('not_armed', (
                f'{self.line.port}: the motor gets no torque before it has been armed'))
        if not math.isfinite(torque):
            raise MessageError('not_finite', f'torque must be finite, got {torque!r}')
        limit = self.options.torque_limit
        self._send(self._torque_message(min(max(torque, -limit), limit))
                   + (self._questions() if ask else b''))

    def ask(self) -> None:
        """Send the questions of this period only; this keeps no torque alive."""
        self._send(self._questions())

    @abstractmethod
    def feed(self) -> None:
        """Feed the watchdog of the drive and leave its torque as it is."""

    def send_stop(self) -> None:
        """Write zero torque, power off, and the questions whose answers confirm it."""
        self._armed = False
        self._send(self._stop_message())

    @abstractmethod
    def stopped_since(self, time: float) -> bool:
        """Tell whether the drive confirmed, after `time`, that the motor has no power."""

    def poll(self) -> Telemetry:
        """Read what has arrived and return the newest telemetry."""
        data = self.line.read()
        self._take(data, self.clock())
        return self.telemetry

    @abstractmethod
    def budget(self) -> WireBudget:
        """Return what one period of `send_torque` and its replies put on the line at most."""

    # For drivers

    def _until(self, condition: Callable[[], bool], deadline: float) -> bool:
        """Poll until a condition holds or the deadline has come, and tell whether it holds."""
        while True:
            self.poll()
            if condition():
                return True
            left = deadline - self.clock()
            if left <= 0.0:
                return False
            self.line.wait(left)

    def _soon(self, deadline: float) -> float:
        """Return when a reply to what is asked now is overdue, at most a deadline."""
        return min(deadline, self.clock() + self.options.reply_timeout)

    def _nobody(self, received: int, maker: str) -> DriveError:
        """Return why a handshake failed in which so many bytes were received."""
        if not received:
            return DriveError('silent', (
                f'{self.line.port}: no {maker} answers; is it powered, are RX and TX crossed, is '
                'its serial port set to this protocol?'))
        return DriveError('garbled', (
            f'{self.line.port}: {received} bytes came that no {maker} would send: wrong baud '
            'rate, another protocol, or noise'))

    @abstractmethod
    def _arm(self, deadline: float) -> None:
        """See `arm`."""

    @abstractmethod
    def _stop_message(self) -> bytes:
        """Return the bytes of `send_stop`."""

    def _send(self, data: bytes) -> None:
        if data:
            self.line.write(data)
            self.counts['sent'] += 1

    @abstractmethod
    def _torque_message(self, torque: float) -> bytes:
        """Return the bytes that command a torque [N m]."""

    @abstractmethod
    def _questions(self) -> bytes:
        """Return the bytes that ask for the telemetry of this period."""

    @abstractmethod
    def _take(self, data: bytes, now: float) -> None:
        """Update telemetry and counts from received bytes; `data` may be empty."""
