# SPDX-License-Identifier: Apache-2.0
"""
The last ten minutes of a session in memory, as MCAP messages that `dump` writes to a file.

Messages of a few dozen bytes are stored in blocks of 64 KiB, each a chunk of the file; the
oldest block is dropped when the ring is full, or when the block is too old.  So memory is bounded,
and a message costs one `struct.pack_into`.  `CHANNELS` defines the schemas of the file and the
columns of the reader.
"""
from collections import deque
import math
import struct
import threading
import time
from types import MappingProxyType
from typing import Callable, Deque, Dict, List, Mapping, NamedTuple, Optional, Tuple

from mcap.opcode import Opcode

from ballbot_ros.bridge.motor_state import MotorState
from ballbot_ros.bridge.observer import Level, SessionObserver
from ballbot_ros.bridge.supervisor import EStop, StopReason, Supervisor
from ballbot_ros.control import Mode, SetPoint
from ballbot_ros.drives.contract import Telemetry
from ballbot_ros.errors import MessageError
from ballbot_ros.estimation import Estimate, ImuReading

# Longest time [s] and largest size [bytes] of the ring; at 500 Hz the time limit applies.
SPAN = 600.0
BLOCK, MOST_BLOCKS = 65536, 1536
# Sampling period of slow values, and shortest time between logged refusals of one kind [s].
SLOW_PERIOD = 0.1
# Time without a measurement after which a tick without one is recorded [periods].
BETWEEN = 0.9
# Longest piece of traffic or text in one message [bytes].
LONGEST_PIECE = 8192

STATES = tuple(MotorState)
# Kinds of commands: name and unit.
COMMANDS = (('torque', 'N m'), ('no torque', ''), ('pendulum angle', 'rad'),
            ('joint rate', 'rad/s'), ('speed', 'm/s'))
TORQUE = 0
MODES = {Mode.IDLE: 1, Mode.HOLD: 2, Mode.DRIVE: 3, Mode.SPEED: 4}


class MessageKind(NamedTuple):
    """A channel: its fields as in a ROS message, each with type and unit, in CDR order."""

    name: str
    fields: Tuple[Tuple[str, str, str], ...]  # type, name, unit
    constants: str = ''

    @property
    def schema(self) -> str:
        """Return the text of the ROS 2 message."""
        return self.constants + ''.join(
            f'{kind} {name}{unit and "  # "}{unit}\n' for kind, name, unit in self.fields)

    @property
    def layout(self) -> struct.Struct:
        """Return the layout of the fields; only the length of a sequence or string is included."""
        codes = {'float64': 'd', 'uint8': 'B', 'bool': 'B', 'uint8[]': 'I', 'string': '3xI'}
        return struct.Struct('<' + ''.join(codes[kind] for kind, _, _ in self.fields))


def _numbers(*fields: Tuple[str, str]) -> Tuple[Tuple[str, str, str], ...]:
    return tuple(('float64', name, unit) for name, unit in fields)


_BYTES = (('uint8[]', 'data', ''),)
CHANNELS: Mapping[int, MessageKind] = MappingProxyType({
    1: MessageKind('period', _numbers(
        ('joint_angle', 'rad'), ('ball_angle', 'rad'), ('pendulum_angle', 'rad'),
        ('joint_rate', 'rad/s'), ('ball_rate', 'rad/s'), ('angle_sd', 'rad'), ('requested', 'N m'),
        ('torque', 'N m'), ('current', 'A')) + (
        ('uint8', 'state', ''), ('bool', 'e_stop', ''), ('bool', 'timed_out', ''),
        ('bool', 'commanded', '')), ''.join(
        f'uint8 {state.name}={number}\n' for number, state in enumerate(STATES))),
    2: MessageKind('drive', _numbers(
        ('bus_voltage', 'V'), ('bus_current', 'A'), ('temperature', 'degC'),
        ('motor_temperature', 'degC'))),
    3: MessageKind('command', _numbers(('stamp', 's'), ('value', '')) + (
        ('uint8', 'kind', ''),), ''.join(
        f'uint8 {name.upper().replace(" ", "_")}={number}{unit and "  # "}{unit}\n'
        for number, (name, unit) in enumerate(COMMANDS))),
    4: MessageKind('imu', _numbers(
        ('turn_rate', 'rad/s'), ('forward', 'm/s2'), ('upward', 'm/s2'))),
    5: MessageKind('to_drive', _BYTES),
    6: MessageKind('from_drive', _BYTES),
    7: MessageKind('event', (('uint8', 'level', ''), ('string', 'text', '')), ''.join(
        f'uint8 {level.name}={level.value}\n' for level in Level)),
})
PERIOD, DRIVE, COMMAND, IMU, TO_DRIVE, FROM_DRIVE, EVENT = CHANNELS
# A Message record of MCAP: opcode and length; channel, sequence number, two times [ns]; the first
# four bytes of the data specify little-endian CDR.
MESSAGE, CDR = struct.Struct('<BQHIQQ4s'), b'\x00\x01\x00\x00'
OUTSIDE_LENGTH = struct.calcsize('<BQ')
RECORDS = {number: struct.Struct(MESSAGE.format + kind.layout.format[1:])
           for number, kind in CHANNELS.items()}


