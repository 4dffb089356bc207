# SPDX-License-Identifier: Apache-2.0
"""
Inertial sensors on a serial port: one folder per vendor, registered in the table `IMUS`.

To add one, copy the folder `witmotion` and add a line to `IMUS`; the choices of the node `imu`
follow from that line.  The folder has two modules: ``protocol`` with a subclass of
`contract.InertialSensor`, and ``emulated`` with one of `contract.EmulatedSensor`.

    >>> sensor = sensor_class('witmotion')(baud=115200, rate=200, bandwidth=98)
    >>> emulated = emulated_class('witmotion')()
    >>> emulated.baud == sensor.factory_baud
    True
"""
from pkgutil import resolve_name
from typing import NamedTuple, Type

from ballbot_ros.config.fields import suggestion
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.imus.contract import EmulatedSensor, InertialSensor


class ImuVendor(NamedTuple):
    """Names of the classes of a sensor; each is imported when it is first needed."""

    folder: str  # with the modules protocol and emulated
    sensor: str  # class in protocol
    emulated: str  # class in emulated


IMUS = {
    'witmotion': ImuVendor('ballbot_ros.imus.witmotion', 'WitMotion', 'EmulatedWitMotion'),
}


def sensor_class(vendor: str) -> Type[InertialSensor]:
    """Return the protocol of a vendor; raises `ConfigurationError` ``unknown_name``."""
    entry = _entry(vendor)
    found: Type[InertialSensor] = resolve_name(f'{entry.folder}.protocol:{entry.sensor}')
    return found


def emulated_class(vendor: str) -> Type[EmulatedSensor]:
    """Return the emulated sensor of a vendor; raises as `sensor_class` does."""
    entry = _entry(vendor)
    found: Type[EmulatedSensor] = resolve_name(f'{entry.folder}.emulated:{entry.emulated}')
    return found


def _entry(vendor: str) -> ImuVendor:
    if vendor not in IMUS:
        raise ConfigurationError(
            f'there is no inertial sensor {vendor!r}{suggestion(str(vendor), IMUS)}',
            'unknown_name', 'sensor')
    return IMUS[vendor]
