# SPDX-License-Identifier: Apache-2.0
"""
Motor control of the ODrive firmware, for all of its protocols.

0.5 follows MotorControl/axis.cpp (states, watchdog), controller.cpp (torque and velocity mode,
velocity limits, overspeed), motor.cpp (limits) and low_level.cpp (supply, brake resistor) of
odriverobotics/ODrive at fw-v0.5.6.  The source of 0.6 is not published; it is assumed to be as in
0.5, except where that would be easier for the driver: there the harder case is assumed.

Currents have no delay; the supply provides the power at the shaft and of the winding losses.
"""
from dataclasses import dataclass
import math
from typing import Mapping, Optional

from ballbot_ros.drives.emulated_device import Device, DriveSettings, Quirk
from ballbot_ros.drives.odrive.firmware import (
    AXIS_5, BACK_ALLOWED, BRAKE_DUTY_MAX, CLOSED_LOOP_CONTROL, CONTROL_MODE, CONTROLLER_5,
    ENCODER_5, FACTORY_VELOCITY_TOLERANCE, Generation, GENERATION_5, GENERATION_6, HARDWARE, IDLE,
    INPUT_MODE, LIMITS_TORQUE_MODE, MAX_BACK, MOTOR_5, OVERSPEED, PASSTHROUGH, REQUESTED_STATE,
    RESULT_6, SATURATED, SERIAL_NUMBER, STATE, SYSTEM_5, TORQUE_CONTROL, VELOCITY_GAIN,
    VELOCITY_LIMIT, VELOCITY_TOLERANCE, VERSION, WATCHDOG, WATCHDOG_TIMEOUT)

# Numbers of the results of a procedure by name.
RESULTS = {name: number for number, name in RESULT_6.names.items()}
POSITION_CONTROL = 3  # factory default of the control mode

QUIRKS = {
    '0.5.4': Quirk('0.5.4: a controller stop is reported as two motor errors, by a number '
                   'of ten digits, of which nine are sent', 'MotorControl/main.cpp, fw-v0.5.4'),
    'vel_limit': Quirk('factory defaults: velocity limit 2 turn/s (0.6: 10), also in torque mode; '
                       'overspeed error above 1.2 times that limit',
                       'MotorControl/controller.hpp, fw-v0.5.6; 0.6: changelog of 0.6.1'),
    'regeneration': Quirk('factory defaults: no brake resistor; more than 0.01 A into the supply '
                          'is an error', 'MotorControl/odrive_main.h, fw-v0.5.6; 0.6: guessed'),
    'factory': Quirk('all factory defaults: `vel_limit`, `regeneration`, no torque limit, 10 A, '
                     'watchdog off, not calibrated',
                     'MotorControl/{controller,motor,axis}.hpp, fw-v0.5.6; 0.6: guessed'),
}


@dataclass(frozen=True)
class BoardFirmware:
    """One generation of the firmware on a board."""

    generation: Generation  # with the names of its properties
    version: tuple[int, int, int]
    board: tuple[int, int, int]
    torque_command_sets_mode: bool
    trips: Mapping[str, Mapping[str, int]]  # cause -> bits of each register
    calibrated: Mapping[str, tuple[int, int]]  # property -> value before and after calibration
    calibration_kept: str  # property that saves the calibration
    velocity_limit: float  # factory default [turn/s]
    more: Mapping[str, float]  # further properties, with factory defaults
    read_only: tuple[str, ...]

    @property
    def registers(self) -> tuple[str, ...]:
        """Return the error registers, which `sc` clears."""
        return tuple(name for name in self.generation.fault_properties if name != STATE)

    def properties(self, settings: DriveSettings) -> dict[str, float]:
        """Return all properties except measurements, as after a first boot."""
        generation, fresh = self.generation, 'factory' in settings.quirks
        limit = math.inf if fresh else settings.torque_limit
        watchdog = 0.0 if fresh else settings.watchdog
        slow = fresh or 'vel_limit' in settings.quirks
        no_regeneration = fresh or 'regeneration' in settings.quirks
        return {
            **dict(zip(VERSION, self.version_of(settings))), **dict(zip(HARDWARE, self.board)),
            SERIAL_NUMBER: 0x208F3387304B, 'test_property': 0,
            **dict.fromkeys(self.registers, 0), STATE: IDLE, REQUESTED_STATE: 0,
            WATCHDOG: int(watchdog > 0.0), WATCHDOG_TIMEOUT: watchdog,
            CONTROL_MODE: POSITION_CONTROL, INPUT_MODE.name: PASSTHROUGH,
            VELOCITY_LIMIT: self.velocity_limit if slow else 200.0,
            VELOCITY_TOLERANCE: FACTORY_VELOCITY_TOLERANCE,
            'axis0.controller.config.enable_vel_limit': 1,
            LIMITS_TORQUE_MODE: 1, OVERSPEED: 1, VELOCITY_GAIN: 1.0 / 6.0,
            'axis0.controller.config.vel_integrator_gain': 2.0 / 6.0,
            MAX_BACK: -0.01 if no_regeneration else -10.0, BACK_ALLOWED: 0.0,
            generation.brake_enabled: 0, generation.brake_resistance: 2.0,
            **dict(zip(generation.torque_limits, (limit, -limit))),
            generation.current_limit: 10.0 if fresh else settings.current_limit,
            generation.torque_constant: 0.04 if fresh else settings.torque_constant, **self.more,
            **{name: values[not fresh] for name, values in self.calibrated.items()}}

    def version_of(self, settings: DriveSettings) -> tuple[int, int, int]:
        """Return the version, which a quirk may change."""
        return (0, 5, 4) if '0.5.4' in settings.quirks else self.version

    def ready(self, here: Mapping[str, float]) -> bool:
        """Return whether the encoder allows closed-loop control."""
        return here.get('axis0.encoder.is_ready', 1) == 1 \
            and here.get('axis0.commutation_mapper.status', 0) == 0

    def refuse(self, here: dict[str, float]) -> None:
        """Record that a requested state is not entered."""
        if RESULT_6.path in here:
            here[RESULT_6.path] = RESULTS[
                'INVALID_STATE' if self.ready(here) else 'NOT_CALIBRATED']
        else:
            here[self.generation.errors] = int(here[self.generation.errors]) | 0x1  # INVALID_STATE


