# SPDX-License-Identifier: Apache-2.0
"""
The last ten minutes of a session in memory, to be looked at after a fault.

Records of a few dozen bytes follow each other in blocks of 64 KiB; the oldest block goes when
there are too many, or when it is too old.  So memory is bounded, and what a record costs is one
`struct.pack_into`.  `KINDS` is the only table of them: a file carries a copy of it, and whoever
reads the file needs nothing else (`ballbot_ros.black_box.reader`).
"""
from collections import deque
import math
import struct
import threading
import time
from types import MappingProxyType
from typing import Callable, Deque, List, Mapping, NamedTuple, Optional, Tuple, Union

from ballbot_ros.bridge.motor_state import MotorState
from ballbot_ros.bridge.supervisor import Supervisor
from ballbot_ros.control import Mode, SetPoint
from ballbot_ros.drives.contract import Telemetry
from ballbot_ros.errors import MessageError
from ballbot_ros.estimation import Estimate, ImuReading

# What is kept: so long [s], and so much at most [bytes]; at 500 Hz the time comes first.
SPAN = 600.0
BLOCK, MOST_BLOCKS = 65536, 1024
# What changes slowly is noted so often [s]; a refusal that comes again and again, too.
SLOW = 0.1
# A tick without a measurement is noted where nothing else was for so many periods.
BETWEEN = 0.9
# Longest piece of traffic or text in one record [bytes].
MOST_TAIL = 8192

NOTE, EVENT, FAULT = 0, 1, 2  # weight of an event: a line of the log, a change, what is dumped
# What a command or set-point is of: name and unit.
COMMANDS = (('torque', 'N m'), ('no torque', ''), ('pendulum angle', 'rad'),
            ('joint rate', 'rad/s'), ('speed', 'm/s'))
TORQUE = 0
MODES = {Mode.IDLE: 1, Mode.HOLD: 2, Mode.DRIVE: 3, Mode.SPEED: 4}
# Bits of `flags` above the two that hold the state of the motor.
E_STOP, TIMED_OUT, COMMANDED = 4, 8, 16
STATES = (MotorState.DISCONNECTED, MotorState.DISARMED, MotorState.ARMED, MotorState.STOPPING)


class RecordKind(NamedTuple):
    """A kind of record: name and unit of each number, and what stands behind them."""

    name: str
    layout: str  # of `struct`, after the number of the kind; the length of the tail comes last
    fields: Tuple[Tuple[str, str], ...]
    tail: str = ''  # '', 'bytes' or 'text'


KINDS: Mapping[int, RecordKind] = MappingProxyType({
    1: RecordKind('period', '<BdddfffffffB', (
        ('time', 's'), ('joint_angle', 'rad'), ('ball_angle', 'rad'), ('pendulum_angle', 'rad'),
        ('joint_rate', 'rad/s'), ('ball_rate', 'rad/s'), ('angle_sd', 'rad'),
        ('asked', 'N m'), ('torque', 'N m'), ('current', 'A'), ('flags', ''))),
    2: RecordKind('drive', '<Bdffff', (
        ('time', 's'), ('bus_voltage', 'V'), ('bus_current', 'A'), ('temperature', 'degC'),
        ('motor_temperature', 'degC'))),
    3: RecordKind('command', '<BddfB', (
        ('time', 's'), ('stamp', 's'), ('value', ''), ('what', ''))),
    4: RecordKind('imu', '<Bdfff', (
        ('time', 's'), ('turn_rate', 'rad/s'), ('forward', 'm/s2'), ('upward', 'm/s2'))),
    5: RecordKind('to_drive', '<BdH', (('time', 's'),), 'bytes'),
    6: RecordKind('from_drive', '<BdH', (('time', 's'),), 'bytes'),
    7: RecordKind('event', '<BdBH', (('time', 's'), ('weight', '')), 'text'),
})
PERIOD, DRIVE, COMMAND, IMU, TO_DRIVE, FROM_DRIVE, TOLD = KINDS
STRUCTS = {number: struct.Struct(kind.layout) for number, kind in KINDS.items()}
_PERIOD, _DRIVE, _COMMAND, _IMU = (STRUCTS[kind] for kind in (PERIOD, DRIVE, COMMAND, IMU))
_PIECE, _TOLD = STRUCTS[TO_DRIVE], STRUCTS[TOLD]


