# SPDX-License-Identifier: Apache-2.0
"""What an ODrive on a CAN bus has told of itself: heartbeats and error registers."""
from collections import deque
from typing import NamedTuple, Optional

from ballbot_ros.drives.odrive.codec import CLOSED_LOOP_CONTROL, IDLE
from ballbot_ros.drives.odrive.firmware import Generation, GENERATIONS
from ballbot_ros.drives.odrive.registers import CONTROLLER_5, ENCODER_5, MOTOR_5, RESULT_6
from ballbot_ros.drives.odrive_can import codec
from ballbot_ros.drives.odrive_can.codec import Heartbeat

OLD = GENERATIONS[0]
# Registers of 0.5, in the order of the flags of its heartbeat.
REGISTERS = {codec.MOTOR_ERROR: MOTOR_5, codec.ENCODER_ERROR: ENCODER_5,
             codec.CONTROLLER_ERROR: CONTROLLER_5}
# What is asked for in turn besides the position.
POLLED = {'0.5': (codec.IQ, codec.BUS_VOLTAGE_CURRENT, codec.MOTOR_ERROR, codec.ENCODER_ERROR,
                  codec.CONTROLLER_ERROR),
          '0.6': (codec.ERROR, codec.IQ, codec.BUS_VOLTAGE_CURRENT, codec.TEMPERATURE)}


class Beat(NamedTuple):
    """A heartbeat, and when it came [s]."""

    time: float
    content: Heartbeat


class AxisCondition:
    """
    The state of the axis, and its errors by the names of its generation.

    Attributes
    ----------
    generation : Generation or None
        None before it is known.
    beats : deque of Beat
        The last ones, newest at the end.

    """

    def __init__(self) -> None:
        """Know nothing."""
        self.generation: Optional[Generation] = None
        self.beats: deque[Beat] = deque(maxlen=3)
        self._result = 0  # of the last procedure, 0.6 only
        self._registers: dict[int, int] = {}

    @property
    def state(self) -> Optional[int]:
        """Return the state of the axis by the newest heartbeat, None without one."""
        return self.beats[-1].content.state if self.beats else None

    @property
    def armed(self) -> bool:
        """Return whether the motor has power, by the newest heartbeat."""
        return self.state == CLOSED_LOOP_CONTROL

    @property
    def idle(self) -> bool:
        """Return whether the motor has no power, by the newest heartbeat."""
        return self.state == IDLE

    @property
    def period(self) -> float:
        """Return the time between two heartbeats [s], infinite where fewer have come."""
        beats = self.beats
        return (beats[-1].time - beats[0].time) / (len(beats) - 1) if len(beats) > 1 \
            else float('inf')

    @property
    def without_estimate(self) -> bool:
        """Return whether a position that comes now is none; 0.5 tells 0 then."""
        if self.generation is None or not self.beats:
            return False
        content = self.beats[-1].content
        failed = self.generation is OLD and content.second & 1
        return bool(content.errors & self.generation.no_estimate or failed)

    @property
    def expired(self) -> bool:
        """Return whether the watchdog has, by the newest heartbeat."""
        return self.generation is not None and bool(self.beats) and bool(
            self.beats[-1].content.errors & self.generation.watchdog_expired)

    @property
    def unread(self) -> Optional[int]:
        """Return the command for a register that is needed to say what is wrong."""
        for command in self._flagged():
            if command not in self._registers:
                return command
        return None

    def faults(self, ours: bool) -> tuple[str, ...]:
        """
        Return the names of all errors, in idle also of those that the power went for.

        That nobody commands a motor that is not armed is no fault; `ours` says whether we had
        armed it.
        """
        if self.generation is None or not self.beats:
            return ()
        bits = self.beats[-1].content.errors
        if not (ours or self.armed):
            bits &= ~self.generation.watchdog_expired
        if self.generation is not OLD and self.idle:
            bits |= self._registers.get(codec.ERROR, 0) >> 32  # the reason
        parts: tuple[str, ...] = ()
        for command in self._flagged():
            register = REGISTERS[command]
            value = self._registers.get(command, 0)
            parts += register.names_of(value) if value else (register.path,)
        return (*self.generation.names_of(bits), *parts)

    def _flagged(self) -> tuple[int, ...]:
        """Return the commands for the registers in which 0.5 says that something is."""
        if self.generation is not OLD or not self.beats:
            return ()
        content = self.beats[-1].content
        flags = (content.first, content.second, content.third)
        return tuple(command for command, flag in zip(REGISTERS, flags) if flag & 1)

    @property
    def reason(self) -> str:
        """Return why a state was not reached, as far as the heartbeat tells it."""
        told = self.generation is not None and self.generation is not OLD
        return ', '.join(RESULT_6.names_of(self._result) if told else ()) or 'no reason'

    def take_beat(self, content: Heartbeat, now: float) -> None:
        """Take a heartbeat."""
        self.beats.append(Beat(now, content))
        self._result = content.first

    def take_register(self, command: int, data: bytes) -> None:
        """Take an error register."""
        self._registers[command] = int.from_bytes(data, 'little')

    def forget(self) -> None:
        """Forget the registers: they are being cleared."""
        self._registers.clear()
