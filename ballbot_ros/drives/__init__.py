# SPDX-License-Identifier: Apache-2.0
"""
The drivers, one file each, and the only table of them.

A further one needs a module with a class made from `hardware.driver.Driver`, and a line here.
"""
from importlib import import_module
import time
from typing import Any, Callable, Mapping, Type

from ballbot_ros.config.fields import suggestion
from ballbot_ros.drives.driver import DriveOptions, Driver, Line
from ballbot_ros.errors import ConfigurationError

# Protocol -> module and class.
DRIVERS = {
    'odrive': ('ballbot_ros.drives.odrive.driver', 'ODrive'),
    'roboclaw': ('ballbot_ros.drives.roboclaw.driver', 'RoboClaw'),
    'vesc': ('ballbot_ros.drives.vesc.driver', 'Vesc'),
}


def driver_class(protocol: str) -> Type[Driver]:
    """
    Return the driver of a protocol.

    Raises
    ------
    ConfigurationError
        Naming the protocols that there are.

    """
    if protocol not in DRIVERS:
        raise ConfigurationError(
            f'{protocol!r} is not a protocol{suggestion(str(protocol), DRIVERS)}')
    module, name = DRIVERS[protocol]
    found: Type[Driver] = getattr(import_module(module), name)
    return found


def read_options(protocol: str, mapping: Mapping[str, Any], where: str) -> DriveOptions:
    """
    Return the options of a driver from the mapping of a YAML file.

    Raises
    ------
    ConfigurationError
        For an unknown protocol, and for anything missing, unknown or out of range.

    """
    return driver_class(protocol).Options.from_mapping(mapping, where)


def open_driver(protocol: str, line: Line, options: DriveOptions,
                clock: Callable[[], float] = time.monotonic) -> Driver:
    """
    Return a driver on an open line; nothing is sent yet.

    Raises
    ------
    ConfigurationError
        If there is no such protocol, or the options are those of another.

    """
    found = driver_class(protocol)
    if not isinstance(options, found.Options):
        raise ConfigurationError(
            f'{protocol} wants {found.Options.__name__}, got {type(options).__name__}')
    return found(line, options, clock)