class Witness:
    """What a session tells of what happens; this one keeps nothing."""

    def period(self, now: float, estimate: Optional[Estimate], supervisor: Supervisor,
               telemetry: Telemetry, state: MotorState) -> None:
        """See what a period of the loop has found."""

    def command(self, value: float, stamp: float, what: int = TORQUE) -> None:
        """See a command; `what` is its place in `COMMANDS`."""

    def set_point(self, given: SetPoint) -> None:
        """See a set-point."""
        self.command(given.value, given.stamp, MODES[given.mode])

    def imu(self, reading: ImuReading) -> None:
        """See an IMU reading."""

    def record(self, direction: str, data: bytes) -> None:
        """See traffic of the line, as `drives.capture.Recorder` does."""

    def tell(self, text: str, weight: int = EVENT) -> None:
        """Hear of an event; of a `FAULT` a file is to be written."""

    def refused(self, what: str, error: MessageError) -> None:
        """Hear that a message was refused, and why."""

    def wished(self, reason: str) -> None:
        """Hear that a person engages the e-stop, for a reason: that is no fault."""


class BlackBox(Witness):
    """
    Keeps what it sees, in a bounded piece of memory; may be used from any thread.

    Parameters
    ----------
    clock : callable
        That of the session [s].
    period : float
        Of its loop [s].

    Attributes
    ----------
    faulted : threading.Event
        Set when something has happened of which a file is to be written.

    """

    def __init__(self, clock: Callable[[], float] = time.monotonic, period: float = 0.002):
        """Begin with nothing seen."""
        self.clock = clock
        self.faulted = threading.Event()
        self._between = BETWEEN * period
        self._lock = threading.Lock()
        self._full: Deque[Tuple[float, memoryview]] = deque(maxlen=MOST_BLOCKS - 1)
        self._block, self._at, self._begun = bytearray(BLOCK), 0, clock()
        self._fault: Optional[Tuple[float, str]] = None
        self._slow_at = -math.inf
        self._e_stop: Optional[str] = None
        self._flags, self._seen = 0, -math.inf
        self._wish = ''
        self._faults: Tuple[str, ...] = ()
        self._refusals: dict[str, Tuple[float, int]] = {}

    # What is seen

    def period(self, now: float, estimate: Optional[Estimate], supervisor: Supervisor,
               telemetry: Telemetry, state: MotorState) -> None:
        """See what a period of the loop has found; one without a measurement is one of nan."""
        flags = STATES.index(state) | (E_STOP if supervisor.e_stop else 0) | (
            TIMED_OUT if supervisor.timed_out else 0) | (
            COMMANDED if supervisor.commanded else 0)
        if estimate is None and now - self._seen < self._between and flags == self._flags:
            return
        self._seen, nan = now, math.nan
        if estimate is None:
            pendulum = joint = rate = ball_rate = sd = nan
        else:
            pendulum, joint, rate, ball_rate, _ = estimate.mean.tolist()
            sd = estimate.angle_sd
        current = telemetry.current
        values = (now, joint, pendulum - joint, pendulum, rate - ball_rate, ball_rate, sd,
                  supervisor.asked, supervisor.torque, nan if current is None else current)
        with self._lock:
            at = self._room(_PERIOD.size)
            try:
                _PERIOD.pack_into(self._block, at, PERIOD, *values, flags)
            except OverflowError:  # beyond four bytes; too rare to look at each number before
                _PERIOD.pack_into(self._block, at, PERIOD, *map(_single, values), flags)
        if now >= self._slow_at or telemetry.faults != self._faults:
            self._slowly(now, telemetry)
        if supervisor.e_stop != self._e_stop or flags != self._flags:
            self._changed(flags, supervisor.e_stop)

    def command(self, value: float, stamp: float, what: int = TORQUE) -> None:
        """See a command."""
        now = self.clock()
        with self._lock:
            at = self._room(_COMMAND.size)
            _COMMAND.pack_into(self._block, at, COMMAND, now, stamp, _single(value), what)

    def imu(self, reading: ImuReading) -> None:
        """See an IMU reading."""
        with self._lock:
            at = self._room(_IMU.size)
            _IMU.pack_into(self._block, at, IMU, reading.stamp, _single(reading.turn_rate),
                           _single(reading.forward), _single(reading.upward))

    def record(self, direction: str, data: bytes) -> None:
        """See traffic of the line."""
        kind = TO_DRIVE if direction == '>' else FROM_DRIVE
        now = self.clock()
        for begin in range(0, len(data), MOST_TAIL):
            piece = data[begin:begin + MOST_TAIL]
            with self._lock:
                at = self._room(_PIECE.size + len(piece))
                _PIECE.pack_into(self._block, at, kind, now, len(piece))
                self._block[at + _PIECE.size:at + _PIECE.size + len(piece)] = piece

    def tell(self, text: str, weight: int = EVENT) -> None:
        """Hear of an event."""
        now, words = self.clock(), text.encode('utf-8', 'replace')[:MOST_TAIL]
        with self._lock:
            at = self._room(_TOLD.size + len(words))
            _TOLD.pack_into(self._block, at, TOLD, now, weight, len(words))
            self._block[at + _TOLD.size:at + _TOLD.size + len(words)] = words
            if weight == FAULT:
                self._fault = self._fault or (now, text)
        if weight == FAULT:
            self.faulted.set()

    def refused(self, what: str, error: MessageError) -> None:
        """Hear of a refusal; one that comes again and again is counted, and told now and then."""
        now, key = self.clock(), f'{what} {error.reason}'
        told, number = self._refusals.get(key, (-math.inf, 0))
        if now - told < SLOW:
            self._refusals[key] = told, number + 1
            return
        self._refusals[key] = now, 0
        before = f' ({number} more since the last line of this kind)' if number else ''
        self.tell(f'{what} refused: {error}{before}')

    def wished(self, reason: str) -> None:
        """Hear that the e-stop engages because somebody wants it."""
        self._wish = reason

    def _slowly(self, now: float, telemetry: Telemetry) -> None:
        """Note what changes slowly."""
        self._slow_at = now + SLOW
        values = (telemetry.bus_voltage, telemetry.bus_current, telemetry.temperature,
                  telemetry.motor_temperature)
        with self._lock:
            at = self._room(_DRIVE.size)
            _DRIVE.pack_into(self._block, at, DRIVE, now, *(
                math.nan if value is None else _single(value) for value in values))
        if telemetry.faults != self._faults:
            self._faults = telemetry.faults
            self.tell('the drive names ' + (', '.join(telemetry.faults) or 'no fault any more'))

    def _changed(self, flags: int, e_stop: str) -> None:
        """Put into words what has changed since the last period."""
        before, self._flags = self._flags, flags
        if e_stop != self._e_stop:
            known, self._e_stop = self._e_stop, e_stop
            if e_stop and known is not None:
                self.tell(f'e-stop: {e_stop}', EVENT if e_stop == self._wish else FAULT)
        if flags & ~before & TIMED_OUT:
            self.tell('commands timed out')
        if flags & ~before & COMMANDED:
            self.tell('commands arrive')

    # The ring

    def _room(self, size: int) -> int:
        """Return where a record is to be written; only then look at `_block`, it may be new."""
        at = self._at
        if at + size > BLOCK:
            self._turn()
            at = 0
        self._at = at + size
        return at

    def _turn(self) -> None:
        """Begin another block, and let go of what is too old; the lock is held."""
        now = self.clock()
        self._full.append((self._begun, memoryview(self._block)[:self._at]))
        # A block ends where the next one begins.
        while len(self._full) > 1 and self._full[1][0] < now - SPAN:
            self._full.popleft()
        # A new one, not an old one again: whoever writes a file may still read that.
        self._block, self._at, self._begun = bytearray(BLOCK), 0, now

    def snapshot(self) -> List[memoryview]:
        """Return what there is, oldest block first; nothing is copied, and nothing written to."""
        with self._lock:
            if self._at:
                self._turn()
            return [data for _, data in self._full]

    def take_fault(self) -> Optional[Tuple[float, str]]:
        """Return when and why a file is to be written, None if none is; it is asked for once."""
        with self._lock:
            fault, self._fault = self._fault, None
            self.faulted.clear()
        return fault


def _single(value: Union[float, int]) -> float:
    """Return a number that fits into four bytes: what is beyond is infinite."""
    return value if -3e38 < value < 3e38 else math.copysign(math.inf, value) \
        if value == value else math.nan