FIXED = (*VERSION, *HARDWARE, SERIAL_NUMBER, STATE)
AXIS, MOTOR, SYSTEM = AXIS_5.path, MOTOR_5.path, SYSTEM_5.path
ACTIVE, REASON = GENERATION_6.errors, GENERATION_6.reason


def _both(bit: int) -> Mapping[str, int]:
    """Return the bits of an error of 0.6; as a reason it remains after the error has cleared."""
    return {ACTIVE: bit, REASON: bit}


FIRMWARES = {
    '0.5': BoardFirmware(
        GENERATION_5, version=(0, 5, 6), board=(3, 6, 56), torque_command_sets_mode=True,
        trips={
            'watchdog': {AXIS: 0x800}, 'too_hot': {AXIS: 0x40, MOTOR: 0x40000},
            'too_much_current': {AXIS: 0x40, MOTOR: 0x1000},
            'no_estimate': {AXIS: 0x100, ENCODER_5.path: 0x4},
            'overspeed': {AXIS: 0x200, CONTROLLER_5.path: 0x1},
            'overspeed_0.5.4': {AXIS: 0x40, MOTOR: 0x110000000, CONTROLLER_5.path: 0x1},
            'regeneration': {AXIS: 0x40, MOTOR: 0x1000000, SYSTEM: 0x8},
            'brake_resistance': {AXIS: 0x40, MOTOR: 0x1000000, SYSTEM: 0x80},
            'brake_resistor_disarmed': {MOTOR: 0x800000}},  # the axis has no error then
        calibrated={'axis0.encoder.is_ready': (0, 1)},
        calibration_kept='axis0.encoder.config.pre_calibrated', velocity_limit=2.0,
        more={'axis0.encoder.config.pre_calibrated': 0, 'axis0.motor.config.motor_type': 0,
              'brake_resistor_armed': 0, SATURATED: 0},
        read_only=(*FIXED, 'axis0.encoder.is_ready', 'brake_resistor_armed')),
    '0.6': BoardFirmware(
        GENERATION_6, version=(0, 6, 11), board=(5, 2, 0), torque_command_sets_mode=False,
        trips={
            'watchdog': _both(0x1000000), 'too_hot': _both(0x4000),
            'too_much_current': _both(0x1000), 'no_estimate': _both(0x8),
            'overspeed': _both(0x8000), 'regeneration': _both(0x800),
            'brake_resistance': _both(0x10), 'brake_resistor_disarmed': _both(0x8000000)},
        calibrated={'axis0.commutation_mapper.status': (6, 0),
                    'axis0.commutation_mapper.config.offset_valid': (0, 1)},
        calibration_kept='axis0.commutation_mapper.config.offset_valid', velocity_limit=10.0,
        more={'axis0.config.motor.motor_type': 0, 'axis0.config.init_torque': 0.0,
              'brake_resistor0.is_armed': 0, 'axis0.pos_vel_mapper.status': 9,
              'axis0.pos_vel_mapper.config.circular': 0},
        read_only=(*FIXED, ACTIVE, REASON, RESULT_6.path, 'axis0.pos_vel_mapper.status',
                   'axis0.commutation_mapper.status'))}


CALIBRATION = 3  # FULL_CALIBRATION_SEQUENCE
CALIBRATION_TIME = 2.0  # [s]
# Range below the temperature limit over which the current is reduced, and the margin between that
# limit and the trip temperature (thermistor.cpp) [K].
DERATING, MARGIN = 20.0, 5.0


