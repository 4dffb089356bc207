# SPDX-License-Identifier: Apache-2.0
"""
What the firmware of an ODrive does to its motor, whatever line it is spoken to by.

0.5 is written after MotorControl/axis.cpp (states, watchdog), controller.cpp (torque and velocity
mode, velocity limits, overspeed), motor.cpp (limits) and low_level.cpp (supply, brake resistor) of
odriverobotics/ODrive at fw-v0.5.6.  The source of 0.6 is not published; where it is guessed to be
as in 0.5, and a guess could spare the driver something, it is made against the driver.

Currents follow at once: the supply gives what the shaft takes and the windings heat.
"""
import math
from typing import Mapping, Optional

from ballbot_ros.drives.emulated_device import Device, DriveSettings, Sensed
from ballbot_ros.drives.odrive.codec import CLOSED_LOOP_CONTROL, IDLE, TORQUE_CONTROL
from ballbot_ros.drives.odrive.emulated_names import NAMES, Names

VELOCITY_CONTROL = 2
CALIBRATION = 3  # FULL_CALIBRATION_SEQUENCE
CALIBRATION_TIME = 2.0  # [s]
CONFIG = 'axis0.controller.config.'
# Below its limit of temperature the current is limited over this range, and the limit is so far
# below where it trips (thermistor.cpp) [K].
DERATING, MARGIN = 20.0, 5.0


