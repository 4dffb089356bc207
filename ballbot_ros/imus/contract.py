# SPDX-License-Identifier: Apache-2.0
"""
The contract between an inertial sensor's protocol and the rest of the package.

A sensor sends unrequested readings over a serial port, at a fixed rate.  `ImuSource` opens the
port, configures the sensor, and reads from it; `InertialSensor` implements the vendor's protocol.
All quantities are SI, in the sensor's own axes.
"""
from abc import ABC, abstractmethod
from typing import ClassVar, List, NamedTuple, Tuple

from ballbot_ros.drives.contract import StreamParser

Vector = Tuple[float, float, float]


class InertialReading(NamedTuple):
    """A measurement of a sensor, in its own axes."""

    turn_rate: Vector  # [rad/s]
    force: Vector  # specific force: at rest g upwards [m/s2]
    saturated: bool  # a value is at the limit of the sensor's range


class InertialSensor(ABC):
    """
    The protocol of one vendor's sensors, at a baud rate, with a rate and a bandwidth.

    `baud` is in bit/s, `rate` in readings per second, the `bandwidth` of the sensor's filters in
    Hz.  The vendor's class raises `ConfigurationError`: ``not_a_choice`` if the sensor has no such
    baud rate, rate or bandwidth; ``inconsistent`` if the readings need a higher baud rate.
    """

    factory_baud: ClassVar[int]  # of a sensor after a loss of power [bit/s]
    reading_bits: ClassVar[int]  # bits per reading on the line, with start and stop bits

    def __init__(self, baud: int, rate: int, bandwidth: int):
        self.baud, self.rate, self.bandwidth = baud, rate, bandwidth

    @abstractmethod
    def configure(self, baud: int) -> List[bytes]:
        """Return the commands that set rate and bandwidth, the rate within a baud rate."""

    @abstractmethod
    def change_baud(self) -> List[bytes]:
        """Return the commands that change the baud rate to the chosen one."""

    @abstractmethod
    def parser(self) -> StreamParser:
        """
        Return a new parser of `InertialReading`.

        Its `counts` are ``readings``; ``refused`` packets with a wrong checksum, ``skipped`` bytes
        that belong to no packet, ``unpaired`` forces or turn rates without the other.
        """


class EmulatedSensor(ABC):
    """An emulated sensor: time in, bytes out."""

    # Measured values, in the axes of the sensor [rad/s], [m/s2].
    turn_rate: Vector = (0.0, 0.0, 0.0)
    force: Vector = (0.0, 0.0, 9.81)

    @property
    @abstractmethod
    def baud(self) -> int:
        """Return the baud rate in use; at another one, neither side receives valid data."""

    @abstractmethod
    def receive(self, data: bytes) -> None:
        """Execute received commands."""

    @abstractmethod
    def tick(self, now: float) -> bytes:
        """Return the bytes that it sends at a time [s]: none, or one reading."""
