# SPDX-License-Identifier: Apache-2.0
"""Heat and battery: what they leave of the torque, what is told of them, when they end a drive."""
import math
from typing import NamedTuple, Tuple

from ballbot_ros.bridge.battery import BatteryWatch
from ballbot_ros.bridge.derating import derating, warmed
from ballbot_ros.bridge.hardware_file import Hardware
from ballbot_ros.drives.contract import Telemetry

# Voltage and temperatures are looked at so often [s]; a drive reports them no faster.
LOOK_EVERY = 0.05
# In which the largest torque of late is forgotten [s]: a torque that fades begins there.
OF_LATE = 1.0


class Condition(NamedTuple):
    """What heat and battery leave."""

    part: float = 1.0  # of torque_limit
    warnings: Tuple[str, ...] = ()
    stop: str = ''  # why the e-stop must be engaged; empty while it need not
    voltage: float = math.nan  # of the battery at rest, smoothed [V]
    percentage: float = math.nan  # roughly how full it is, from 0 to 1
    warmth: float = 0.0  # of the winding; 1 is what it bears for good


class ConditionMonitor:
    """
    Watches what a drive reports of its heat and its supply.

    Attributes
    ----------
    condition : Condition

    """

    def __init__(self, hardware: Hardware):
        """Start cold, with a battery of which nothing is known."""
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
            At the pendulum, in force since the last look [N m].
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
            # Of what it gave, not of what it might: that would fade last, and the pendulum drop.
            part = min(part, watch.part(battery, now) * self._largest / self._torque_limit)
        self.condition = Condition(
            part, watch.warnings(now) + heat.warnings,
            watch.stop(battery, now), watch.voltage, watch.percentage(battery), self._warmth)
        return self.condition