class BlackBox(SessionObserver):
    """
    Records a session in bounded memory; may be used from any thread.

    Clock and period of the loop are those of the session [s].  `faulted` is set when a fault
    requests a dump; messages have system time, which is the clock plus `clock_offset` [s].
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic, period: float = 0.002):
        self.clock = clock
        self.clock_offset = time.time() - clock()
        self.faulted = threading.Event()
        self._between = BETWEEN * period
        self._lock = threading.Lock()
        self._full: Deque[Tuple[float, memoryview]] = deque(maxlen=MOST_BLOCKS - 1)
        self._block, self._at, self._block_start = bytearray(BLOCK), 0, clock()
        self._fault: Optional[Tuple[float, str]] = None
        self._slow_at = -math.inf
        self._e_stop: Optional[EStop] = None
        self._state: Tuple[object, ...] = ()
        self._recorded = -math.inf
        self._faults: Tuple[str, ...] = ()
        self._refusals: Dict[str, Tuple[float, int]] = {}

    def period(self, now: float, estimate: Optional[Estimate], supervisor: Supervisor,
               telemetry: Telemetry, state: MotorState) -> None:
        """Record a period of the loop; measured values are NaN without a measurement."""
        e_stop, nan = supervisor.e_stop, math.nan
        states = (STATES.index(state), bool(e_stop), supervisor.timed_out, supervisor.commanded)
        if estimate is None and now - self._recorded < self._between and states == self._state:
            return
        self._recorded = now
        if estimate is None:
            pendulum = joint = rate = ball_rate = sd = nan
        else:
            pendulum, joint, rate, ball_rate, _ = estimate.mean.tolist()
            sd = estimate.angle_sd
        current = telemetry.current
        self._put(PERIOD, now, joint, pendulum - joint, pendulum, rate - ball_rate, ball_rate, sd,
                  supervisor.requested, supervisor.torque, nan if current is None else current,
                  *states)
        if now >= self._slow_at or telemetry.faults != self._faults:
            self._slow_at = now + SLOW_PERIOD
            self._put(DRIVE, now, *(nan if value is None else value for value in (
                telemetry.bus_voltage, telemetry.bus_current, telemetry.temperature,
                telemetry.motor_temperature)))
        if telemetry.faults != self._faults:
            self._faults = telemetry.faults
            self.event('faults of the drive: ' + (', '.join(telemetry.faults) or 'none'))
        if e_stop != self._e_stop:
            self._e_stop = e_stop
            if e_stop is not None and e_stop.reason is not StopReason.START:
                self.event(f'e-stop: {e_stop.text}',
                           Level.FAULT if e_stop.reason.is_fault else Level.EVENT)
        if states != self._state:
            before, self._state = self._state or (0, False, False, False), states
            if states[2] and not before[2]:
                self.event('commands timed out')
            if states[3] and not before[3]:
                self.event('commands arrive')

    def command(self, torque: float, stamp: float) -> None:
        self._put(COMMAND, self.clock(), stamp, torque, TORQUE)

    def set_point(self, given: SetPoint) -> None:
        self._put(COMMAND, self.clock(), given.stamp, given.value, MODES[given.mode])

    def imu(self, reading: ImuReading) -> None:
        self._put(IMU, reading.stamp, reading.turn_rate, reading.forward, reading.upward)

    def record(self, direction: str, data: bytes) -> None:
        """Record traffic of the link."""
        now = self.clock()
        for begin in range(0, len(data), LONGEST_PIECE):
            piece = data[begin:begin + LONGEST_PIECE]
            self._put(TO_DRIVE if direction == '>' else FROM_DRIVE, now, len(piece), tail=piece)

    def event(self, text: str, level: Level = Level.EVENT) -> None:
        """Record an event, and request a file after a fault."""
        now, tail = self.clock(), text.encode('utf-8', 'replace')[:LONGEST_PIECE] + b'\0'
        self._put(EVENT, now, level, len(tail), tail=tail)
        if level == Level.FAULT:
            with self._lock:
                self._fault = self._fault or (now, text)
            self.faulted.set()

    def refused(self, what: str, error: MessageError) -> None:
        """Record a refusal; refusals of one kind are counted, and recorded every `SLOW_PERIOD`."""
        now, key = self.clock(), f'{what} {error.reason}'
        recorded, number = self._refusals.get(key, (-math.inf, 0))
        if now - recorded < SLOW_PERIOD:
            self._refusals[key] = recorded, number + 1
            return
        self._refusals[key] = now, 0
        more = f' ({number} more since the last line of this kind)' if number else ''
        self.event(f'{what} refused: {error}{more}')

    def _put(self, channel: int, now: float, *values: float, tail: bytes = b'') -> None:
        record = RECORDS[channel]
        size = record.size + len(tail)
        stamp = int(1e9 * (now + self.clock_offset))
        with self._lock:
            if self._at + size > BLOCK:
                self._next_block()
            at, self._at = self._at, self._at + size
            record.pack_into(self._block, at, Opcode.MESSAGE, size - OUTSIDE_LENGTH, channel, 0,
                             stamp, stamp, CDR, *values)
            if tail:
                self._block[at + record.size:at + size] = tail

    def _next_block(self) -> None:
        """Start a block and drop the oldest ones; requires the lock."""
        now = self.clock()
        self._full.append((self._block_start, memoryview(self._block)[:self._at]))
        # A block ends where the next one begins.
        while len(self._full) > 1 and self._full[1][0] < now - SPAN:
            self._full.popleft()
        # A block is never reused: a dump may still read it.
        self._block, self._at, self._block_start = bytearray(BLOCK), 0, now

    def snapshot(self) -> List[memoryview]:
        """Return the blocks, oldest first, as views without a copy."""
        with self._lock:
            if self._at:
                self._next_block()
            return [data for _, data in self._full]

    def take_fault(self) -> Optional[Tuple[float, str]]:
        """Return time [s] and reason of a pending dump and reset it; None without one."""
        with self._lock:
            fault, self._fault = self._fault, None
            self.faulted.clear()
        return fault
