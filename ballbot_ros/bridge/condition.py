# SPDX-License-Identifier: Apache-2.0
r"""
Heat and battery: derating of the torque, warnings, and reasons to engage the e-stop.

The voltage of a battery drops under load.  So the thresholds apply to the open-circuit voltage,
which is the measured voltage plus the drop across the internal resistance, smoothed; and the
battery must stay below empty_voltage for empty_time before the torque fades.

A winding warms with the square of its current and cools with a time constant.  Its warmth h, 1 at
the continuous rating, follows the torque::

    h' = ((torque / continuous torque)^2 - h) / time constant

Under a constant torque the solution is an exponential, exact for any step.
"""
from dataclasses import dataclass
import math
from typing import NamedTuple, Optional, Tuple

from ballbot_ros.config.fields import Checked, quantity, text
from ballbot_ros.drives.contract import Telemetry
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
        'V', 'voltage below which a warning requests charging', above=0.0, maximum=1000.0,
        optional=True)
    empty_voltage: Optional[float] = quantity(
        'V', 'voltage below which, for empty_time, the torque fades and the e-stop engages',
        above=0.0, maximum=1000.0, optional=True)
    high_voltage: Optional[float] = quantity(
        'V', 'voltage above which a warning reports that braking feeds back more than battery and '
        'brake resistor absorb; set it below the cut-off voltage of the drive',
        above=0.0, maximum=1000.0, optional=True)
    resistance: float = quantity(
        'ohm', 'resistance of battery and leads, through which the current lowers the voltage',
        default=0.0, minimum=0.0, maximum=10.0)
    smoothing: float = quantity(
        's', 'time constant of the low-pass filter of the voltage', default=2.0, above=0.0,
        maximum=600.0)
    empty_time: float = quantity(
        's', 'time below empty_voltage before the fade', default=5.0, minimum=0.0, maximum=600.0)
    fade_time: float = quantity(
        's', 'duration of the fade of the torque, which lowers the pendulum', default=2.0,
        minimum=0.0, maximum=60.0)
    capacity: Optional[float] = quantity(
        'A h', 'charge when full', above=0.0, maximum=1e4, optional=True)

    def __post_init__(self) -> None:
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

    def update(self, battery: Battery, voltage: Optional[float], current: Optional[float],
               now: float) -> 'BatteryWatch':
        """
        Return the state after a sample of the drive at a time [s].

        The voltage is that of the supply [V]; NaN, or a value not above 0, is ignored.  The
        current is drawn from the battery, negative while it charges [A]; without a reported
        current, 0 is used.
        """
        if voltage is None or not (math.isfinite(voltage) and voltage > 0.0):
            return self
        drawn = current if current is not None and math.isfinite(current) else 0.0
        rest, pause = voltage + battery.resistance * drawn, now - self.time
        before = rest if math.isnan(self.voltage) else self.voltage
        smooth = rest + (before - rest) * math.exp(-max(pause, 0.0) / battery.smoothing)
        low, empty, high = battery.low_voltage, battery.empty_voltage, battery.high_voltage
        is_empty = empty is not None and smooth < empty
        empty_since = min(self.empty_since, now) if is_empty else math.inf
        fading = self.fading_since
        if now - empty_since >= battery.empty_time:
            fading = min(fading, now)
        elif not is_empty if low is None else smooth >= low:
            fading = math.inf  # the battery was replaced or charged
        return BatteryWatch(
            smooth, now,
            low is not None and smooth < low * (1.0 + HYSTERESIS * self.low),
            empty_since, fading,
            now + SEEN if high is not None and voltage > high else self.too_high_until)

    def part(self, battery: Battery, now: float) -> float:
        """Return the available fraction of the torque: 1 until the fade, which ends at 0."""
        since = self.fading_since
        return 1.0 if now < since else left_at(now, since, since + battery.fade_time)

    def stop(self, battery: Battery, now: float) -> str:
        """Return the reason to engage the e-stop, empty for none."""
        if self.part(battery, now) > 0.0:
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


# Warmth at which derating starts; at 1 the continuous torque remains.
DERATING_START = 0.8


@dataclass(frozen=True)
class Thermal(Checked):
    """Thermal limits of power stage and motor; a limit that is not given is not monitored."""

    drive_warn_at: Optional[float] = quantity(
        'degC', 'temperature of the power stage above which the torque is reduced',
        minimum=0.0, maximum=200.0, optional=True)
    drive_zero_at: Optional[float] = quantity(
        'degC', 'temperature of the power stage at which the torque is zero; set it below the '
        'cut-off temperature of the drive', minimum=0.0,
        maximum=200.0, optional=True)
    motor_warn_at: Optional[float] = quantity(
        'degC', 'temperature of the motor above which the torque is reduced', minimum=0.0,
        maximum=300.0, optional=True)
    motor_zero_at: Optional[float] = quantity(
        'degC', 'temperature of the motor at which the torque is zero', minimum=0.0, maximum=300.0,
        optional=True)
    continuous_torque: Optional[float] = quantity(
        'N m', 'continuous torque rating of the motor, at the pendulum', above=0.0,
        maximum=1000.0, optional=True)
    time_constant: float = quantity(
        's', 'thermal time constant of the winding', default=30.0, above=0.0, maximum=1e4)

    def __post_init__(self) -> None:
        super().__post_init__()
        for part, warn_at, zero_at in (
                ('drive', self.drive_warn_at, self.drive_zero_at),
                ('motor', self.motor_warn_at, self.motor_zero_at)):
            if (warn_at is None) != (zero_at is None):
                raise ConfigurationError(
                    f'Thermal: {part}_warn_at and {part}_zero_at belong together, got {warn_at} '
                    f'and {zero_at} degC; give both or neither', 'missing', f'{part}_warn_at')
            if warn_at is not None and zero_at is not None and not warn_at < zero_at:
                raise ConfigurationError(
                    f'Thermal: {part}_warn_at must be below {part}_zero_at, got {warn_at:g} and '
                    f'{zero_at:g} degC', 'inconsistent', f'{part}_warn_at')


