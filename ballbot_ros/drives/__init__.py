# SPDX-License-Identifier: Apache-2.0
"""
Motor controllers: one folder per vendor, registered in the table `DRIVES`.

To add one, copy the folder `vesc/uart` (the simplest) and add a line to `DRIVES`.  The driver, the
emulated device, the choices of the command line and of hardware files, the fuzz targets, the
benchmarks and the tables of docs/hardware.md follow from that line, which also selects a serial
line or a CAN bus.  Its folder has three modules:

``codec``
    Conversion of bytes to messages and back; only the parser has state.  `parser()` returns a new
    parser, whose `feed(data)` returns the replies that the data complete.  `frame_reply(message)`
    returns the bytes in which the drive sends a reply, and `reply_of(data)` makes a valid frame
    from any bytes; `make fuzz` checks that the stream contains each reply of the parser.
``driver``
    A subclass of `driver.Driver`, which implements the contract of contract.py.
``emulated``
    A subclass of `emulated_device.Device`: the firmware in software, for tests and demos.
    `memory_line.MemoryLine` connects it to a driver without a serial port.

With an emulated drive in memory:

    >>> from ballbot_ros.drives.emulated_device import DriveSettings
    >>> from ballbot_ros.drives.memory_line import MemoryLine
    >>> line = MemoryLine(device_class('vesc')(DriveSettings(torque_limit=0.05)))
    >>> options = read_options('vesc', {'torque_limit': 0.05}, 'here')
    >>> driver = open_driver('vesc', line, options, line.clock)
    >>> driver.identify().protocol
    'vesc'
    >>> driver.arm()
    >>> driver.send_torque(0.01)
    >>> driver.stop()
"""
from importlib import import_module
from pkgutil import resolve_name
from types import ModuleType
from typing import Any, Callable, Mapping, NamedTuple, Optional, Type

from ballbot_ros.clock import steady_time
from ballbot_ros.config.fields import suggestion
from ballbot_ros.drives.capture import TrafficSink
from ballbot_ros.drives.contract import DriveOptions, SerialLine
from ballbot_ros.drives.driver import Driver
from ballbot_ros.drives.emulated_device import Device
from ballbot_ros.errors import ConfigurationError


# Classes that open a port.
SERIAL, CAN = 'ballbot_ros.drives.transport:Link', 'ballbot_ros.drives.can_transport:CanLink'


class Vendor(NamedTuple):
    """The modules and classes of a drive; each is imported at the first use."""

    folder: str  # with the modules codec, driver and emulated
    driver: str  # class in driver
    device: str  # class in emulated
    line: str = SERIAL


# Protocol -> vendor.
DRIVES = {
    'odrive': Vendor('ballbot_ros.drives.odrive.ascii', 'ODrive', 'ODriveDevice'),
    'odrive_can': Vendor(
        'ballbot_ros.drives.odrive.cansimple', 'ODriveCan', 'ODriveCanDevice', CAN),
    'roboclaw': Vendor('ballbot_ros.drives.roboclaw', 'RoboClaw', 'RoboClawDevice'),
    'vesc': Vendor('ballbot_ros.drives.vesc.uart', 'Vesc', 'VescDevice'),
    'vesc_can': Vendor('ballbot_ros.drives.vesc.can', 'VescCan', 'VescCanDevice', CAN),
}


def codec_of(protocol: str) -> ModuleType:
    """Return the codec of a protocol; raises `ConfigurationError` for an unknown one."""
    return import_module(f'{_vendor(protocol).folder}.codec')


def driver_class(protocol: str) -> Type[Driver]:
    """Return the driver of a protocol; raises as `codec_of` does."""
    vendor = _vendor(protocol)
    found: Type[Driver] = resolve_name(f'{vendor.folder}.driver:{vendor.driver}')
    return found


def device_class(protocol: str) -> Type[Device]:
    """Return the emulated device of a protocol; raises as `codec_of` does."""
    vendor = _vendor(protocol)
    found: Type[Device] = resolve_name(f'{vendor.folder}.emulated:{vendor.device}')
    return found


def _vendor(protocol: str) -> Vendor:
    if protocol not in DRIVES:
        raise ConfigurationError(
            f'{protocol!r} is not a protocol{suggestion(str(protocol), DRIVES)}',
            'unknown_name', 'protocol')
    return DRIVES[protocol]


def read_options(protocol: str, mapping: Mapping[str, Any], where: str) -> DriveOptions:
    """
    Return the options of a driver from the mapping of a YAML file.

    Raises `ConfigurationError` for an unknown protocol, and for a missing, unknown or out-of-range
    option.
    """
    return driver_class(protocol).Options.from_mapping(mapping, where)


def line_of(protocol: str) -> str:
    """Return `SERIAL` or `CAN`; raises as `codec_of` does."""
    return _vendor(protocol).line


def open_line(protocol: str, port: str, baud: int,
              recorder: Optional[TrafficSink] = None) -> SerialLine:
    """
    Open the line of a protocol at a bit rate [bit/s]; a recorder keeps a copy of the traffic.

    See transport.py for the port of a serial line, can_transport.py for that of a CAN bus.  Raises
    `ConfigurationError` if there is no such protocol, `LinkError` if the port cannot be opened.
    """
    opened: SerialLine = resolve_name(line_of(protocol))(port, baud, recorder)
    return opened


def open_driver(protocol: str, line: SerialLine, options: DriveOptions,
                clock: Callable[[], float] = steady_time) -> Driver:
    """
    Return a driver on an open line; nothing is sent yet.

    Raises `ConfigurationError` for an unknown protocol, or for options of another protocol.
    """
    found = driver_class(protocol)
    if not isinstance(options, found.Options):
        raise ConfigurationError(
            f'{protocol} requires {found.Options.__name__}, got {type(options).__name__}',
            'wrong_type', 'drive')
    return found(line, options, clock)
