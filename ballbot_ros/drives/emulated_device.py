# SPDX-License-Identifier: Apache-2.0
"""Base class of the firmware of all emulated motor controllers."""
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Mapping, NamedTuple

from ballbot_ros.config.fields import Checked, count, quantity, section, suggestion, text
from ballbot_ros.errors import ConfigurationError


class Sensed(NamedTuple):
    """Measurements of the electronics of a drive."""

    position: float = 0.0  # of the motor shaft, not wrapped [rad]
    velocity: float = 0.0  # [rad/s]
    bus_voltage: float = 24.0  # [V]
    temperature: float = 35.0  # of the power stage [degC]
    motor_temperature: float = 30.0  # [degC]
    stop_switch: float = 0.0  # 1 if the emergency switch at the drive's input is engaged


class Quirk(NamedTuple):
    """Behaviour of some boards of a maker, by firmware or settings, that a driver must handle."""

    effect: str  # as text
    source: str  # file of the maker that documents it, with versions


@dataclass(frozen=True)
class DriveSettings(Checked):
    """Settings of an emulated drive and its motor."""

    torque_constant: float = quantity('N m/A', 'motor torque per ampere', default=0.025,
                                      above=0.0)
    speed_constant: float = quantity('V s/rad', 'back EMF per motor speed', default=0.025,
                                     minimum=0.0)
    resistance: float = quantity('ohm', 'armature resistance', default=3.125, above=0.0)
    current_limit: float = quantity('A', 'largest motor current', default=4.0, above=0.0)
    torque_limit: float = quantity('N m', 'largest motor torque', default=0.1, above=0.0)
    watchdog: float = quantity('s', 'time without a command after which the motor is '
                               'disarmed; 0 for never', default=0.1, minimum=0.0, maximum=25.0)
    counts_per_turn: int = count('encoder counts per motor turn', default=4096, minimum=4)
    pole_pairs: int = count('pole pairs of the motor', default=7, minimum=1)
    highest_temperature: float = quantity('degC', 'temperature at which the power stage trips',
                                          default=100.0)
    axis: int = count('motor output in use, for a drive with two', default=0, maximum=1)
    boot_time: float = quantity('s', 'time that a reboot takes', default=0.3, minimum=0.0)
    firmware: str = text('firmware generation; empty for the only or oldest one',
                         default='')
    quirks: tuple[str, ...] = section('quirks of this device, by names from `Device.quirks`',
                                      default=())

    @property
    def largest_current(self) -> float:
        """Return the largest motor current within both limits [A]."""
        return min(self.current_limit, self.torque_limit / self.torque_constant)


class Device(ABC):
    """
    The firmware of a motor controller: bytes in, bytes out, a torque at the shaft.

    It has no clock; the caller passes a monotonic time [s].  The owner updates `sensed`, the
    measurements of the motor, and `second`, those of a motor on the other output; `baud`, that of
    the line, gives the duration of a reply.  Raises `ConfigurationError` if the drive does not
    support the firmware or the quirks of the settings.
    """

    protocol: ClassVar[str]
    # Generations with different protocols; empty if there is only one.
    firmwares: ClassVar[tuple[str, ...]] = ()
    # Optional behaviour, by name.  Behaviour of all boards is not a quirk: it is not optional.
    quirks: ClassVar[Mapping[str, Quirk]] = {}
    # Time that the firmware takes from a request to its reply [s].
    turnaround: ClassVar[float] = 0.0002

    def __init__(self, settings: DriveSettings):
        if settings.firmware and settings.firmware not in self.firmwares:
            known = ' or '.join(self.firmwares) or 'empty: there is only one'
            raise ConfigurationError(
                f'firmware of an emulated {self.protocol} must be {known}, got '
                f'{settings.firmware!r}', 'not_a_choice', 'firmware')
        for quirk in settings.quirks:
            if quirk not in self.quirks:
                raise ConfigurationError(
                    f'{quirk!r} is not a quirk of an emulated {self.protocol}'
                    + suggestion(quirk, self.quirks), 'unknown_name', quirk)
        self.settings = settings
        self.sensed, self.second = Sensed(), Sensed()
        self.baud = 921600.0
        self.booted_at = -1e9
        self._boot()

    def has(self, quirk: str) -> bool:
        """Return whether this drive has a quirk."""
        return quirk in self.settings.quirks

    def receive(self, data: bytes, now: float) -> bytes:
        """Process bytes from the line and return the reply."""
        return self._receive(data, now) if now >= self.booted_at else b''

    def reboot(self, now: float) -> None:
        """Reset all state and ignore data for the boot time."""
        self.booted_at = now + self.settings.boot_time
        self._boot()

    @abstractmethod
    def tick(self, now: float) -> None:
        """Update watchdog and temperature; called often."""

    @abstractmethod
    def torque(self) -> float:
        """Return the torque at the shaft [N m]."""

    def current(self) -> float:
        """Return the current of the motor [A]."""
        return self.torque() / self.settings.torque_constant

    def power(self) -> float:
        """Return the power at the shaft and of the losses in the winding [W]."""
        current = self.current()  # a square of a float would raise `OverflowError`
        return self.torque() * self.sensed.velocity + self.settings.resistance * current * current

    def second_torque(self) -> float:
        """Return the torque of a motor on the other output [N m]; 0 where there is none."""
        return 0.0

    @abstractmethod
    def over_current(self) -> None:
        """Trip as the firmware does on an over-current."""

    @abstractmethod
    def _receive(self, data: bytes, now: float) -> bytes:
        """Process bytes from the line and return the reply."""

    @abstractmethod
    def _boot(self) -> None:
        """Reset the state of the firmware."""