class Board:
    """
    Properties, states and errors of an ODrive, and the torque of the motor on axis 0.

    Parameters
    ----------
    settings : DriveSettings
    names : Names
    saved : mapping
        Properties that `save` once returned.

    Attributes
    ----------
    properties : dict
    sensed : Sensed
        What it measures; kept up to date from outside.
    input_torque, input_velocity : float
        Commanded [N m, turn/s].

    """

    def __init__(self, settings: DriveSettings, names: Names, saved: Mapping[str, float]):
        """Boot."""
        self.settings, self.names, self.sensed = settings, names, Sensed()
        self.properties = {**names.properties(settings), **saved}
        self.input_torque = self.input_velocity = 0.0
        self._fed: Optional[float] = None
        self._connected = False  # the controller sees the velocity from the first arming on
        self._calibrated_at = math.inf
        if self.properties[names.calibration_kept]:
            self._calibrate()
        self._brake_armed = bool(self.properties[names.brake_enabled])

    def save(self) -> dict[str, float]:
        """Return what is kept over a restart."""
        return {name: value for name, value in self.properties.items()
                if name.startswith('config.') or '.config.' in name}

    @property
    def armed(self) -> bool:
        """Return whether the motor is under power."""
        return self.properties['axis0.current_state'] == CLOSED_LOOP_CONTROL

    @property
    def velocity(self) -> float:
        """Return the velocity of the shaft [turn/s]."""
        return self.sensed.velocity / math.tau

    def effective_current_limit(self) -> float:
        """Return the current limit at this temperature [A]; motor.cpp, effective_current_lim."""
        limit = self.properties[self.names.current_limit]
        below = self.settings.highest_temperature - MARGIN - self.sensed.temperature
        return limit * min(max(below / DERATING, 0.0), 1.0)

    def torque(self) -> float:
        """Return the torque at the shaft [N m]; controller.cpp, update."""
        here, names = self.properties, self.names
        mode = here[CONFIG + 'control_mode']
        if not self.armed or mode not in (TORQUE_CONTROL, VELOCITY_CONTROL):
            return 0.0
        most = self.effective_current_limit() * here[names.torque_constant]
        highest = min(here[names.torque_max], most)
        lowest = max(here[names.torque_min] if names.torque_min else -highest, -most)
        torque = min(max(self.input_torque, lowest), highest)
        gain, limit = here[CONFIG + 'vel_gain'], here[CONFIG + 'vel_limit']
        if mode == VELOCITY_CONTROL:
            wanted = self.input_velocity
            if here[CONFIG + 'enable_vel_limit']:
                wanted = min(max(wanted, -limit), limit)
            torque += gain * (wanted - self.velocity)
        elif here[CONFIG + 'enable_torque_mode_vel_limit']:
            torque = min(max(torque, gain * (-limit - self.velocity)),
                         gain * (limit - self.velocity))
        return min(max(torque, lowest), highest)

    def bus_current(self) -> float:
        """Return the current from the supply, before a brake resistor takes its part [A]."""
        torque = self.torque()
        current = torque / self.settings.torque_constant
        power = torque * self.sensed.velocity + self.settings.resistance * current**2
        return power / self.sensed.bus_voltage if self.sensed.bus_voltage else 0.0

    def supply_current(self) -> float:
        """Return the current from the supply [A]; low_level.cpp, update_brake_current."""
        here, current = self.properties, self.bus_current()
        if here[self.names.brake_enabled] and self._brake_armed:
            braked = max(-current - here['config.max_regen_current'], 0.0)
            most = 0.95 * self.sensed.bus_voltage / here[self.names.brake_resistance]
            current += min(braked, most)
        return current

    def feed(self, now: float) -> None:
        """Feed the watchdog."""
        self._fed = now

    def tick(self, now: float) -> None:
        """Look after watchdog, limits and states."""
        here = self.properties
        if self._fed is None:
            self._fed = now
        if here['axis0.config.enable_watchdog'] \
                and now - self._fed > here['axis0.config.watchdog_timeout']:
            self.trip('watchdog')
        if self.sensed.temperature >= self.settings.highest_temperature:
            self.trip('too_hot')
        if self._connected and here[CONFIG + 'enable_overspeed_error'] \
                and abs(self.velocity) > here[CONFIG + 'vel_limit_tolerance'] \
                * here[CONFIG + 'vel_limit']:
            self.trip('overspeed')
        if here[self.names.brake_enabled] and not here[self.names.brake_resistance] > 0.0:
            self.trip('brake_resistance')
        elif self.armed and self.supply_current() < here['config.dc_max_negative_current']:
            self._brake_armed = False
            self.trip('regeneration')
        self._change_state(now)

    def _change_state(self, now: float) -> None:
        """Go into the state that was requested; axis.cpp, run_state_machine_loop."""
        here, names = self.properties, self.names
        wanted = here['axis0.requested_state']
        if wanted:
            here['axis0.requested_state'] = 0
            if wanted == CLOSED_LOOP_CONTROL and names.ready(here):
                self._fed, self._connected = now, True
                self.input_torque = here.get('axis0.config.init_torque', self.input_torque)
                if here[names.brake_enabled] and not self._brake_armed:
                    self.trip('brake_resistor_disarmed')
                    wanted = IDLE
            elif wanted == CALIBRATION:
                self._calibrated_at = now + CALIBRATION_TIME
            elif wanted != IDLE:
                names.refuse(here, wanted)
                wanted = IDLE
            here['axis0.current_state'] = wanted
        if here['axis0.current_state'] == CALIBRATION and now >= self._calibrated_at:
            self._calibrate()
            here['axis0.current_state'] = IDLE
        if here[names.errors]:
            here['axis0.current_state'] = IDLE

    def _calibrate(self) -> None:
        self.properties.update({name: done for name, (_, done) in self.names.calibrated.items()})

    def trip(self, cause: str) -> None:
        """Set the bits of an error, and take the power off the motor."""
        if cause == 'overspeed' and '0.5.4' in self.settings.quirks:
            cause = 'overspeed_0.5.4'
        for register, bits in self.names.trips[cause].items():
            if self.armed or register != 'axis0.disarm_reason':
                self.properties[register] = int(self.properties[register]) | bits
        self.properties['axis0.current_state'] = IDLE

    def clear_errors(self) -> None:
        """Clear all errors, and arm the brake resistor; main.cpp, clear_errors."""
        if 'no_sc' not in self.settings.quirks:
            self.properties.update(dict.fromkeys(self.names.cleared, 0))
            self._brake_armed = bool(self.properties[self.names.brake_enabled])


class BoardDevice(Device):
    """A device whose motor is that of a `Board`; the line that it is spoken to by is missing."""

    firmwares = tuple(NAMES)

    def _boot_board(self, saved: Mapping[str, float]) -> None:
        """Start the firmware that the settings name, with the properties that were saved."""
        self.names: Names = NAMES[self.settings.firmware or self.firmwares[0]]
        self.board = Board(self.settings, self.names, saved)

    @property
    def properties(self) -> dict[str, float]:
        """Return all properties but what is measured."""
        return self.board.properties

    @property
    def armed(self) -> bool:
        """Return whether the motor is under power."""
        return self.board.armed

    def torque(self) -> float:
        """Return the torque at the shaft; see `Device`."""
        self.board.sensed = self.sensed
        return self.board.torque()

    def tick(self, now: float) -> None:
        """Look after watchdog, limits and temperature; see `Device`."""
        self.board.sensed = self.sensed
        self.board.tick(now)

    def over_current(self) -> None:
        """Trip; see `Device`."""
        self.board.trip('too_much_current')
