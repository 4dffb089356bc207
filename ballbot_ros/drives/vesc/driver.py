# SPDX-License-Identifier: Apache-2.0
"""VESC by its serial protocol: current mode, the torque follows from the torque constant."""
from dataclasses import dataclass
import math
from typing import Optional

from ballbot_ros.config.fields import count, flag, quantity
from ballbot_ros.drives.contract import DriveOptions, Identity, Setting
from ballbot_ros.drives.driver import Driver
from ballbot_ros.drives.vesc import codec
from ballbot_ros.drives.wire import WireBudget
from ballbot_ros.errors import DriveError

# Whose settings begin as `codec` reads them, and which send single values.
FIRMWARE = range(5, 8)
# A motor current below this part of the limit counts as none: the sensors are not that good.
NO_CURRENT = 0.05


@dataclass(frozen=True)
class VescOptions(DriveOptions):
    """The options of a VESC driver."""

    torque_constant: float = quantity(
        'N m/A', 'motor torque per ampere; of a brushless motor 1.5 pole pairs x flux linkage',
        default=0.025, above=0.0)
    pole_pairs: int = count('of the motor', default=7, minimum=1)
    encoder: bool = flag('the motor has an encoder, whose angle is finer than the commutation',
                         default=True)


class Vesc(Driver):
    """
    See `Driver`.

    A VESC has no arming: it follows the next current that it is sent.  Before `arm`, and after a
    stop, this driver sends none.
    """

    options: VescOptions
    protocol, maker = 'vesc', 'VESC'
    Options = VescOptions
    baud_rates = (115200, 921600, 460800, 230400, 57600)

    def _begin(self) -> None:
        self._parser = codec.FrameParser()
        self._replies: dict[int, bytes] = {}  # message -> its last reply that is no value
        self._turns_apart: Optional[float] = None  # tachometer less encoder, at the first reply

    # What waits

    def identify(self, patience: float = 0.5) -> Identity:
        """Ask who is there; see `Driver`."""
        firmware = codec.parse_firmware(self._ask(
            codec.FW_VERSION, self.clock() + patience, handshake=True))
        if firmware is None or firmware.major not in FIRMWARE:
            raise DriveError('firmware', (
                f'{self.line.port}: VESC firmware must be {FIRMWARE[0]} to {FIRMWARE[-1]}, got '
                + (f'{firmware.major}.{firmware.minor}' if firmware else 'an unknown answer')))
        return Identity(self.protocol, firmware.hardware,
                        f'{firmware.major}.{firmware.minor:02}', firmware.serial_number)

    def read_settings(self, patience: float = 0.5) -> tuple[Setting, ...]:
        """Read back and judge; see `Driver`."""
        deadline = self.clock() + patience
        options = self.options
        timeout, brake = codec.parse_timeout(
            self._ask(codec.GET_APPCONF, deadline)) or (math.nan, math.nan)
        most, least = codec.parse_current_limits(
            self._ask(codec.GET_MCCONF, deadline)) or (math.nan, math.nan)
        # Of what is no number max may return either.
        ceiling = options.torque_constant * (
            max(most, -least) if most - least < math.inf else math.inf)
        return (
            Setting('torque limit', f'{ceiling:.4g} N m', f'at most {options.torque_limit:g} N m',
                    ceiling <= 1.01 * options.torque_limit,
                    'VESC Tool, Motor Settings, Current: Motor Current Max and Max Brake '
                    f'{options.torque_limit / options.torque_constant:.3g} A'),
            Setting('watchdog', f'{timeout:g} s' if timeout else 'off',
                    f'at most {options.watchdog:g} s',
                    0.0 < timeout <= 1.01 * options.watchdog,
                    'VESC Tool, App Settings, General: Timeout '
                    f'{1000.0 * options.watchdog:g} ms'),
            Setting('brake current on timeout', f'{brake:g} A', '0 A: coast', brake == 0.0,
                    'VESC Tool, App Settings, General: Timeout Brake Current 0'))

    def _arm(self, deadline: float) -> None:
        self._send(self._torque_message(0.0))
        begin = self.clock()
        while self.telemetry.status_time is None or self.telemetry.status_time < begin:
            self._send(self._torque_message(0.0) + self._requests())
            self._until(lambda: (self.telemetry.status_time or -math.inf) > begin,
                        self._soon(deadline))
            if self.clock() >= deadline:
                raise DriveError('not_armed', (
                    f'{self.line.port}: the VESC does not report its state'))
        if self.telemetry.faults:
            raise DriveError('not_armed', (
                f'{self.line.port}: the VESC names {", ".join(self.telemetry.faults)}; the '
                'terminal of VESC Tool shows more with: faults'))

    # What does not wait

    def feed(self) -> None:
        """Feed the watchdog; see `Driver`."""
        self._send(codec.ask(codec.ALIVE))

    def budget(self) -> WireBudget:
        """Return the bytes of a command, a request and its reply."""
        values = codec.frame(codec.pack_values(codec.Values(*(0,) * len(codec.FIELDS))))
        return WireBudget(len(codec.set_current(0.0)) + len(codec.get_values()), len(values))

    def _torque_message(self, torque: float) -> bytes:
        return codec.set_current(torque / self.options.torque_constant)

    def _stop_message(self) -> bytes:
        return self._torque_message(0.0) + self._requests()

    def _requests(self) -> bytes:
        self._outstanding.append((self.clock(), codec.GET_VALUES_SELECTIVE))
        return codec.get_values()

    def _ask(self, message: int, deadline: float, handshake: bool = False) -> bytes:
        """Ask until there is a reply and return it; see `_ask_until`."""
        self._replies.pop(message, None)
        self._ask_until(
            lambda: message in self._replies, lambda: codec.ask(message), deadline,
            '' if handshake else f'message {message}')
        return self._replies[message]

    # Replies

    def _take_reply(self, payload: bytes, now: float) -> None:
        values = codec.parse_values(payload)
        if values is not None:
            self._note(values, now)
        elif payload[0] in (codec.FW_VERSION, codec.GET_APPCONF, codec.GET_MCCONF):
            self._replies[payload[0]] = payload
        else:
            self.counts['unexpected'] += 1

    def _note(self, values: codec.Values, now: float) -> None:
        """Make telemetry of a reply; replies come in the order of the requests."""
        asked = self._answered(codec.GET_VALUES_SELECTIVE)
        limit = self.options.torque_limit / self.options.torque_constant
        if abs(values.current) <= NO_CURRENT * limit:
            self._off_asked_at = asked
        faults = codec.fault_names(values.fault)
        self.telemetry = self.telemetry._replace(
            time=now, position=self._position(values),
            velocity=values.erpm / self.options.pole_pairs * math.tau / 60.0,
            current=values.current, bus_voltage=values.bus_voltage,
            temperature=values.temperature, motor_temperature=values.motor_temperature,
            status_time=now, faults=faults,
            armed=self._armed and not faults and not values.status & codec.TIMED_OUT)

    def _position(self, values: codec.Values) -> float:
        """
        Return the angle of the shaft [rad].

        The tachometer goes on over full turns but has six steps per electrical turn only; the
        encoder is fine but starts again every turn.  The one says which turn of the other it is,
        however many replies were lost in between.
        """
        turns: float = values.tachometer / (6.0 * self.options.pole_pairs)
        if not self.options.encoder:
            return turns * math.tau
        part = values.angle_deg / 360.0
        if self._turns_apart is None:
            self._turns_apart = turns - part
        return (round(turns - self._turns_apart - part) + part) * math.tau
