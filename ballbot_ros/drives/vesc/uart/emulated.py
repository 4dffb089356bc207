# SPDX-License-Identifier: Apache-2.0
"""
Emulated VESC with its serial protocol and firmware 5.03, 6.02, 6.05 or 7.01.

It follows comm/commands.c, timeout.c and motor/mc_interface.c of vedderb/bldc, of the tags 5.03
and 6.00, the branches release_6_02 to release_7_00 and master (7.01).  It has no arming and
executes each current command.  A thread checks timeout and kill switch every 10 ms, and the status
reports its last check: a motor that follows commands again is still reported as timed out for up
to 10 ms.  Limits cut the current without a report.  After a fault the motor stays off for half a
second before it follows the next command.
"""
import math
import struct

from ballbot_ros.drives.emulated_device import Device, DriveSettings, Quirk
from ballbot_ros.drives.vesc import settings
from ballbot_ros.drives.vesc.settings import THREAD
from ballbot_ros.drives.vesc.uart import codec

FAULT_TIME = 0.5  # m_fault_stop_time_ms [s]
IGNORED = 0.02  # time without commands after each check of an engaged kill switch [s]
OVER_VOLTAGE, UNDER_VOLTAGE, ABS_OVER_CURRENT, OVER_TEMP_FET = 1, 2, 4, 5
FACTORY_CURRENT, FACTORY_TIMEOUT = 60.0, 1.0  # [A], [s]
FIRMWARES = {'6.02': (6, 2), '5.03': (5, 3), '6.05': (6, 5), '7.01': (7, 1)}
# Filler after the fields that are read here; real settings are several hundred bytes long.
MORE_SETTINGS = bytes(300)
# Factory defaults, motor/mcconf_default.h; `VescDevice` sets those of currents and temperature.
LIMITS = {
    'l_in_current_max': 99.0, 'l_in_current_min': -60.0, 'l_in_current_map_start': 0.9,
    'l_in_current_map_filter': 0.002, 'l_abs_current_max': 130.0, 'l_min_erpm': -1e5,
    'l_max_erpm': 1e5, 'l_erpm_start': 0.8, 'l_max_erpm_fbrake': 300.0,
    'l_max_erpm_fbrake_cc': 1500.0, 'l_min_vin': 8.0, 'l_max_vin': 57.0,
    'l_battery_cut_start': 10.0, 'l_battery_cut_end': 8.0, 'l_battery_regen_cut_start': 1000.0,
    'l_battery_regen_cut_end': 1100.0, 'l_slow_abs_current': 0.0, 'l_temp_motor_start': 85.0,
    'l_temp_motor_end': 100.0, 'l_temp_accel_dec': 0.15, 'l_min_duty': 0.005, 'l_max_duty': 0.95,
    'l_watt_max': 1.5e6, 'l_watt_min': -1.5e6, 'l_current_max_scale': 1.0,
    'l_current_min_scale': 1.0}


