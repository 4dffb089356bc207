# SPDX-License-Identifier: Apache-2.0
"""
Sources of the settings of an ODrive on a CAN bus.

0.6 reports them over the bus by number; the numbers differ between firmwares, and the maker has a
list for each (flat_endpoints.json).  0.5 reports none: the user reads them with odrivetool and
confirms them in the hardware file, and the driver tests the most important one, the watchdog.
"""
import json
import math
from pathlib import Path
import re
from typing import Any, Mapping, NamedTuple, Optional, Sequence

from ballbot_ros.drives.contract import Setting
from ballbot_ros.drives.odrive.cansimple.codec import TYPES
from ballbot_ros.drives.odrive.firmware import UNDER_POWER
from ballbot_ros.errors import ConfigurationError

# Longest heartbeat period: nothing else reports whether the motor has power [s].
SLOWEST_HEARTBEAT = 0.02

_WRITE = re.compile(r'\bw ([\w.]+) (\S+?)(?=,|\s|$)')


class Endpoint(NamedTuple):
    """A value that 0.6 reports."""

    number: int
    kind: str  # one of `TYPES`


def load_endpoints(path: str, version: Sequence[int]) -> Mapping[str, Endpoint]:
    """
    Return the endpoints of a firmware by their names, from the maker's flat_endpoints.json.

    Raises `ConfigurationError` if it cannot be read, is not such a list, or is that of another
    firmware.
    """
    try:
        content: Any = json.loads(Path(path).expanduser().read_text(encoding='utf-8'))
        firmware, listed = str(content['fw_version']), content['endpoints']
        found = {str(name): Endpoint(int(item['id']), item['type'])
                 for name, item in listed.items() if item.get('type') in TYPES}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ConfigurationError(
            f'endpoints: {path} is not a flat_endpoints.json of an ODrive: {error}',
            'unreadable', 'endpoints') from error
    wanted = '.'.join(map(str, version))
    if firmware.partition('-')[0] != wanted:
        raise ConfigurationError(
            f'endpoints: {path} is for firmware {firmware}, the drive has {wanted}, in which '
            'the numbers differ: use the list of that firmware from the maker',
            'inconsistent', 'endpoints')
    return found


def check_confirmed(confirmed: Any) -> None:
    """Raise `ConfigurationError` unless it maps names to numbers."""
    if confirmed is None:
        return
    if not isinstance(confirmed, Mapping):
        raise ConfigurationError(
            f'confirmed must map names of properties to their values, got {confirmed!r}',
            'wrong_type', 'confirmed')
    for name, value in confirmed.items():
        if not isinstance(value, (bool, int, float)) or math.isnan(value):
            raise ConfigurationError(
                f'confirmed: {name} must be a number as odrivetool shows it, got {value!r}',
                'wrong_type', 'confirmed')


def in_odrivetool(remedy: str) -> str:
    """Convert a remedy for a serial terminal to the syntax of odrivetool."""
    return _WRITE.sub(r'odrv0.\1 = \2', remedy)


def missing(names: Sequence[str], old: bool, version: str) -> list[Setting]:
    """Return the setting that lists unknown properties, with a remedy; empty for none."""
    if not names:
        return []
    listed = ', '.join(names)
    return [Setting('settings read or confirmed', f'all but {listed}', 'all', False, (
        'firmware 0.5 does not report them over CAN: read odrv0.NAME of each with odrivetool, and '
        'write name and value under confirmed in the section drive' if old else
        'write endpoints: PATH in the section drive, with the flat_endpoints.json that the maker '
        f'provides for firmware {version}'))]


def judge_heartbeat(period: float, old: bool) -> Setting:
    """Check the time between two heartbeats [s]."""
    name = 'heartbeat_rate_ms' if old else 'heartbeat_msg_rate_ms'
    # The measured period may differ by a quarter, as the line is read in pieces.
    return Setting('heartbeat', f'every {1e3 * period:.0f} ms',
                   f'every {1e3 * SLOWEST_HEARTBEAT:.0f} ms or faster',
                   period <= 1.25 * SLOWEST_HEARTBEAT,
                   f'odrv0.axis0.config.can.{name} = 10')


def judge_positions(number: int, old: bool) -> Setting:
    """Check the number of unrequested positions: only replies to requests have a time stamp."""
    name = 'encoder_rate_ms' if old else 'encoder_msg_rate_ms'
    return Setting('positions', 'sent cyclically' if number else 'on request', 'on request',
                   not number, f'odrv0.axis0.config.can.{name} = 0')


def judge_firmware(version: str) -> Setting:
    """Check the version of a firmware 0.5, from the hardware file."""
    return Setting('firmware', version or 'unknown', 'given in the hardware file', bool(version),
                   'firmware 0.5 does not report it over CAN: write firmware: "0.5.6", or what '
                   'odrivetool shows, in the section drive')


def judge_trial(took: Optional[float], expired: bool, watchdog: float) -> Setting:
    """Check the test of the watchdog: time without a frame [s], None if it was not tested."""
    value = 'not tried' if took is None else \
        f'{"expired after" if expired else "did not expire in"} {took:.2g} s'
    remedy = UNDER_POWER if took is None else (
        f'odrv0.axis0.config.watchdog_timeout = {watchdog:g}, '
        'odrv0.axis0.config.enable_watchdog = True; and let no other program send to this node')
    return Setting('watchdog, tried', value, f'to expire {watchdog:g} s after the last message',
                   expired, remedy)
