# SPDX-License-Identifier: Apache-2.0
"""Source of stamped readings: it configures a sensor on a serial port, and reconnects to it."""
from collections import Counter
from dataclasses import dataclass
import logging
import math
import time
from typing import Callable, List, NamedTuple, Optional

from ballbot_ros.clock import steady_time
from ballbot_ros.config.fields import Checked, count, quantity, text
from ballbot_ros.drives.contract import SerialLine
from ballbot_ros.drives.transport import Link
from ballbot_ros.errors import ConfigurationError, LinkError
from ballbot_ros.imus import IMUS, sensor_class
from ballbot_ros.imus.contract import InertialReading, InertialSensor, Vector
from ballbot_ros.imus.plausibility import EXPLANATIONS, LONGEST_REPETITION

LOG = logging.getLogger(__name__)

# Without a reading for this long, the sensor is configured again at the other baud rate [s].
READING_TIMEOUT = 0.5
# Time between two attempts to open the port [s].
REOPEN_PERIOD = 0.5
# Time between two commands to a sensor [s].
COMMAND_PERIOD = 0.02
# Largest correction by `ArrivalClock` per period, in periods, for a slow clock of a sensor.
CLOCK_DRIFT_MAX = 0.01
# A delay of more periods than this means lost readings: `ArrivalClock` restarts at the arrival.
LOST_PERIODS = 4.0
AXES = {'x': 0, 'y': 1, 'z': 2}


@dataclass(frozen=True)
class ImuPort(Checked):
    """A sensor on a serial port, and its axes in the shell."""

    sensor: str = text('vendor of the sensor', default='witmotion', choices=IMUS)
    port: str = text(
        'serial device or URL, preferably in /dev/serial/by-id, that the bridge reads itself; '
        'empty for the topic `imu`', default='')
    baud: int = count(
        'bits per second; a sensor at the factory default, 9600, is switched to it',
        default=115200, minimum=4800, maximum=4_000_000)
    rate: int = count(
        'readings per second; WitMotion: 10, 20, 50, 100 or 200', default=200, minimum=1,
        maximum=10_000)
    bandwidth: int = count(
        'bandwidth of the filters in the sensor [Hz]; WitMotion: 5, 10, 20, 42, 98, 188 or 256',
        default=98, minimum=1, maximum=10_000)
    axes: str = text(
        'axes of the sensor that point forward, left and up while the shell is at ball angle 0, '
        'such as `-y x z`', default='x y z')
    latency: float = quantity(
        's', 'time from the motion to the first byte that reports it; the filters of 98 Hz '
        'take 0.003', default=0.003, minimum=0.0, maximum=0.1)
    gyro_sd: float = quantity(
        'rad/s', 'standard deviation of the gyro per reading, for the covariance of its messages',
        default=0.005, above=0.0, maximum=10.0)
    force_sd: float = quantity(
        'm/s2', 'standard deviation of the accelerometer per reading, likewise', default=0.05,
        above=0.0, maximum=10.0)


class StampedReading(NamedTuple):
    """A reading in the axes of the shell."""

    stamp: float  # of `steady_time` [s]
    turn_rate: Vector  # about forward, left, up [rad/s]
    force: Vector  # along the same axes [m/s2]
    saturated: bool


class Axes:
    """
    Rotates measurements of a sensor into the axes of the shell: forward, left, up.

    The words name the axes of the sensor that point there: ``'-y x z'`` where its y axis points
    backward and its x axis to the left.  Raises `ConfigurationError` if an axis is missing or
    given twice, or the axes are left-handed.
    """

    def __init__(self, words: str):
        pairs = [(word.lstrip('+-'), -1.0 if word.startswith('-') else 1.0)
                 for word in words.split()]
        if sorted(name for name, _ in pairs) != sorted(AXES):
            raise ConfigurationError(
                "axes must be three of x, y, z and their opposites, such as 'x y z' or '-y x z', "
                f'got {words!r}', 'not_a_choice', 'axes')
        self._from = tuple(AXES[name] for name, _ in pairs)
        self._signs = tuple(sign for _, sign in pairs)
        even = self._from in ((0, 1, 2), (1, 2, 0), (2, 0, 1))
        if math.prod(self._signs) * (1.0 if even else -1.0) < 0.0:
            raise ConfigurationError(
                f'axes {words!r} are left-handed, which is not a rotation: change the sign of one',
                'inconsistent', 'axes')

    def turned(self, vector: Vector) -> Vector:
        """Return a vector of the sensor in the axes of the shell."""
        (i, j, k), (a, b, c) = self._from, self._signs
        return a * vector[i], b * vector[j], c * vector[k]


class ArrivalClock:
    """
    Estimates the time at which each reading was sent, for a period between readings [s].

    The sensor sends at even intervals of its own clock; readings arrive delayed by the line, the
    USB adapter and the scheduler, never early.  So the send times are a straight line below all
    arrivals: an earlier arrival moves the line down immediately, a later one moves it up slowly.
    """

    def __init__(self, period: float):
        self._period, self._last = period, -math.inf

    def sent(self, arrival: float) -> float:
        """
        Return the time at which a reading was sent from that of its arrival [s].

        The result does not decrease.
        """
        expected = self._last + self._period
        late = arrival - expected
        if late > LOST_PERIODS * self._period:
            self._last = arrival
        else:
            self._last = max(expected + min(late, CLOCK_DRIFT_MAX * self._period), self._last)
        return self._last


