# SPDX-License-Identifier: Apache-2.0
"""Heat and battery: derating of the torque, warnings, and reasons to engage the e-stop."""
import math
from typing import NamedTuple, Tuple

from ballbot_ros.bridge.battery import BatteryWatch
from ballbot_ros.bridge.derating import derating, warmed
from ballbot_ros.bridge.hardware_file import Hardware
from ballbot_ros.drives.contract import Telemetry

# Sampling period of voltage and temperatures [s]; a drive reports them no faster.
LOOK_EVERY = 0.05
# Time constant of the peak torque [s], from which a fade starts.
OF_LATE = 1.0


class Condition(NamedTuple):
    """Status of the drive: derating by heat and battery."""

    part: float = 1.0  # of torque_limit
    warnings: Tuple[str, ...] = ()
    stop: str = ''  # reason to engage the e-stop, empty for none
    voltage: float = math.nan  # of the battery, open-circuit, smoothed [V]
    percentage: float = math.nan  # approximate charge of the battery, 0 to 1
    warmth: float = 0.0  # of the winding; 1 is the continuous rating


class ConditionMonitor:
    """
    Monitors the temperatures and the supply that a drive reports.

    Attributes
    ----------
    condition : Condition

    """

    def __init__(self, hardware: Hardware):
        self._battery, self._thermal = hardware.battery, hardware.thermal
        self._torque_limit = hardware.limits.torque_limit
        self._watch, self.condition = BatteryWatch(), Condition()
        self._warmth, self._largest = 0.0, 0.0
        self._time, self._next = math.inf, -math.inf

    def look(self, telemetry: Telemetry, torque: float, now: float) -> Condition:
        """
        Return the condition now.

        Parameters
        ----------
        telemetry : Telemetry
        torque : float
            At the pendulum, applied since the last sample [N m].
        now : float
            [s]

        """
        thermal, battery = self._thermal, self._battery
        if thermal.continuous_torque is not None:
            self._warmth = warmed(self._warmth, torque / thermal.continuous_torque,
                                  now - self._time, thermal.time_constant)
        fading = now >= self._watch.fading_since
        if not fading:
            self._largest = max(abs(torque), self._largest * (
                1.0 - min(max(now - self._time, 0.0) / OF_LATE, 1.0)))
        self._time = now
        if now < self._next:
            return self.condition
        self._next = now + LOOK_EVERY
        heat = derating(thermal, telemetry.temperature, telemetry.motor_temperature,
                        self._warmth, self._torque_limit)
        self._watch = watch = self._watch.look(
            battery, telemetry.bus_voltage, telemetry.bus_current, now)
        part = heat.part
        if fading:
            # Fade from the torque in use, not from the limit, which would drop the pendulum at the
            # end.
            part = min(part, watch.part(battery, now) * self._largest / self._torque_limit)
        self.condition = Condition(
            part, watch.warnings(now) + heat.warnings,
            watch.stop(battery, now), watch.voltage, watch.percentage(battery), self._warmth)
        return self.condition
