# SPDX-License-Identifier: Apache-2.0
"""Readings from a serial line, whatever happens to it: found, set up, stamped, found again."""
from collections import Counter
import logging
import time
from typing import Callable, List, NamedTuple, Optional

from ballbot_ros.drives.contract import SerialLine
from ballbot_ros.errors import ConfigurationError, LinkError
from ballbot_ros.imus.arrival import ArrivalClock
from ballbot_ros.imus.axes import Axes
from ballbot_ros.imus.witmotion import (
    change_baud, FACTORY_BAUD, InertialReading, least_baud, ReadingParser, settings, Vector)

LOG = logging.getLogger(__name__)

# After so long without a reading the sensor is set up anew, at the other baud rate [s].
SILENCE = 0.5
# Between two tries to open the port [s].
AGAIN = 0.5
# A sensor takes one command after the other [s].
SETTLE = 0.02
# A sensor whose readings are all alike for so long measures nothing [s].
FROZEN = 0.25


class StampedReading(NamedTuple):
    """A reading in the axes of the shell."""

    stamp: float  # of the steady clock [s]
    turn_rate: Vector  # about forward, left, up [rad/s]
    force: Vector  # along these [m/s2]
    saturated: bool


class ImuSource:
    """
    Reads a WitMotion sensor; one thread owns it.

    Parameters
    ----------
    connect : callable
        Opens the line at a baud rate.
    baud : int
        At which it is read; a sensor found at the rate of the factory is told to change.
    rate, bandwidth : int
        It is told to use [Hz].
    axes : Axes
    latency : float
        From the measurement to the first byte of its packet, of its filter above all [s].
    clock, sleep : callable
        Steady, in seconds.

    Attributes
    ----------
    counts : Counter
        ``readings``, ``refused``, ``skipped`` and ``unpaired`` of all lines together,
        ``saturated`` and ``frozen`` readings, lines that were ``lost``, ``set_up`` sensors.
    trouble : str
        Why there are no readings; empty while there are.

    Raises
    ------
    ConfigurationError
        If the sensor has no such rate, bandwidth or baud rate, or these do not go together.

    """

    def __init__(self, connect: Callable[[int], SerialLine], baud: int, rate: int, bandwidth: int,
                 axes: Axes, latency: float, clock: Callable[[], float] = time.monotonic,
                 sleep: Callable[[float], None] = time.sleep):
        """Start without a line."""
        change_baud(baud)
        self._settings, self._at_factory = settings(rate, bandwidth), settings(10, bandwidth)
        if least_baud(rate) > baud:
            raise ConfigurationError(
                f'{rate} readings a second take {least_baud(rate):.0f} bit/s, and the line has '
                f'{baud}: raise baud or lower rate')
        self._connect, self._wanted = connect, baud
        self.read_as(axes, latency)
        self._clock, self._sleep = clock, sleep
        self._arrivals, self._frozen_after = ArrivalClock(1.0 / rate), round(FROZEN * rate)
        self.counts: Counter[str] = Counter(
            readings=0, refused=0, skipped=0, unpaired=0, saturated=0, frozen=0, lost=0, set_up=0)
        self.trouble = 'not opened yet'
        self._line: Optional[SerialLine] = None
        self._parser = ReadingParser()
        self._baud, self._try_at, self._heard = baud, 0.0, 0.0
        self._last: Optional[InertialReading] = None
        self._alike = 0

    def read_as(self, axes: Axes, latency: float) -> None:
        """Read as a sensor that is mounted otherwise, or is later [s]."""
        # Both packets are on the wire before the reading is there.
        self._axes, self._before = axes, latency + least_baud(1) / self._wanted

    def read(self, patience: float) -> List[StampedReading]:
        """Return what comes within so many seconds [s], at least in part; nothing is raised."""
        try:
            if self._line is None:
                return self._open(patience)
            if not self._line.wait(patience):
                return self._look_after(self._line)
            arrival, data = self._clock(), self._line.read()
            return self._take(self._line, data, arrival)
        except LinkError as error:
            self._lose(str(error))
            return []

    def close(self) -> None:
        """Close the line."""
        line, self._line = self._line, None
        if line is not None:
            line.close()

    def _open(self, patience: float) -> List[StampedReading]:
        now = self._clock()
        if now < self._try_at:
            self._sleep(min(patience, self._try_at - now))
            return []
        self._try_at = now + AGAIN
        self._line = self._connect(self._baud)
        self._parser, self._last, self._alike = ReadingParser(), None, 0
        self._arrivals.reset()
        # Where the line is slow, no more than it carries.
        self._write(self._line, self._settings if self._baud == self._wanted
                    else self._at_factory)
        self._heard = self._clock()
        return []

    def _write(self, line: SerialLine, commands: List[bytes]) -> None:
        self.counts['set_up'] += 1
        for command in commands:
            line.write(command)
            self._sleep(SETTLE)

    def _take(self, line: SerialLine, data: bytes, arrival: float) -> List[StampedReading]:
        before = Counter(self._parser.counts)
        readings = self._parser.feed(data)
        self.counts.update(self._parser.counts - before)
        if not readings:
            return self._look_after(line)
        self._heard = arrival
        if self._baud != self._wanted:
            LOG.info('sensor at %d baud: told to use %d', self._baud, self._wanted)
            self._write(line, change_baud(self._wanted))
            self._change_baud(self._wanted)
            return []
        found = []
        for reading in readings:
            # A sensor counts in noise: the same numbers again and again are no measurement.
            self._alike = self._alike + 1 if reading == self._last else 0
            self._last = reading
            stamp = self._arrivals.sent(arrival) - self._before
            self.counts['saturated'] += reading.saturated
            if self._alike >= self._frozen_after:
                self.counts['frozen'] += 1
                self.trouble = 'the sensor sends the same numbers again and again'
                continue
            self.trouble = ''
            found.append(StampedReading(
                stamp, self._axes.turned(reading.turn_rate), self._axes.turned(reading.force),
                reading.saturated))
        return found

    def _look_after(self, line: SerialLine) -> List[StampedReading]:
        """Try another baud rate where nothing comes that makes sense."""
        if self._clock() - self._heard > SILENCE:
            self.trouble = (
                f'no readings at {self._baud} baud on {line.port}'
                + (': bytes come that make no sense' if self._parser.counts['skipped'] else ''))
            self._change_baud(
                FACTORY_BAUD if self._baud == self._wanted else self._wanted)
        return []

    def _change_baud(self, baud: int) -> None:
        self.close()
        self._baud, self._try_at = baud, 0.0

    def _lose(self, why: str) -> None:
        """Go on without a line, until there is one."""
        if why != self.trouble:
            LOG.warning('%s', why)
        self.counts['lost'] += self._line is not None
        self.trouble = why
        self.close()