def open_source(port: ImuPort) -> 'ImuSource':
    """Return the source of a port; it is opened by the first read."""
    return ImuSource(sensor_class(port.sensor)(port.baud, port.rate, port.bandwidth),
                     lambda baud: Link(port.port, baud), Axes(port.axes), port.latency)


class ImuSource:
    """
    Reads a sensor; one thread owns it.

    `connect` opens the port at a baud rate: that of the sensor, or the factory default until it is
    changed.  The latency is from the measurement to the first byte of its reading, mostly that of
    its filters [s].  `counts` are ``readings``, ``refused``, ``skipped`` and ``unpaired`` of all
    connections together, ``saturated`` and ``frozen`` readings, ``lost`` ports, and configurations
    (``set_up``); `trouble` is the reason why there are no readings.
    """

    def __init__(self, sensor: InertialSensor, connect: Callable[[int], SerialLine], axes: Axes,
                 latency: float):
        self._sensor, self._connect = sensor, connect
        self.read_as(axes, latency)
        self._longest_repetition = round(LONGEST_REPETITION * sensor.rate)
        self.counts: Counter[str] = Counter(
            readings=0, refused=0, skipped=0, unpaired=0, saturated=0, frozen=0, lost=0, set_up=0)
        self.trouble = 'not opened yet'
        self._line: Optional[SerialLine] = None
        self._baud, self._open_at, self._received_at = sensor.baud, 0.0, 0.0
        self._restart()

    def read_as(self, axes: Axes, latency: float) -> None:
        """Change mounting and latency [s]."""
        # A reading is complete when its last bit has arrived.
        self._axes, self._delay = axes, latency + self._sensor.reading_bits / self._sensor.baud

    def read(self, timeout: float) -> List[StampedReading]:
        """Return the readings that arrive within a time [s], possibly none; raise nothing."""
        try:
            if self._line is None:
                return self._open(timeout)
            if not self._line.wait(timeout):
                return self._check_timeout(self._line)
            arrival, data = steady_time(), self._line.read()
            return self._take(self._line, data, arrival)
        except LinkError as error:
            self._disconnect(str(error))
            return []

    def close(self) -> None:
        """Close the line."""
        line, self._line = self._line, None
        if line is not None:
            line.close()

    def _open(self, timeout: float) -> List[StampedReading]:
        now = steady_time()
        if now < self._open_at:
            time.sleep(min(timeout, self._open_at - now))
            return []
        self._open_at = now + REOPEN_PERIOD
        self._line = self._connect(self._baud)
        self._restart()
        self._write(self._line, self._sensor.configure(self._baud))
        self._received_at = steady_time()
        return []

    def _restart(self) -> None:
        self._parser, self._arrivals = self._sensor.parser(), ArrivalClock(1.0 / self._sensor.rate)
        self._last: Optional[InertialReading] = None
        self._repetitions = 0

    def _write(self, line: SerialLine, commands: List[bytes]) -> None:
        self.counts['set_up'] += 1
        for command in commands:
            line.write(command)
            time.sleep(COMMAND_PERIOD)

    def _take(self, line: SerialLine, data: bytes, arrival: float) -> List[StampedReading]:
        before = Counter(self._parser.counts)
        readings = self._parser.feed(data)
        self.counts.update(self._parser.counts - before)
        if not readings:
            return self._check_timeout(line)
        self._received_at = arrival
        if self._baud != self._sensor.baud:
            LOG.info('sensor found at %d baud, changed to %d', self._baud, self._sensor.baud)
            self._write(line, self._sensor.change_baud())
            self._change_baud(self._sensor.baud)
            return []
        found = []
        for after, reading in zip(reversed(range(len(readings))), readings):
            self._repetitions = self._repetitions + 1 if reading == self._last else 0
            self._last = reading
            # Readings that arrive together were sent at intervals of a period.
            stamp = self._arrivals.sent(arrival - after / self._sensor.rate) - self._delay
            self.counts['saturated'] += reading.saturated
            if self._repetitions >= self._longest_repetition:
                self.counts['frozen'] += 1
                self.trouble = EXPLANATIONS['imu_frozen']
                continue
            self.trouble = ''
            found.append(StampedReading(
                stamp, self._axes.turned(reading.turn_rate), self._axes.turned(reading.force),
                reading.saturated))
        return found

    def _check_timeout(self, line: SerialLine) -> List[StampedReading]:
        """Change to the other baud rate when no readings arrive."""
        if steady_time() - self._received_at > READING_TIMEOUT:
            self.trouble = (
                f'no readings at {self._baud} baud on {line.port}'
                + (': bytes arrive, but none are valid' if self._parser.counts['skipped'] else ''))
            wanted = self._sensor.baud
            self._change_baud(self._sensor.factory_baud if self._baud == wanted else wanted)
        return []

    def _change_baud(self, baud: int) -> None:
        self.close()
        self._baud, self._open_at = baud, 0.0

    def _disconnect(self, why: str) -> None:
        """Continue without a port until it can be opened again."""
        if why != self.trouble:
            LOG.warning('%s', why)
        self.counts['lost'] += self._line is not None
        self.trouble = why
        self.close()
