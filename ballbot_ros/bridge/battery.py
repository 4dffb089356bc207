# SPDX-License-Identifier: Apache-2.0
"""
The battery behind the drive: how full it is, and when the robot must come to rest.

A battery under load shows less than it has.  So it is judged by what it would show at rest, the
voltage plus what its resistance takes at the current, smoothed; and an empty one must stay empty
for a while before the torque fades.
"""
from dataclasses import dataclass
import math
from typing import NamedTuple, Optional, Tuple

from ballbot_ros.config.fields import Checked, quantity, text
from ballbot_ros.errors import ConfigurationError

# A warning stays so long, to be seen [s].
SEEN = 2.0
# What a warning of a low battery ends at, beside low_voltage, as a part of it.
HYSTERESIS = 0.01

TECHNOLOGIES = ('unknown', 'nimh', 'lion', 'lipo', 'life', 'nicd', 'limn')


@dataclass(frozen=True)
class Battery(Checked):
    """What a battery shows at rest; what is not given is not watched."""

    technology: str = text(
        'technology of the cells, as in sensor_msgs/BatteryState', default='unknown',
        choices=TECHNOLOGIES)
    full_voltage: Optional[float] = quantity(
        'V', 'voltage at rest when full', above=0.0, maximum=1000.0, optional=True)
    low_voltage: Optional[float] = quantity(
        'V', 'voltage below which it should be charged: a warning', above=0.0, maximum=1000.0,
        optional=True)
    empty_voltage: Optional[float] = quantity(
        'V', 'voltage below which, for empty_time, the torque fades and the e-stop engages',
        above=0.0, maximum=1000.0, optional=True)
    high_voltage: Optional[float] = quantity(
        'V', 'voltage above which braking feeds back more than battery and brake resistor take: '
        'a warning, to be set below the limit at which the drive cuts', above=0.0, maximum=1000.0,
        optional=True)
    resistance: float = quantity(
        'ohm', 'resistance of battery and leads, through which the current lowers the voltage',
        default=0.0, minimum=0.0, maximum=10.0)
    smoothing: float = quantity(
        's', 'time constant with which the voltage is smoothed', default=2.0, above=0.0,
        maximum=600.0)
    empty_time: float = quantity(
        's', 'how long it must be empty', default=5.0, minimum=0.0, maximum=600.0)
    fade_time: float = quantity(
        's', 'time in which the torque then fades, so that the pendulum comes down', default=2.0,
        minimum=0.0, maximum=60.0)
    capacity: Optional[float] = quantity(
        'A h', 'charge when full', above=0.0, maximum=1e4, optional=True)

    def __post_init__(self) -> None:
        """Check each value, and that empty is below low, and so on."""
        super().__post_init__()
        given = [(name, value) for name, value in (
            ('empty_voltage', self.empty_voltage), ('low_voltage', self.low_voltage),
            ('full_voltage', self.full_voltage), ('high_voltage', self.high_voltage))
            if value is not None]
        for (lower, low), (upper, high) in zip(given, given[1:]):
            if not low < high:
                raise ConfigurationError(
                    f'Battery: {lower} must be below {upper}, got {low:g} and {high:g} V')


class BatteryWatch(NamedTuple):
    """What is known of a battery; each look gives the next."""

    voltage: float = math.nan  # at rest, smoothed; NaN before it was read [V]
    time: float = -math.inf  # of the last look [s]
    low: bool = False
    empty_since: float = math.inf  # below empty_voltage without a break [s]
    fading_since: float = math.inf  # the torque fades [s]
    too_high_until: float = -math.inf  # the warning of high_voltage stays [s]

    def look(self, battery: Battery, voltage: Optional[float], current: Optional[float],
             now: float) -> 'BatteryWatch':
        """
        Return what is known after a look at the drive.

        Parameters
        ----------
        battery : Battery
        voltage : float, optional
            Of the supply [V]; what is no number, or not above 0, is no reading.
        current : float, optional
            From the battery, negative while it is fed [A]; 0 where it is not known.
        now : float
            [s]

        """
        if voltage is None or not (math.isfinite(voltage) and voltage > 0.0):
            return self
        drawn = current if current is not None and math.isfinite(current) else 0.0
        rest, pause = voltage + battery.resistance * drawn, now - self.time
        if math.isnan(self.voltage):
            smooth = rest
        else:
            smooth = rest + (self.voltage - rest) * math.exp(
                -max(pause, 0.0) / battery.smoothing)
        low, empty, high = battery.low_voltage, battery.empty_voltage, battery.high_voltage
        is_empty = empty is not None and smooth < empty
        empty_since = min(self.empty_since, now) if is_empty else math.inf
        fading = self.fading_since
        if now - empty_since >= battery.empty_time:
            fading = min(fading, now)
        elif low is not None and smooth >= low:
            fading = math.inf  # another battery, or a charged one
        elif low is None and not is_empty:
            fading = math.inf
        return BatteryWatch(
            smooth, now,
            low is not None and smooth < low * (1.0 + HYSTERESIS * self.low),
            empty_since, fading,
            now + SEEN if high is not None and voltage > high else self.too_high_until)

    def part(self, battery: Battery, now: float) -> float:
        """Return the part of the torque that is left: 1 until it fades, then down to 0."""
        if now < self.fading_since:
            return 1.0
        if battery.fade_time <= 0.0:
            return 0.0
        return max(0.0, 1.0 - (now - self.fading_since) / battery.fade_time)

    def stop(self, battery: Battery, now: float) -> str:
        """Return why the e-stop must be engaged; empty while it need not."""
        if now < self.fading_since or self.part(battery, now) > 0.0:
            return ''
        return (f'the battery is empty: {self.voltage:.1f} V at rest, empty_voltage is '
                f'{battery.empty_voltage:g} V; charge it'
                + ('' if battery.low_voltage is None else f' above {battery.low_voltage:g} V'))

    def warnings(self, now: float) -> Tuple[str, ...]:
        """Return the names of what is to be told."""
        return tuple(name for name, told in (
            ('battery_empty', now >= self.fading_since), ('battery_low', self.low),
            ('over_voltage', now < self.too_high_until)) if told)

    def percentage(self, battery: Battery) -> float:
        """Return roughly how full it is, from 0 to 1, by its voltage; NaN where nobody knows."""
        if battery.full_voltage is None or battery.empty_voltage is None:
            return math.nan
        span = battery.full_voltage - battery.empty_voltage
        part = (self.voltage - battery.empty_voltage) / span
        return part if math.isnan(part) else min(max(part, 0.0), 1.0)
