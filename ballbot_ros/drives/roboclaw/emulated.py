# SPDX-License-Identifier: Apache-2.0
"""
Emulated RoboClaw with its packet serial protocol, with a motor on one or both of its outputs.

It follows the RoboClaw Series User Manual.  It sets a voltage, not a torque; any byte feeds its
serial timeout; a pause of more than 10 ms inside a packet drops the packet.  Its response to
invalid data is not documented: here it searches for its address.  Its response to errors is from
"Reading and Troubleshooting RoboClaw Errors" of BasicMicro: an e-stop or a high supply brakes, a
low supply or overheating releases, and from 15 degrees below that the current is reduced.
"""
from binascii import crc_hqx
from functools import partial
import math
import struct
from typing import Callable, Optional

from ballbot_ros.drives.emulated_device import Device, Quirk, Sensed
from ballbot_ros.drives.roboclaw import codec

ADDRESS, AXES = codec.ADDRESSES[0], (0, 1)  # M1 and M2
PAUSE = 0.010
VERSION = 'USB Roboclaw 2x30a v4.2.8\n'
BITS = {name: bit for bit, name in codec.STATUS.items()}
BRAKING = BITS['E_STOP'] | BITS['MAIN_VOLTAGE_HIGH_WARNING']
POWERLESS = codec.ERRORS | BITS['MAIN_VOLTAGE_LOW_WARNING'] \
    | BITS['MAIN_VOLTAGE_HIGH_WARNING']
LIMIT_MARGIN = 15.0  # range below the trip temperature with reduced current [K]
VOLTAGES = (100, 340)  # of the supply, least and most [0.1 V]
# Command -> number of data bytes before its CRC.
COMMANDS = {codec.SET_TIMEOUT: 1, codec.SET_DUTY[0]: 2, codec.SET_DUTY[1]: 2}


