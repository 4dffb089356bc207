# SPDX-License-Identifier: Apache-2.0
"""Diagnosis of the connection to a motor controller; each finding has a remedy."""
import grp
import os
from pathlib import Path
import pwd
from typing import Callable, Iterator, List, Mapping, NamedTuple, Optional, Tuple, Union

from ballbot_ros.bridge.drive_line import connector
from ballbot_ros.bridge.hardware_file import Hardware, load_hardware
from ballbot_ros.bridge.realtime import DEFAULT_PRIORITY, PERMIT, permits
from ballbot_ros.drives import (
    driver_class, DRIVES, line_of, open_driver, open_line, read_options, SERIAL)
from ballbot_ros.drives.can_transport import up_command
from ballbot_ros.drives.transport import ports
from ballbot_ros.errors import BallbotError, DriveError, LinkError

OK, NOTE, WRONG = 'ok', 'note', 'WRONG'
# Latency timer of an FTDI adapter that the loop requires [ms]; its default is longer.
SLOW_LATENCY = 1
# Timeout per protocol and baud rate while probing [s].
REPLY_TIMEOUT = 0.25
# ARPHRD_CAN of linux/if_arp.h.
CAN_DEVICE = 280
# The ports of higher domains conflict with ephemeral ports on Linux.
HIGHEST_DOMAIN = 101


class Finding(NamedTuple):
    """Result of a check."""

    verdict: str  # OK, NOTE or WRONG
    what: str
    remedy: str = ''  # a command if one exists; empty for OK


def stable_names(device: str, folder: Path = Path('/dev/serial/by-id')) -> List[str]:
    """Return the persistent names of a device."""
    try:
        return sorted(str(link) for link in folder.iterdir()
                      if link.resolve() == Path(device).resolve())
    except OSError:
        return []


def check_ports(found: Optional[List[Tuple[str, str]]] = None,
                system: Path = Path('/sys')) -> Iterator[Finding]:
    """Yield findings about each serial port, without opening any."""
    known = ports() if found is None else found
    if not known:
        yield Finding(NOTE, 'no serial port found',
                      'plug in the adapter and run: dmesg | tail')
    for device, description in known:
        names = stable_names(device)
        yield Finding(OK, f'{device}: {description or "adapter without a description"}',
                      f'use the persistent name: {names[0]}' if names else '')
        yield from check_permission(device)
        yield from check_latency(device, system)


def check_buses(system: Path = Path('/sys')) -> Iterator[Finding]:
    """Yield findings about each CAN interface of the kernel."""
    for path in sorted((system / 'class/net').glob('*/type')):
        name, operation = path.parent.name, path.with_name('operstate')
        try:
            if int(path.read_text()) != CAN_DEVICE:
                continue
            down = operation.read_text().strip() == 'down'
        except (OSError, ValueError):  # removed meanwhile
            continue
        yield Finding(NOTE if down else OK, f'{name}: a CAN interface'
                      + (', which is down' if down else ''),
                      up_command(name, 1000000) if down else '')


def check_permission(device: str) -> Iterator[Finding]:
    """Yield a finding if the port may not be opened."""
    try:
        group = grp.getgrgid(os.stat(device).st_gid).gr_name
    except (OSError, KeyError):
        return
    if not os.access(device, os.R_OK | os.W_OK):
        user = pwd.getpwuid(os.getuid()).pw_name
        yield Finding(WRONG, f'{device}: no permission for {user}, only for the group {group}',
                      f'sudo usermod -aG {group} {user}, then log out and in')


def check_latency(device: str, system: Path = Path('/sys')) -> Iterator[Finding]:
    """Yield a finding if an FTDI adapter delays received data."""
    path = system / 'bus/usb-serial/devices' / Path(device).name / 'latency_timer'
    try:
        latency = int(path.read_text())
    except (OSError, ValueError):
        return
    if latency > SLOW_LATENCY:
        yield Finding(WRONG, f'{device}: its latency timer is {latency} ms, which limits the loop '
                      f'to {1000.0 / latency:.0f} Hz',
                      f'echo 1 | sudo tee {path}, or install config/udev/99-ballbot.rules')


def check_scheduling() -> Finding:
    """Return a finding about real-time priority of the bridge loop."""
    if permits(DEFAULT_PRIORITY):
        return Finding(OK, f'real-time priority {DEFAULT_PRIORITY} is permitted')
    return Finding(NOTE, 'real-time priority is not permitted: a busy machine may delay the loop '
                   'of the bridge and engage the e-stop', PERMIT)


def check_ros(environment: Mapping[str, str]) -> Iterator[Finding]:
    """Yield findings about ROS domain and discovery range."""
    domain = environment.get('ROS_DOMAIN_ID', '')
    if domain and not (domain.isdigit() and int(domain) <= HIGHEST_DOMAIN):
        yield Finding(WRONG, f'ROS_DOMAIN_ID is {domain!r}',
                      f'export ROS_DOMAIN_ID=N with N from 0 to {HIGHEST_DOMAIN}')
    else:
        yield Finding(OK, f'ROS domain {domain or "0 (ROS_DOMAIN_ID is not set)"}')
    reach = environment.get('ROS_AUTOMATIC_DISCOVERY_RANGE') or 'LOCALHOST'  # as ros.discovery
    if reach in ('LOCALHOST', 'OFF'):
        yield Finding(OK, f'ROS discovery range {reach}: no other host can command this motor')
    elif reach in ('SUBNET', 'SYSTEM_DEFAULT'):
        yield Finding(NOTE, f'ROS discovery range {reach}: every host on this network and '
                      'domain can command this motor',
                      'unset ROS_AUTOMATIC_DISCOVERY_RANGE to prevent this')
    else:
        yield Finding(WRONG, f'ROS_AUTOMATIC_DISCOVERY_RANGE is {reach!r}',
                      'must be OFF, LOCALHOST, SUBNET or SYSTEM_DEFAULT')


