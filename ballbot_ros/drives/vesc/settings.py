# SPDX-License-Identifier: Apache-2.0
"""
The settings of a VESC that a motion could run into, and where each firmware puts them.

Settings come as one long row of numbers without names, and their places move between firmwares.
Only the head of the row is read.  5.03 writes many numbers as two-byte integers that 5.02 wrote
as four-byte floats; 6.05 did so again, and put new ones in between; in all later ones up to 7.01
the head is the same.  What lies further back (observer, encoder, positions of the PID) moves with
nearly every firmware and is not read.

Source: confgenerator.c of vedderb/bldc, tags 5.00 to 6.00, branches release_6_02, release_6_05,
release_6_06, release_7_00 and master (7.01); what the limits do: update_override_limits() of
motor/mc_interface.c; applications and kill switch: datatypes.h.
"""
import struct
from typing import Mapping, NamedTuple, Optional

from ballbot_ros.drives.vesc.codec import GET_APPCONF, GET_MCCONF

Version = tuple[int, int]  # of a firmware

# The first whose values end with a status; without it nobody sees a timeout or a kill switch.
OLDEST: Version = (5, 3)
NEWEST_MAJOR = 7
# Test builds of these moved settings from one build to the next.
MOVING: tuple[Version, ...] = ((5, 3), (6, 0), (6, 5))
_HEAD_OF_6_05: Version = (6, 5)
_APPLICATION_OF_6: Version = (6, 0)

# Name in the firmware -> format and what an integer is divided by; in their order.
Layout = Mapping[str, tuple[str, float]]
_CURRENTS: Layout = {
    'l_current_max': ('f', 1.0), 'l_current_min': ('f', 1.0), 'l_in_current_max': ('f', 1.0),
    'l_in_current_min': ('f', 1.0)}
_SPEEDS: Layout = {
    'l_abs_current_max': ('f', 1.0), 'l_min_erpm': ('f', 1.0), 'l_max_erpm': ('f', 1.0),
    'l_erpm_start': ('h', 1e4), 'l_max_erpm_fbrake': ('f', 1.0),
    'l_max_erpm_fbrake_cc': ('f', 1.0)}
_VOLTAGES = ('l_min_vin', 'l_max_vin', 'l_battery_cut_start', 'l_battery_cut_end')
_TEMPERATURES = ('l_temp_fet_start', 'l_temp_fet_end', 'l_temp_motor_start', 'l_temp_motor_end')
_POWER: Layout = {
    'l_temp_accel_dec': ('h', 1e4), 'l_min_duty': ('h', 1e4), 'l_max_duty': ('h', 1e4),
    'l_watt_max': ('f', 1.0), 'l_watt_min': ('f', 1.0), 'l_current_max_scale': ('h', 1e4),
    'l_current_min_scale': ('h', 1e4)}
SINCE_5_03: Layout = {
    **_CURRENTS, **_SPEEDS, **dict.fromkeys(_VOLTAGES, ('f', 1.0)),
    'l_slow_abs_current': ('B', 1.0), **dict.fromkeys(_TEMPERATURES, ('h', 10.0)), **_POWER}
SINCE_6_05: Layout = {
    **_CURRENTS, 'l_in_current_map_start': ('h', 1e4), 'l_in_current_map_filter': ('h', 1e4),
    **_SPEEDS, **dict.fromkeys(_VOLTAGES, ('h', 10.0)),
    'l_battery_regen_cut_start': ('h', 10.0), 'l_battery_regen_cut_end': ('h', 10.0),
    'l_slow_abs_current': ('B', 1.0), **dict.fromkeys(_TEMPERATURES, ('B', 1.0)), **_POWER}
# Before them: message, signature, and four bytes of modulation and motor type.
_MOTOR_HEAD = 9

KILL_SWITCHES = (
    'off', 'PPM low', 'PPM high', 'ADC2 low', 'ADC2 high', 'ADC3 low', 'ADC3 high', 'SWDIO low',
    'SWDIO high', 'SWCLK low', 'SWCLK high')
# What else may command the motor; APP_NONE and APP_UART are this line alone.
APPLICATIONS = ('none', 'PPM', 'ADC', 'UART', 'PPM and UART', 'ADC and UART', 'Nunchuk', 'NRF',
                'custom')
ALONE = ('none', 'UART')


class Application(NamedTuple):
    """What is read of a ``GET_APPCONF``."""

    timeout: float  # [s]; 0 for never
    brake_current: float  # when it expires [A]
    kill_switch: str  # one of `KILL_SWITCHES`
    application: str  # one of `APPLICATIONS`


def why_not(version: Version, test: int) -> str:
    """Return why a firmware, or test build of one (0 for none), cannot be driven; or nothing."""
    if version < OLDEST:
        return ('its values end without the status that tells of timeout and kill switch, and '
                'its settings are written in another way (5.03 changed both)')
    if version[0] > NEWEST_MAJOR:
        return 'where it keeps its settings is not known'
    if test and version in MOVING:
        return f'it is test build {test}, in which settings moved from build to build'
    return ''


def layout_of(version: Version) -> Layout:
    """Return how a firmware writes the limits of its motor."""
    return SINCE_6_05 if version >= _HEAD_OF_6_05 else SINCE_5_03


def _struct_of(layout: Layout) -> struct.Struct:
    return struct.Struct('>' + ''.join(form for form, _ in layout.values()))


def parse_limits(payload: bytes, layout: Layout) -> Optional[Mapping[str, float]]:
    """Return the limits of a ``GET_MCCONF`` by their names, None if it is not one."""
    form = _struct_of(layout)
    if len(payload) < _MOTOR_HEAD + form.size or payload[0] != GET_MCCONF:
        return None
    values = form.unpack_from(payload, _MOTOR_HEAD)
    return {name: value / scale for value, (name, (_, scale)) in zip(values, layout.items())}


def pack_limits(limits: Mapping[str, float], layout: Layout) -> bytes:
    """Return the head of a ``GET_MCCONF``, as the firmware makes it."""
    return struct.pack('>BIBBBB', GET_MCCONF, 0, 1, 0, 2, 2) + _struct_of(layout).pack(*(
        limits[name] if form == 'f' else int(limits[name] * scale)
        for name, (form, scale) in layout.items()))


def _application_place(version: Version) -> int:
    """Return where the mode of the kill switch stands in a ``GET_APPCONF``; next is the app."""
    return 33 if version >= _APPLICATION_OF_6 else 29


def parse_application(payload: bytes, version: Version) -> Optional[Application]:
    """Return what is read of a ``GET_APPCONF``, None if it is not one."""
    place = _application_place(version)
    if len(payload) < place + 2 or payload[0] != GET_APPCONF:
        return None
    milliseconds, brake = struct.unpack_from('>If', payload, 6)
    return Application(milliseconds / 1000.0, brake, _name(KILL_SWITCHES, payload[place]),
                       _name(APPLICATIONS, payload[place + 1]))


def pack_application(settings: Application, version: Version) -> bytes:
    """Return the head of a ``GET_APPCONF``, as the firmware makes it."""
    head = struct.pack('>BIBIf', GET_APPCONF, 0, 1, round(1000.0 * settings.timeout),
                       settings.brake_current)
    return head.ljust(_application_place(version), b'\0') + bytes((
        KILL_SWITCHES.index(settings.kill_switch), APPLICATIONS.index(settings.application)))


def _name(names: tuple[str, ...], number: int) -> str:
    return names[number] if number < len(names) else f'number {number}'
