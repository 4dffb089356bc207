# SPDX-License-Identifier: Apache-2.0
"""Two emulated drives on one CAN bus."""
from dataclasses import replace
from typing import Any

from ballbot_ros.drives import CAN, device_class, driver_class, line_of
from ballbot_ros.drives.emulated_device import Device, DriveSettings
from ballbot_ros.errors import ConfigurationError


def _sensed_by(device: str) -> Any:
    """Return a property: the measurements of one of two devices."""
    return property(lambda self: getattr(self, device).sensed,
                    lambda self, sensed: setattr(getattr(self, device), 'sensed', sensed))


class BusOfTwo(Device):
    """
    Two devices of a protocol on a bus, as one device with a second output; see `Device`.

    Parameters
    ----------
    device : type of Device
    settings : DriveSettings
        Of the first; those of the second differ in `axis`.

    """

    def __init__(self, device: type[Device], settings: DriveSettings):
        self.first, self.other = device(settings), device(replace(settings, axis=1))
        self.settings = settings

    def __getattr__(self, name: str) -> Any:
        """Return the content that only the first device of its class has."""
        return getattr(self.__dict__['first'], name)

    sensed, second = _sensed_by('first'), _sensed_by('other')

    @property
    def baud(self) -> float:
        """Return the bit rate of the bus."""
        return self.first.baud

    @baud.setter
    def baud(self, baud: float) -> None:
        self.first.baud = self.other.baud = baud

    def torque(self) -> float:
        """Return the torque of the first motor [N m]."""
        return self.first.torque()

    def second_torque(self) -> float:
        """Return the torque of the second motor [N m]."""
        return self.other.torque()

    def tick(self, now: float) -> None:
        """Update both."""
        self.first.tick(now)
        self.other.tick(now)

    def receive(self, data: bytes, now: float) -> bytes:
        """Give bytes to both."""
        return self.first.receive(data, now) + self.other.receive(data, now)

    def reboot(self, now: float) -> None:
        """Let both lose their supply."""
        self.first.reboot(now)
        self.other.reboot(now)

    def over_current(self) -> None:
        """Let the first one trip."""
        self.first.over_current()

    _receive = receive

    def _boot(self) -> None:
        """Do nothing: each device boots separately."""


def new_device(protocol: str, settings: DriveSettings, steering: bool = False) -> Device:
    """
    Return an emulated drive, with a second motor where the robot steers.

    Raises
    ------
    ConfigurationError
        If replies of the protocol do not name the axis: a port has one drive with one motor then.

    """
    device = device_class(protocol)
    if not steering:
        return device(settings)
    if not driver_class(protocol).shares_line:
        raise ConfigurationError(
            f'an emulated {protocol} has one motor; a second one that steers needs roboclaw, '
            'odrive_can or vesc_can', 'unsupported', 'steering')
    return BusOfTwo(device, settings) if line_of(protocol) is CAN else device(settings)