class RoboClawDevice(Device):
    """See `Device`."""

    protocol = 'roboclaw'
    quirks = {
        'no_timeout': Quirk(
            'no serial timeout: commands 14 and 15 are unknown',
            'RoboClaw Series User Manual of Ion Motion Control, which does not list them'),
    }

    def _boot(self) -> None:
        self._buffer = b''
        self._received_at: Optional[float] = None
        self._timeout = round(self.settings.watchdog / codec.TIMEOUT_UNIT)  # last value written
        self._duties = [0.0, 0.0]  # of M1 and M2
        self._status, self._broken = 0, False
        # The encoder counters start at 0.
        self._origins = [sensed.position for sensed in self._measured]
        self._answers: dict[int, Callable[[], tuple[int, ...]]] = {
            codec.GET_TIMEOUT: lambda: (self._timeout,),
            codec.GET_BATTERY: lambda: (round(10.0 * self.sensed.bus_voltage),),
            codec.GET_TEMPERATURE: lambda: (max(round(10.0 * self.sensed.temperature), 0),),
            codec.GET_PWMS: lambda: self._of_both(
                lambda axis: codec.FULL_DUTY * self._effective_duty(axis)),
            codec.GET_CURRENTS: lambda: self._of_both(
                lambda axis: 100.0 * self._torque(axis) / self.settings.torque_constant),
            codec.GET_VOLTAGES: lambda: VOLTAGES,
            codec.GET_STATUS: lambda: (self._status,),
        }
        for axis in AXES:
            self._answers.update({
                codec.GET_ENCODER[axis]: partial(self._encoder, axis),
                codec.GET_SPEED[axis]: partial(self._speed, axis),
                codec.GET_MAX_CURRENT[axis]: lambda: (
                    round(100.0 * self.settings.largest_current), 0)})

    @property
    def _measured(self) -> tuple[Sensed, Sensed]:
        """Return the measurements at M1 and M2."""
        return (self.second, self.sensed) if self.settings.axis else (self.sensed, self.second)

    def _encoder(self, axis: int) -> tuple[int, ...]:
        sensed = self._measured[axis]
        return self._counts(sensed.position - self._origins[axis]), sensed.velocity < 0.0

    def _speed(self, axis: int) -> tuple[int, ...]:
        velocity = self._measured[axis].velocity
        return self._counts(velocity), velocity < 0.0

    def torque(self) -> float:
        return self._torque(self.settings.axis)

    def second_torque(self) -> float:
        return self._torque(1 - self.settings.axis)

    def _torque(self, axis: int) -> float:
        duty, settings = self._effective_duty(axis), self.settings
        if duty == 0.0 and not self._status & BRAKING:  # released, not shorted
            return 0.0
        current = (duty * self.sensed.bus_voltage
                   - settings.speed_constant * self._measured[axis].velocity) / settings.resistance
        limit = self.settings.largest_current * min(max(
            (settings.highest_temperature - self.sensed.temperature) / LIMIT_MARGIN, 0.0), 1.0)
        return settings.torque_constant * min(max(current, -limit), limit)

    def tick(self, now: float) -> None:
        if self._received_at is None:
            self._received_at = now
        if self._timeout and now - self._received_at > self._timeout * codec.TIMEOUT_UNIT:
            self._duties = [0.0, 0.0]
        sensed, hottest = self.sensed, self.settings.highest_temperature
        here = {'E_STOP': sensed.stop_switch > 0.0,
                'TEMPERATURE_ERROR': sensed.temperature >= hottest,
                'TEMPERATURE_WARNING': sensed.temperature >= hottest - LIMIT_MARGIN,
                'MAIN_VOLTAGE_LOW_WARNING': sensed.bus_voltage < 0.1 * VOLTAGES[0],
                'MAIN_VOLTAGE_HIGH_WARNING': sensed.bus_voltage > 0.1 * VOLTAGES[1],
                self._driver_fault: self._broken}
        self._status = sum(BITS[name] for name, is_active in here.items() if is_active)

    def over_current(self) -> None:
        self._broken = True
        self._status |= BITS[self._driver_fault]

    @property
    def _driver_fault(self) -> str:
        return f'M{self.settings.axis + 1}_DRIVER_FAULT_ERROR'

    @staticmethod
    def _of_both(value: Callable[[int], float]) -> tuple[int, int]:
        return round(value(0)), round(value(1))

    def _effective_duty(self, axis: int) -> float:
        return 0.0 if self._status & POWERLESS else self._duties[axis]

    def _counts(self, angle: float) -> int:
        """Return encoder counts, wrapped to 32 bits."""
        counts = math.floor(angle / math.tau * self.settings.counts_per_turn)
        return (counts + 2**31) % 2**32 - 2**31

    def _receive(self, data: bytes, now: float) -> bytes:
        if not data:
            return b''
        if self._received_at is not None and now - self._received_at > PAUSE:
            self._buffer = b''
        self._received_at = now
        self._buffer += data
        reply = b''
        while len(self._buffer) >= 2:
            address, number = self._buffer[:2]
            if address != ADDRESS:
                self._buffer = self._buffer[1:]
            elif number in COMMANDS:
                length = 4 + COMMANDS[number]
                if len(self._buffer) < length:
                    break
                reply += self._execute(self._buffer[:length])
                self._buffer = self._buffer[length:]
            else:
                reply += self._answer(number)
                self._buffer = self._buffer[2:]
        return reply

    def _execute(self, packet: bytes) -> bytes:
        if crc_hqx(packet[:-2], 0) != int.from_bytes(packet[-2:], 'big'):
            return b''
        if packet[1] in codec.SET_DUTY:
            self._duties[codec.SET_DUTY.index(packet[1])] = \
                struct.unpack('>h', packet[2:4])[0] / codec.FULL_DUTY
        elif packet[1] == codec.SET_TIMEOUT and not self.has('no_timeout'):
            self._timeout = packet[2]
        return bytes((codec.ACKNOWLEDGED,))

    def _answer(self, number: int) -> bytes:
        if number == codec.GET_TIMEOUT and self.has('no_timeout'):
            return b''
        if number == codec.GET_VERSION:
            return codec.answer(ADDRESS, number, text=VERSION)
        if number in self._answers:
            return codec.answer(ADDRESS, number, *self._answers[number]())
        return b''
