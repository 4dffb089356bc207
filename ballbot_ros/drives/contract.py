# SPDX-License-Identifier: Apache-2.0
"""
The contract between a motor controller's driver and the rest of the package.

All quantities are those of the motor shaft, SI: torque [N m], position [rad], velocity [rad/s];
the caller handles gear, direction and zero of the pendulum joint.  A session::

    driver = open_driver(protocol, link, options)
    driver.identify()                   # the handshake; raises DriveError without a reply
    driver.read_settings()              # settings of the drive, and whether they are acceptable
    driver.arm()
    each period:
        telemetry = driver.poll()       # received data; never waits
        driver.send_torque(torque)      # one write: the command and the next requests
    driver.stop()                       # repeated until the drive confirms

`identify`, `read_settings`, `arm`, `stop` and `clear_faults` wait for answers, never longer than
their ``timeout``.  `poll`, `send_torque`, `send_stop`, `ask` and `feed` do not wait: a reply that
is delayed or lost is counted and requested again.  Each of them raises `LinkError` when the line
is gone; then close the link and open it again.

`Driver` in driver.py is the base class that keeps this contract for all protocols: torque only
while armed, finite and within the limit; a stop repeated until it is confirmed.
"""
from collections import Counter
from dataclasses import dataclass
import math
from typing import Any, Mapping, NamedTuple, Optional, Protocol

from ballbot_ros.config.fields import Checked, quantity


# Multiple of the speed limit at which the bridge disables motor power.
RUNAWAY = 1.5


class SerialLine(Protocol):
    """Interface of a line, which `Link`, `CanLink` and `MemoryLine` implement."""

    port: str

    def write(self, data: bytes) -> None:
        """Write all data."""

    def read(self) -> bytes:
        """Return the received data, without waiting."""

    def wait(self, seconds: float, least: int = 1) -> bool:
        """
        Wait for bytes and return whether there are any [s].

        Where supported, fewer than `least` since the last write do not end the wait.
        """

    def close(self) -> None:
        """Close the line; closing twice is allowed."""


class StreamParser(Protocol):
    """Finds the replies in the data of a drive; `counts` covers the remaining data."""

    counts: Counter[str]

    def feed(self, data: bytes) -> list[Any]:
        """Parse bytes and return the replies that they complete."""


class Identity(NamedTuple):
    """Drive that replied to the handshake."""

    protocol: str
    hardware: str
    firmware: str
    serial_number: str = ''
    generation: str = ''  # of the firmware, where the protocol depends on it

    @property
    def in_words(self) -> str:
        """Return the identity as text."""
        with_serial = f' {self.serial_number}' if self.serial_number else ''
        generation = f', generation {self.generation}' if self.generation else ''
        return (f'{self.protocol} {self.hardware}{with_serial}, firmware {self.firmware}'
                f'{generation}')


class Setting(NamedTuple):
    """A safety-relevant setting of the drive: actual and required value."""

    name: str
    value: str  # as read, with its unit; ``'unknown'`` if the drive does not report it
    wanted: str  # required value, as text
    acceptable: bool
    remedy: str = ''  # how to make it acceptable


def bit_names(bits: int, names: Mapping[int, str]) -> tuple[str, ...]:
    """Return the maker's names of the bits that are set; unknown ones in hexadecimal."""
    known = tuple(name for bit, name in names.items() if bits & bit)
    rest = bits & ~sum(names)
    return (*known, hex(rest)) if rest else known


class Hazard(NamedTuple):
    """Reason to stop an armed motor although the drive reports no fault."""

    setting: str  # the changed one; empty for commands of another sender
    text: str


class Telemetry(NamedTuple):
    """
    Values that the drive has reported; None if not reported, or not supported.

    Each value comes from a reply that passed all checks of its protocol.
    """

    time: Optional[float] = None  # of the driver's clock, when the position arrived [s]
    # When the request of the position was sent [s]; None if that is unknown or too long ago: such
    # a position is not a measurement.
    measured: Optional[float] = None
    position: Optional[float] = None  # of the motor shaft, not wrapped [rad]
    velocity: Optional[float] = None  # of the motor shaft [rad/s]
    current: Optional[float] = None  # of the motor, torque-producing [A]
    bus_voltage: Optional[float] = None  # [V]
    bus_current: Optional[float] = None  # from the supply, negative while braking feeds it [A]
    temperature: Optional[float] = None  # of the power stage [degC]
    motor_temperature: Optional[float] = None  # [degC]
    status_time: Optional[float] = None  # when armed and faults arrived [s]
    armed: Optional[bool] = None  # the motor is under power
    faults: tuple[str, ...] = ()  # the maker's names; the motor has no power
    warnings: tuple[str, ...] = ()  # the maker's names, such as of an active limit
    hazards: tuple[Hazard, ...] = ()


@dataclass(frozen=True)
class DriveOptions(Checked):
    """The options of every driver; each protocol adds its own."""

    torque_limit: float = quantity(
        'N m', 'largest torque ever sent, at the motor shaft', above=0.0)
    speed_limit: float = quantity(
        'rad/s', 'speed of the motor shaft up to which the robot needs its torque: limits of the '
        'drive that act at a lower speed are refused; 0 if unknown', default=0.0, minimum=0.0)
    drive_torque_limit: float = quantity(
        'N m', 'largest torque that the limits of the drive itself may allow; torque_limit if '
        'that is larger', default=0.0, minimum=0.0)
    watchdog: float = quantity(
        's', 'time without a command after which the drive must disarm by itself', default=0.1,
        above=0.0, maximum=10.0)
    reply_timeout: float = quantity(
        's', 'time after which a reply counts as lost', default=0.05, above=0.0, maximum=10.0)

    @property
    def own_limit(self) -> float:
        """Return the largest torque that the limits of the drive itself may allow [N m]."""
        return max(self.torque_limit, self.drive_torque_limit)


def shown(value: float, unit: str) -> str:
    """Return the value of a setting with its unit, ``unknown`` for NaN."""
    return 'unknown' if math.isnan(value) else f'{value:.4g} {unit}'


def judge_torque(ceiling: float, options: DriveOptions, remedy: str) -> Setting:
    """Check the largest torque that the limits of the drive itself allow [N m]."""
    return Setting('torque limit', shown(ceiling, 'N m'), f'at most {options.own_limit:.4g} N m',
                   ceiling <= 1.01 * options.own_limit, remedy)


# A byte on the wire: one start bit, eight data bits, one stop bit.
BITS_PER_BYTE = 10


class WireBudget(NamedTuple):
    """Traffic of one control period on the line."""

    bytes_out: int  # at most, to the drive
    bytes_in: int  # at most, from the drive

    def duration(self, baud: float) -> float:
        """
        Return the duration of one exchange [s]: first the request, then the reply.

        A line is duplex, so the next request could overlap the last reply; the measurements of
        such a loop would be delayed by one period.
        """
        return (self.bytes_out + self.bytes_in) * BITS_PER_BYTE / baud

    def highest_rate(self, baud: float) -> float:
        """Return the highest rate at which each period receives the reply to its request [Hz]."""
        return 1.0 / self.duration(baud)