def left_at(value: float, start: float, end: float) -> float:
    """Return the fraction of the torque at a value: 1 up to `start`, then linear to 0 at `end`."""
    if value < end:
        return min((end - value) / (end - start), 1.0)
    return 0.0


def warmed(warmth: float, load: float, seconds: float, time_constant: float) -> float:
    """
    Return the warmth of a winding after `seconds` under a constant load [s].

    A warmth of 1 is the continuous rating of the winding; the load is torque over continuous
    torque.
    """
    return load**2 + (warmth - load**2) * math.exp(-max(seconds, 0.0) / time_constant)


def left_by(warmth: float, continuous: float) -> float:
    """Return the fraction of the torque at a warmth; at 1 the continuous fraction remains."""
    return 1.0 if continuous >= 1.0 else (
        continuous + (1.0 - continuous) * left_at(warmth, DERATING_START, 1.0))


def derating(thermal: Thermal, temperature: Optional[float], motor_temperature: Optional[float],
             warmth: float, torque_limit: float) -> Tuple[float, Tuple[str, ...]]:
    """
    Return the fraction of the torque limit [N m] that heat permits, and the warnings.

    The temperatures are those of the power stage and the motor [degC]; one that is unknown or not
    finite does not limit.  See `warmed` for the warmth.
    """
    parts = {}
    for name, measured, warn_at, zero_at in (
            ('drive_hot', temperature, thermal.drive_warn_at, thermal.drive_zero_at),
            ('motor_hot', motor_temperature, thermal.motor_warn_at, thermal.motor_zero_at)):
        if measured is not None and math.isfinite(measured) \
                and warn_at is not None and zero_at is not None:
            parts[name] = left_at(measured, warn_at, zero_at)
    if thermal.continuous_torque is not None:
        parts['motor_i2t'] = left_by(warmth, thermal.continuous_torque / torque_limit)
    return min(parts.values(), default=1.0), tuple(
        name for name, part in parts.items() if part < 1.0)


# Sampling period of voltage and temperatures [s]; a drive reports them no faster.
SAMPLE_PERIOD = 0.05
# Decay time of the peak torque, from which a fade starts [s].
PEAK_TORQUE_TIME = 1.0


class Condition(NamedTuple):
    """Status of the drive: derating by heat and battery."""

    part: float = 1.0  # of torque_limit
    warnings: Tuple[str, ...] = ()
    stop: str = ''  # reason to engage the e-stop, empty for none
    voltage: float = math.nan  # of the battery, open-circuit, smoothed [V]
    percentage: float = math.nan  # approximate charge of the battery, 0 to 1
    warmth: float = 0.0  # of the winding; 1 is the continuous rating


class ConditionMonitor:
    """Monitors the temperatures and the supply that a drive reports."""

    def __init__(self, battery: Battery, thermal: Thermal, torque_limit: float):
        self._battery, self._thermal, self._torque_limit = battery, thermal, torque_limit
        self._watch, self.condition = BatteryWatch(), Condition()
        self._warmth, self._largest = 0.0, 0.0
        self._time, self._next = math.inf, -math.inf

    def update(self, telemetry: Telemetry, torque: float, now: float) -> Condition:
        """Return the condition at a time [s], after a torque since the last sample [N m]."""
        thermal, battery = self._thermal, self._battery
        if thermal.continuous_torque is not None:
            self._warmth = warmed(self._warmth, torque / thermal.continuous_torque,
                                  now - self._time, thermal.time_constant)
        fading = now >= self._watch.fading_since
        if not fading:
            self._largest = max(abs(torque), self._largest * (
                1.0 - min(max(now - self._time, 0.0) / PEAK_TORQUE_TIME, 1.0)))
        self._time = now
        if now < self._next:
            return self.condition
        self._next = now + SAMPLE_PERIOD
        part, warnings = derating(thermal, telemetry.temperature, telemetry.motor_temperature,
                                  self._warmth, self._torque_limit)
        self._watch = watch = self._watch.update(
            battery, telemetry.bus_voltage, telemetry.bus_current, now)
        if fading:
            # Fade from the torque in use, not from the limit, which would drop the pendulum at the
            # end.
            part = min(part, watch.part(battery, now) * self._largest / self._torque_limit)
        self.condition = Condition(
            part, watch.warnings(now) + warnings,
            watch.stop(battery, now), watch.voltage, watch.percentage(battery), self._warmth)
        return self.condition