def check_drive(hardware: Hardware,
                progress: Callable[[str], None] = lambda text: None) -> Iterator[Finding]:
    """
    Yield findings about the drive on the port of a hardware file, and its settings.

    Only read requests are sent, and to a RoboClaw its serial timeout; no motor moves.  `progress`
    receives a description of each step that takes seconds.
    """
    connection = hardware.connection
    where = f'{connection.port} at {connection.baud} baud'
    try:
        driver = connector(hardware)()
    except LinkError as error:
        yield Finding(WRONG, str(error), 'give another port (--port, or port in the file)'
                      if error.reason in ('missing', 'not_a_port', 'bad_address') else '')
        return
    try:
        identity = driver.identify()
    except (DriveError, LinkError) as error:
        driver.line.close()
        yield _wrong_drive(hardware, error, progress)
        return
    yield Finding(OK, f'{where}: {identity.in_words}')
    try:
        settings = driver.read_settings()
        for item in settings:
            yield Finding(OK, f'{item.name} {item.value}') if item.acceptable else Finding(
                WRONG, f'{item.name} {item.value}, must be {item.wanted}', item.remedy)
        if driver.keeping and not all(item.acceptable for item in settings):
            yield Finding(NOTE, 'the settings are lost when the drive restarts, unless they are '
                          'saved in it', driver.keeping)
    except (DriveError, LinkError) as error:
        yield Finding(WRONG, f'its settings cannot be read: {error}')
    finally:
        driver.line.close()


def _wrong_drive(hardware: Hardware, error: Union[DriveError, LinkError],
                 progress: Callable[[str], None]) -> Finding:
    connection = hardware.connection
    if error.reason == 'firmware':
        return Finding(WRONG, str(error), 'change the firmware with the tool of its '
                       'manufacturer, or the section drive of the file')
    if error.reason == 'late':
        return Finding(WRONG, str(error), 'end other programs, and connect the drive directly, '
                       'without a network or a hub in between')
    found = probe(connection.port, connection.protocol, connection.baud, progress)
    if found is None:
        serial = line_of(connection.protocol) is SERIAL
        return Finding(WRONG, str(error), (
            'no known drive answers at any common baud rate: check power, TX and RX '
            '(crossed?), and the ground connection') if serial else (
            'no known drive answers at this bit rate: check power, CAN_H, CAN_L and ground, '
            '120 ohm at both ends (60 ohm between CAN_H and CAN_L with all power off), and '
            'bit rate and id of the drive'))
    protocol, baud = found
    if protocol != connection.protocol:
        same = '' if baud == connection.baud else f' and baud: {baud}'
        return Finding(WRONG, f'wrong protocol: {connection.port} has {protocol}, not '
                       f'{connection.protocol}', f'set protocol: {protocol}{same} in the file')
    return Finding(WRONG, f'wrong baud rate: the {protocol} on {connection.port} answers at '
                   f'{baud}, not at {connection.baud}',
                   f'set baud: {baud} in the file, or change it in the drive')


def probe(port: str, protocol: str, baud: int,
          progress: Callable[[str], None]) -> Optional[Tuple[str, int]]:
    """
    Return protocol and baud rate of the drive on a port, None if none answers.

    The given protocol and baud rate come first, then the other protocols of the same kind of link
    at that rate.  On a CAN bus only that rate is tried: another one would disturb all nodes on
    the bus.
    """
    for name, rate in _guesses(protocol, baud):
        progress(f'trying {name} at {rate} baud')
        try:
            line = open_line(name, port, rate)
            try:
                options = read_options(name, {'torque_limit': 1e-3}, 'probe')
                open_driver(name, line, options).identify(REPLY_TIMEOUT)
            finally:
                line.close()
            return name, rate
        except DriveError as error:
            if error.reason in ('firmware', 'late'):  # the right protocol all the same
                return name, rate
        except LinkError as error:
            if error.reason != 'bad_baud':
                return None
    return None


def _guesses(protocol: str, baud: int) -> List[Tuple[str, int]]:
    kind = line_of(protocol)
    names = sorted((name for name in DRIVES if line_of(name) is kind),
                   key=lambda name: name != protocol)
    guesses = [(name, baud) for name in names]
    if kind is not SERIAL:
        return guesses
    rates = {name: driver_class(name).baud_rates for name in names}
    for turn in range(max(len(each) for each in rates.values())):
        guesses += [(name, rates[name][turn]) for name in names if turn < len(rates[name])]
    return list(dict.fromkeys(guesses))


def examine(hardware_name: str, port: str, environment: Mapping[str, str],
            progress: Callable[[str], None] = lambda text: None) -> Iterator[Finding]:
    """Yield all findings; a given port replaces that of the file."""
    yield from check_ports()
    yield from check_buses()
    try:
        yield from check_drive(load_hardware(hardware_name).at(port), progress)
    except BallbotError as error:
        yield Finding(WRONG, str(error))
    yield check_scheduling()
    yield from check_ros(environment)
