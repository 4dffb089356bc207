# SPDX-License-Identifier: Apache-2.0
"""
The contract between a motor controller's driver and the rest of the package.

All quantities are those of the motor shaft, SI: torque [N m], position [rad], velocity [rad/s];
gear, direction and zero of the pendulum joint are the caller's.  A session goes::

    driver = open_driver(protocol, link, options)
    driver.identify()                   # the handshake; raises DriveError without an answer
    driver.read_settings()              # what the drive is set to, and whether that is acceptable
    driver.arm()
    each period:
        telemetry = driver.poll()       # what has arrived; never waits
        driver.send_torque(torque)      # one write: the command and the next requests
    driver.stop()                       # repeated until the drive confirms

`identify`, `read_settings`, `arm` and `stop` wait for answers, never longer than their
``patience``.  `poll`, `send_torque`, `send_stop`, `ask` and `feed` do not wait: a reply that is
late or lost is counted and asked for again.  Any of them raises `LinkError` when the line is
gone; the link is then to be closed and opened again.

`Driver` in driver.py is the base class that keeps this contract, whatever the protocol: torque
only while armed, finite and within the limit; a stop repeated until it is confirmed.
"""
from collections import Counter
from dataclasses import dataclass
from typing import Any, Mapping, NamedTuple, Optional, Protocol

from ballbot_ros.config.fields import Checked, quantity


class SerialLine(Protocol):
    """What a driver needs of a `Link`; a `Replay` has it too."""

    port: str

    def write(self, data: bytes) -> None:
        """Write all."""

    def read(self) -> bytes:
        """Return what has arrived, without waiting."""

    def wait(self, seconds: float, least: int = 1) -> bool:
        """Wait for a number of bytes, where supported, and return whether there are any."""

    def close(self) -> None:
        """Close the line; closing twice is no error."""


class StreamParser(Protocol):
    """Finds the replies in what a drive sends; `counts` are of what is none."""

    counts: Counter[str]

    def feed(self, data: bytes) -> list[Any]:
        """Take bytes and return the replies that they complete."""


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


def bit_names(bits: int, names: Mapping[int, str]) -> tuple[str, ...]:
    """Return the maker's names of the bits that are set; unknown ones in hexadecimal."""
    known = tuple(name for bit, name in names.items() if bits & bit)
    rest = bits & ~sum(names)
    return (*known, hex(rest)) if rest else known


class Telemetry(NamedTuple):
    """
    What the drive has reported so far; None where it has not, or cannot.

    A value appears here only after a reply that passed every check of its protocol.
    """

    time: Optional[float] = None  # of the driver's clock, when the position arrived [s]
    # When the request was sent that the position answers [s]; None where that is not known, or too
    # long ago.  Such a position is no measurement.
    measured: Optional[float] = None
    position: Optional[float] = None  # of the motor shaft, goes on over full turns [rad]
    velocity: Optional[float] = None  # of the motor shaft [rad/s]
    current: Optional[float] = None  # that makes torque [A]
    bus_voltage: Optional[float] = None  # [V]
    bus_current: Optional[float] = None  # from the supply, negative while braking feeds it [A]
    temperature: Optional[float] = None  # of the power stage [degC]
    motor_temperature: Optional[float] = None  # [degC]
    status_time: Optional[float] = None  # when armed and faults arrived [s]
    armed: Optional[bool] = None  # the motor is under power
    faults: tuple[str, ...] = ()  # names that the maker gives them; the motor has no power
    warnings: tuple[str, ...] = ()  # likewise, that the drive gives before it limits
    # Why an armed motor must be stopped although the drive reports no fault: commands of another
    # sender, settings that have changed.
    hazards: tuple[str, ...] = ()


@dataclass(frozen=True)
class DriveOptions(Checked):
    """The options of every driver; each protocol adds its own."""

    torque_limit: float = quantity(
        'N m', 'largest torque ever sent, at the motor shaft', above=0.0)
    speed_limit: float = quantity(
        'rad/s', 'speed of the motor shaft up to which the robot needs its torque: limits of the '
        'drive that cut earlier are refused; 0 if not known', default=0.0, minimum=0.0)
    drive_torque_limit: float = quantity(
        'N m', 'up to which the limits of the drive itself may be set; torque_limit where that is '
        'more', default=0.0, minimum=0.0)
    watchdog: float = quantity(
        's', 'time without a command after which the drive must disarm by itself', default=0.1,
        above=0.0, maximum=10.0)
    reply_timeout: float = quantity(
        's', 'time after which a reply counts as lost', default=0.05, above=0.0, maximum=10.0)

    @property
    def own_limit(self) -> float:
        """Return the largest torque that the limits of the drive itself may let through [N m]."""
        return max(self.torque_limit, self.drive_torque_limit)


# A byte on the wire: one start bit, eight of data, one stop bit.
BITS_PER_BYTE = 10


class WireBudget(NamedTuple):
    """
    What one control period puts on the line.

    Attributes
    ----------
    bytes_out, bytes_in : int
        To and from the drive, the longest there can be.
    turnaround : float
        Time from the last byte of a request to the first of its reply [s].

    """

    bytes_out: int
    bytes_in: int
    turnaround: float = 0.0

    def duration(self, baud: float) -> float:
        """
        Return how long one exchange takes [s]: out, turnaround and in, one after the other.

        A line is duplex, so the next request could overlap the last reply; a loop that counts
        on this gets its measurements one period late.
        """
        return (self.bytes_out + self.bytes_in) * BITS_PER_BYTE / baud + self.turnaround

    def highest_rate(self, baud: float) -> float:
        """Return the highest rate at which each period sees the reply to its request [Hz]."""
        return 1.0 / self.duration(baud)

    def least_baud(self, rate: float) -> float:
        """Return the lowest baud rate for a loop rate [Hz]; infinite where none is enough."""
        left = 1.0 / rate - self.turnaround
        return (self.bytes_out + self.bytes_in) * BITS_PER_BYTE / left if left > 0.0 \
            else float('inf')
