# SPDX-License-Identifier: Apache-2.0
"""
Battery monitoring: state of charge, and when a low battery stops the robot.

The voltage drops under load.  So the thresholds apply to the open-circuit voltage, the measured
voltage plus the drop over the internal resistance, smoothed; and the battery must stay below
empty_voltage for a while before the torque fades.
"""
from dataclasses import dataclass
import math
from typing import NamedTuple, Optional, Tuple

from ballbot_ros.config.fields import Checked, quantity, text
from ballbot_ros.errors import ConfigurationError

# Shortest duration of a warning [s].
SEEN = 2.0
# A low-battery warning ends this fraction above low_voltage.
HYSTERESIS = 0.01

TECHNOLOGIES = ('unknown', 'nimh', 'lion', 'lipo', 'life', 'nicd', 'limn')


@dataclass(frozen=True)
class Battery(Checked):
    """Thresholds of the open-circuit voltage; a threshold that is not given is not monitored."""

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
        'V', 'voltage above which braking feeds back more than battery and brake resistor absorb: '
        'a warning, to be set below the cut-off limit of the drive', above=0.0, maximum=1000.0,
        optional=True)
    resistance: float = quantity(
        'ohm', 'resistance of battery and leads, through which the current lowers the voltage',
        default=0.0, minimum=0.0, maximum=10.0)
    smoothing: float = quantity(
        's', 'time constant with which the voltage is smoothed', default=2.0, above=0.0,
        maximum=600.0)
    empty_time: float = quantity(
        's', 'time for which it must be empty', default=5.0, minimum=0.0, maximum=600.0)
    fade_time: float = quantity(
        's', 'time in which the torque then fades, to lower the pendulum', default=2.0,
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
                    f'Battery: {lower} must be below {upper}, got {low:g} and {high:g} V',
                    'inconsistent', lower)


class BatteryWatch(NamedTuple):
    """State of the battery monitor; each sample returns the next state."""

    voltage: float = math.nan  # open-circuit, smoothed; NaN before the first reading [V]
    time: float = -math.inf  # of the last sample [s]
    low: bool = False
    empty_since: float = math.inf  # start of the uninterrupted time below empty_voltage [s]
    fading_since: float = math.inf  # start of the fade of the torque [s]
    too_high_until: float = -math.inf  # end of the high_voltage warning [s]

    def look(self, battery: Battery, voltage: Optional[float], current: Optional[float],
             now: float) -> 'BatteryWatch':
        """
        Return the state after a sample of the drive.

        Parameters
        ----------
        battery : Battery
        voltage : float, optional
            Of the supply [V]; NaN, or a value not above 0, is not a reading.
        current : float, optional
            From the battery, negative while it charges [A]; 0 if the drive does not report it.
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
            fading = math.inf  # the battery was replaced or charged
        elif low is None and not is_empty:
            fading = math.inf
        return BatteryWatch(
            smooth, now,
            low is not None and smooth < low * (1.0 + HYSTERESIS * self.low),
            empty_since, fading,
            now + SEEN if high is not None and voltage > high else self.too_high_until)

    def part(self, battery: Battery, now: float) -> float:
        """Return the available fraction of the torque: 1 until the fade, which ends at 0."""
        if now < self.fading_since:
            return 1.0
        if battery.fade_time <= 0.0:
            return 0.0
        return max(0.0, 1.0 - (now - self.fading_since) / battery.fade_time)

    def stop(self, battery: Battery, now: float) -> str:
        """Return the reason to engage the e-stop, empty for none."""
        if now < self.fading_since or self.part(battery, now) > 0.0:
            return ''
        return (f'the battery is empty: {self.voltage:.1f} V at rest, empty_voltage is '
                f'{battery.empty_voltage:g} V; charge it'
                + ('' if battery.low_voltage is None else f' above {battery.low_voltage:g} V'))

    def warnings(self, now: float) -> Tuple[str, ...]:
        """Return the names of the active warnings."""
        return tuple(name for name, active in (
            ('battery_empty', now >= self.fading_since), ('battery_low', self.low),
            ('over_voltage', now < self.too_high_until)) if active)

    def percentage(self, battery: Battery) -> float:
        """Return the approximate charge, 0 to 1, from the voltage; NaN if it is unknown."""
        if battery.full_voltage is None or battery.empty_voltage is None:
            return math.nan
        span = battery.full_voltage - battery.empty_voltage
        part = (self.voltage - battery.empty_voltage) / span
        return part if math.isnan(part) else min(max(part, 0.0), 1.0)