class VescDevice(Device):
    """See `Device`; its settings, `application` and `limits`, survive a reboot."""

    protocol = 'vesc'
    firmwares = tuple(FIRMWARES)
    quirks = {
        'factory': Quirk(
            'factory defaults: 60 A for the motor, a timeout of 1 s',
            'motor/mcconf_default.h, applications/appconf_default.h of vedderb/bldc, 7.01'),
        'kill_switch': Quirk(
            'the kill switch is configured: while `stop_switch` is 1, no current flows',
            'timeout.c of vedderb/bldc, 5.03 and later'),
        'regen_limit': Quirk(
            'no current may flow into the supply, so a braking motor loses its torque',
            'motor/mc_interface.c of vedderb/bldc: l_in_current_min'),
    }

    def __init__(self, given: DriveSettings):
        factory, hottest = 'factory' in given.quirks, given.highest_temperature
        limit = FACTORY_CURRENT if factory else given.largest_current
        self.limits = {
            **LIMITS, 'l_current_max': limit, 'l_current_min': -limit,
            'l_abs_current_max': max(LIMITS['l_abs_current_max'], 2.0 * limit),
            'l_temp_fet_start': hottest - 15.0, 'l_temp_fet_end': hottest}
        if 'regen_limit' in given.quirks:
            self.limits['l_in_current_min'] = -0.01
        timeout = max(given.watchdog - THREAD, 0.001) if given.watchdog else 0.0
        timeout = FACTORY_TIMEOUT if factory else timeout
        self.application = settings.Application(
            timeout, 0.0, 'ADC2 high' if 'kill_switch' in given.quirks else 'off', 'UART')
        super().__init__(given)

    def _boot(self) -> None:
        self.version = FIRMWARES[self.settings.firmware or self.firmwares[0]]
        self._parser = codec.FrameParser()
        self._current = 0.0
        self._fed = self._check_at = math.nan  # from the first tick on
        self._status = 0
        self._ignoring_until = -math.inf
        self._fault = 0
        self._fault_ends = -math.inf
        self._origin = self.sensed.position  # the tachometer starts at 0

    def torque(self) -> float:
        return 0.0 if self._fault else self.settings.torque_constant * self._limited()

    def _limited(self) -> float:
        """Return the set motor current after update_override_limits() [A]."""
        here, limits = self.sensed, self.limits
        hot = _derating(here.temperature, limits['l_temp_fet_start'], limits['l_temp_fet_end'])
        most = hot * limits['l_current_max'] * limits['l_current_max_scale']
        least = hot * limits['l_current_min'] * limits['l_current_min_scale']
        erpm = abs(here.velocity) * 60.0 / math.tau * self.settings.pole_pairs
        highest = limits['l_max_erpm']
        driving = most * _derating(erpm, limits['l_erpm_start'] * highest, highest)
        forward = -1.0 if here.velocity < 0.0 else 1.0
        current = forward * min(max(forward * self._current, least), driving)
        # Power that the motor draws from the supply or feeds into it.
        power = self.settings.torque_constant * here.velocity * current
        supply = here.bus_voltage * (
            limits['l_in_current_max']
            * (1.0 - _derating(here.bus_voltage, limits['l_battery_cut_end'],
                               limits['l_battery_cut_start']))
            if power > 0.0 else -limits['l_in_current_min']
            * _derating(here.bus_voltage, limits['l_battery_regen_cut_start'],
                        limits['l_battery_regen_cut_end']))
        return current if abs(power) <= supply else current * supply / abs(power)

    def tick(self, now: float) -> None:
        if math.isnan(self._check_at):
            self._check_at, self._fed = now, now
        if now >= self._check_at:
            self._check(now)
            self._check_at = max(self._check_at + THREAD, now)
        if self._fault and math.isinf(self._fault_ends):
            self._fault_ends = now + FAULT_TIME
        if self.sensed.temperature >= self.limits['l_temp_fet_end']:
            self._trip(OVER_TEMP_FET)
        elif self.sensed.bus_voltage < self.limits['l_min_vin']:
            self._trip(UNDER_VOLTAGE)
        elif self.sensed.bus_voltage > self.limits['l_max_vin']:
            self._trip(OVER_VOLTAGE)
        elif self._fault and now >= self._fault_ends:
            self._fault = 0

    def _check(self, now: float) -> None:
        """Run one cycle of the timeout thread."""
        pulled = self.application.kill_switch != 'off' and self.sensed.stop_switch > 0.0
        timeout = self.application.timeout
        expired = bool(timeout) and now - self._fed > timeout
        if pulled or expired:
            self._current = 0.0
        if pulled:
            self._ignoring_until = now + IGNORED
            self._status |= codec.KILL_SWITCH
        else:
            self._status = codec.TIMED_OUT * expired

    def over_current(self) -> None:
        self._trip(ABS_OVER_CURRENT)

    def _trip(self, fault: int) -> None:
        self._fault, self._fault_ends = fault, math.inf
        self._current = 0.0

    def _receive(self, data: bytes, now: float) -> bytes:
        replies = (self._execute(payload, now) for payload in self._parser.feed(data))
        return b''.join(codec.frame(reply) for reply in replies if reply)

    def _execute(self, payload: bytes, now: float) -> bytes:
        """Execute a message and return the payload of the reply, empty for none."""
        message, data = payload[0], payload[1:]
        if message == codec.SET_CURRENT and len(data) >= 4:
            self._fed = now
            if not self._fault and now >= self._ignoring_until:
                self._current = struct.unpack_from('>i', data)[0] / 1000.0
        elif message == codec.ALIVE:
            self._fed = now
        elif message == codec.FW_VERSION:
            return bytes((message, *self.version)) + b'60_MK6\0' + bytes.fromhex(
                '30002b001450523147353420') + b'\0\0\0\0'
        elif message == codec.GET_VALUES_SELECTIVE and len(data) == 4 \
                and int.from_bytes(data, 'big') % (1 << codec.TAG_SHIFT) == codec.MASK:
            tag = int.from_bytes(data, 'big') >> codec.TAG_SHIFT
            return codec.pack_values(self._values()._replace(tag=tag))
        elif message == codec.GET_APPCONF:
            return settings.pack_application(self.application, self.version) + MORE_SETTINGS
        elif message == codec.GET_MCCONF:
            return settings.pack_limits(self.limits, self.version) + MORE_SETTINGS
        return b''

    def _values(self) -> codec.Values:
        sensed, pairs = self.sensed, self.settings.pole_pairs
        steps = 6 * pairs * (sensed.position - self._origin) / math.tau
        return codec.Values(
            sensed.temperature, sensed.motor_temperature, self.current(),
            self.power() / max(sensed.bus_voltage, 1.0),
            sensed.velocity * 60.0 / math.tau * pairs, sensed.bus_voltage, math.floor(steps),
            self._fault, math.degrees(sensed.position) % 360.0, self._status)


def _derating(value: float, start: float, end: float) -> float:
    """Return the derating factor of a current: 1 up to `start`, 0 from `end` on."""
    return min(max((end - value) / (end - start), 0.0), 1.0)
