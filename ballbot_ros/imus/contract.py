# SPDX-License-Identifier: Apache-2.0
"""
The contract between an inertial sensor's protocol and the rest of the package.

A sensor that sends unrequested readings, at a fixed rate, over a serial port: `ImuSource` opens
the port, configures the sensor, and reads from it; `InertialSensor` has the vendor's protocol
for this.  All quantities are SI, in the sensor's own axes.
"""
from abc import ABC, abstractmethod
from collections import Counter
from typing import ClassVar, List, NamedTuple, Protocol, Tuple

Vector = Tuple[float, float, float]


class InertialReading(NamedTuple):
    """A measurement of a sensor, in its own axes."""

    turn_rate: Vector  # [rad/s]
    force: Vector  # specific force: at rest g upwards [m/s2]
    saturated: bool  # a value is at the end of the sensor's range


class ReadingParser(Protocol):
    """Finds readings in the data of a sensor."""

    # ``readings``; ``refused`` packets with a wrong checksum, ``skipped`` bytes that belong to no
    # packet, ``unpaired`` forces or turn rates without the other.
    counts: Counter[str]

    def feed(self, data: bytes) -> List[InertialReading]:
        """Take bytes and return the readings that they complete."""


class InertialSensor(ABC):
    """
    The protocol of one vendor's sensors, for a chosen baud rate, rate and bandwidth.

    These are in bit/s, readings per second [Hz], and that of the filters in the sensor [Hz].  The
    vendor's class raises `ConfigurationError`: ``not_a_choice`` if the sensor has no such baud
    rate, rate or bandwidth; ``inconsistent`` if the readings need a higher baud rate.
    """

    factory_baud: ClassVar[int]  # to which a sensor without power returns [bit/s]
    reading_bits: ClassVar[int]  # of one reading on the line, with start and stop bits

    def __init__(self, baud: int, rate: int, bandwidth: int):
        self.baud, self.rate, self.bandwidth = baud, rate, bandwidth

    @abstractmethod
    def configure(self, baud: int) -> List[bytes]:
        """Return the commands for rate and bandwidth, as far as a baud rate carries them."""

    @abstractmethod
    def change_baud(self) -> List[bytes]:
        """Return the commands that change the baud rate to the chosen one."""

    @abstractmethod
    def parser(self) -> ReadingParser:
        """Return a new parser."""


class EmulatedSensor(ABC):
    """A sensor in software: time in, bytes out."""

    # Measured values, in the axes of the sensor [rad/s], [m/s2].
    turn_rate: Vector = (0.0, 0.0, 0.0)
    force: Vector = (0.0, 0.0, 9.81)

    @property
    @abstractmethod
    def baud(self) -> int:
        """Return the baud rate that it uses; at another one neither side understands the other."""

    @abstractmethod
    def receive(self, data: bytes) -> None:
        """Take commands."""

    @abstractmethod
    def tick(self, now: float) -> bytes:
        """Return the bytes that it sends at a time [s]: none, or one reading."""
