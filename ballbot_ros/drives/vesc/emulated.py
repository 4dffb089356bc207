# SPDX-License-Identifier: Apache-2.0
"""
A VESC with firmware 6, as its serial protocol sees it.

Written after comm/commands.c, timeout.c and motor/mc_interface.c of vedderb/bldc: it has no
arming, disarms when its timeout expires and follows the next command again, and after
a fault keeps off for half a second before it does.
"""
import math
import struct
from typing import Optional

from ballbot_ros.drives.emulated_device import Device
from ballbot_ros.drives.vesc import codec

FAULT_TIME = 0.5  # m_fault_stop_time_ms [s]
ABS_OVER_CURRENT, OVER_TEMP_FET = 4, 5
FIRMWARE = (6, 2)
# What follows the fields that are read here; real settings are some hundred bytes long.
MORE_SETTINGS = bytes(300)


class VescDevice(Device):
    """See `Device`."""

    protocol = 'vesc'

    def _boot(self) -> None:
        self._parser = codec.FrameParser()
        self._current = 0.0
        self._fed: Optional[float] = None
        self._timed_out = False
        self._fault = 0
        self._fault_ends = -math.inf
        self._origin = self.sensed.position  # the tachometer starts at 0

    def torque(self) -> float:
        """Return the torque at the shaft; see `Device`."""
        if self._fault or self._timed_out:
            return 0.0
        limit = self.settings.largest_current
        return self.settings.torque_constant * min(max(self._current, -limit), limit)

    def tick(self, now: float) -> None:
        """Look after timeout and temperature; see `Device`."""
        if self._fed is None:
            self._fed = now
        if self.settings.watchdog and now - self._fed > self.settings.watchdog:
            self._timed_out = True
            self._current = 0.0
        if self._fault and math.isinf(self._fault_ends):
            self._fault_ends = now + FAULT_TIME
        if self.sensed.temperature >= self.settings.highest_temperature:
            self._trip(OVER_TEMP_FET)
        elif self._fault and now >= self._fault_ends:
            self._fault = 0

    def over_current(self) -> None:
        """Trip; see `Device`."""
        self._trip(ABS_OVER_CURRENT)

    def _trip(self, fault: int) -> None:
        self._fault, self._fault_ends = fault, math.inf
        self._current = 0.0

    def _receive(self, data: bytes, now: float) -> bytes:
        return b''.join(self._obey(payload, now) for payload in self._parser.feed(data))

    def _obey(self, payload: bytes, now: float) -> bytes:
        message, data = payload[0], payload[1:]
        if message == codec.SET_CURRENT and len(data) >= 4:
            self._feed(now)
            if not self._fault:
                self._current = struct.unpack_from('>i', data)[0] / 1000.0
        elif message == codec.ALIVE:
            self._feed(now)
        elif message == codec.FW_VERSION:
            return codec.frame(bytes((message, *FIRMWARE)) + b'60_MK6\0'
                               + bytes.fromhex('30002b001450523147353420') + b'\0\0\0\0')
        elif message == codec.GET_VALUES_SELECTIVE \
                and data == codec.MASK.to_bytes(4, 'big'):
            return codec.frame(codec.pack_values(self._values()))
        elif message == codec.GET_APPCONF:
            return codec.frame(struct.pack(
                '>BIBIf', message, 0x12345678, 1, round(1000.0 * self.settings.watchdog), 0.0)
                + MORE_SETTINGS)
        elif message == codec.GET_MCCONF:
            limit = self.settings.largest_current
            return codec.frame(struct.pack(
                '>BIBBBBff', message, 0x87654321, 1, 0, 2, 2, limit, -limit) + MORE_SETTINGS)
        return b''

    def _feed(self, now: float) -> None:
        self._fed = now
        self._timed_out = False

    def _values(self) -> codec.Values:
        sensed, pairs = self.sensed, self.settings.pole_pairs
        steps = 6 * pairs * (sensed.position - self._origin) / math.tau
        return codec.Values(
            sensed.temperature, sensed.motor_temperature,
            self.torque() / self.settings.torque_constant,
            sensed.velocity * 60.0 / math.tau * pairs, sensed.bus_voltage, math.floor(steps),
            self._fault, math.degrees(sensed.position) % 360.0, int(self._timed_out))