class BoardDevice(Device):
    """
    Properties, states and errors of an ODrive, and its motor; subclasses add the protocol.

    `properties` has all except measurements; `input_torque` is the commanded torque [N m].
    """

    firmwares = tuple(FIRMWARES)
    quirks = QUIRKS
    _saved: Mapping[str, float] = {}  # properties, before a restart

    def _boot(self) -> None:
        self.firmware = firmware = FIRMWARES[self.settings.firmware or self.firmwares[0]]
        self.names = firmware.generation
        self.properties = {**firmware.properties(self.settings), **self._saved}
        self.input_torque = 0.0
        self._fed: Optional[float] = None
        self._connected = False  # the controller receives the velocity from the first arming on
        self._calibrated_at = math.inf
        if self.properties[firmware.calibration_kept]:
            self._calibrate()
        self._brake_armed = bool(self.properties[self.names.brake_enabled])

    @property
    def armed(self) -> bool:
        return self.properties[STATE] == CLOSED_LOOP_CONTROL

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
        """Return the torque at the shaft; controller.cpp, update; see `Device`."""
        here, names = self.properties, self.names
        if not self.armed or here[CONTROL_MODE] != TORQUE_CONTROL:
            return 0.0
        most = self.effective_current_limit() * here[names.torque_constant]
        upper, *lower = (here[name] for name in names.torque_limits)
        highest = min(upper, most)
        lowest = max(*lower or [-highest], -most)
        torque = min(max(self.input_torque, lowest), highest)
        gain, limit = here[VELOCITY_GAIN], here[VELOCITY_LIMIT]
        if here[LIMITS_TORQUE_MODE]:
            torque = min(max(torque, gain * (-limit - self.velocity)),
                         gain * (limit - self.velocity))
        return min(max(torque, lowest), highest)

    def supply_current(self) -> float:
        """Return the current from the supply [A]; low_level.cpp, update_brake_current."""
        here, voltage = self.properties, self.sensed.bus_voltage
        current = self.power() / voltage if voltage else 0.0
        if here[self.names.brake_enabled] and self._brake_armed:
            braked = max(-current - here[BACK_ALLOWED], 0.0)
            most = BRAKE_DUTY_MAX * voltage / here[self.names.brake_resistance]
            current += min(braked, most)
        return current

    def feed(self, now: float) -> None:
        self._fed = now

    def tick(self, now: float) -> None:
        here = self.properties
        if self._fed is None:
            self._fed = now
        if here[WATCHDOG] \
                and now - self._fed > here[WATCHDOG_TIMEOUT]:
            self.trip('watchdog')
        if self.sensed.temperature >= self.settings.highest_temperature:
            self.trip('too_hot')
        if self._connected and here[OVERSPEED] \
                and abs(self.velocity) > here[VELOCITY_TOLERANCE] \
                * here[VELOCITY_LIMIT]:
            self.trip('overspeed')
        if here[self.names.brake_enabled] and not here[self.names.brake_resistance] > 0.0:
            self._brake_armed = False
            self.trip('brake_resistance')
        elif self.armed and self.supply_current() < here[MAX_BACK]:
            self._brake_armed = False
            self.trip('regeneration')
        self._change_state(now)

    def _change_state(self, now: float) -> None:
        """Enter the requested state; axis.cpp, run_state_machine_loop."""
        here, names = self.properties, self.names
        wanted = here[REQUESTED_STATE]
        if wanted:
            here[REQUESTED_STATE] = 0
            if wanted == CLOSED_LOOP_CONTROL and self.firmware.ready(here):
                self._fed, self._connected = now, True
                self.input_torque = here.get('axis0.config.init_torque', self.input_torque)
                if here[names.brake_enabled] and not self._brake_armed:
                    self.trip('brake_resistor_disarmed')
                    wanted = IDLE
            elif wanted == CALIBRATION:
                self._calibrated_at = now + CALIBRATION_TIME
            elif wanted != IDLE:
                self.firmware.refuse(here)
                wanted = IDLE
            here[STATE] = wanted
        if here[STATE] == CALIBRATION and now >= self._calibrated_at:
            self._calibrate()
            here[STATE] = IDLE
        if here[names.errors]:
            here[STATE] = IDLE

    def _calibrate(self) -> None:
        self.properties.update(
            {name: done for name, (_, done) in self.firmware.calibrated.items()})

    def trip(self, cause: str) -> None:
        """Set the bits of an error, and disable motor power."""
        if cause == 'overspeed' and self.has('0.5.4'):
            cause = 'overspeed_0.5.4'
        for register, bits in self.firmware.trips[cause].items():
            if self.armed or register != REASON:
                self.properties[register] = int(self.properties[register]) | bits
        self.properties[STATE] = IDLE

    def clear_errors(self) -> None:
        """Clear all errors, and arm the brake resistor; main.cpp, clear_errors."""
        self.properties.update(dict.fromkeys(self.firmware.registers, 0))
        self._brake_armed = bool(self.properties[self.names.brake_enabled])

    def over_current(self) -> None:
        self.trip('too_much_current')
