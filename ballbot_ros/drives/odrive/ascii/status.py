# SPDX-License-Identifier: Apache-2.0
"""Status of an ODrive, collected property by property, and the next property to request."""
import math
from typing import Any, Mapping, Optional

from ballbot_ros.drives.contract import Telemetry
from ballbot_ros.drives.odrive.ascii import codec
from ballbot_ros.drives.odrive.firmware import (
    CLOSED_LOOP_CONTROL, EFFECTIVE_CURRENT, Generation, IDLE, SATURATED, STATE)

# A loss of power is reported after this time though registers were not answered [s].
REGISTER_TIMEOUT = 0.1
# Results that do not explain a loss of power: success, still under way, disarmed.
NO_REASON = (0, 1, 3)


class DriveStatus:
    """
    Collects the values of properties, and reports them as telemetry.

    After an error, or a loss of motor power, all registers are read before anything is reported:
    the controller error alone does not give the cause, and a state read before the errors would be
    reported without a reason.

    Parameters
    ----------
    generation : Generation
    torque_limit : float
        Torque that the current must suffice for [N m].

    Attributes
    ----------
    values : dict
        The last value of each property.

    """

    def __init__(self, generation: Generation, torque_limit: float):
        self.generation = generation
        self.values: dict[str, float] = {}
        self._torque_limit = torque_limit
        self._turn = self._round = 0
        self._open: list[str] = []  # still to be read before a loss of power is reported
        self._opened_at = -math.inf
        self._about: Optional[tuple[float, int]] = None  # the cause that they were read for

    @property
    def urgent(self) -> bool:
        """Return whether the next request must not wait for its turn."""
        return bool(self._open)

    @property
    def errors(self) -> int:
        """Return the error bits that prevent motor power."""
        return int(self.values.get(self.generation.errors, 0.0))

    def next_name(self, now: float) -> str:
        """Return the property to request at a time [s]."""
        if self._open and now - self._opened_at > REGISTER_TIMEOUT:
            self._open, self._about = [], self._cause  # it is reported without them
        if self._open:
            return self._open[0]
        names = self.generation.polled + (
            tuple(item.path for item in self.generation.details) if self.errors else ())
        self._turn += 1
        if self._turn >= len(names):  # one of the settings after each round of telemetry
            settings = self.generation.safety_settings
            self._turn, self._round = -1, (self._round + 1) % len(settings)
            return settings[self._round]
        return names[self._turn]

    def forget_details(self) -> None:
        """Forget the registers of the parts."""
        for register in self.generation.details:
            self.values.pop(register.path, None)
        self._open, self._about = [], None

    def forget_errors(self) -> None:
        """Drop all errors after they have been cleared."""
        self.forget_details()
        self.values.pop(self.generation.errors, None)
        self.values.pop(self.generation.reason, None)

    def take(self, name: str, value: Optional[float], now: float, ours: bool) -> None:
        """
        Take the value of a property, None for no number.

        Parameters
        ----------
        name : str
        value : float, optional
        now : float
            [s]
        ours : bool
            Whether this driver has armed the motor and not stopped it since.

        """
        if value is not None and math.isfinite(value):
            self.values[name] = value
        if not self.errors and not (ours and self.values.get(STATE) == IDLE):
            self.forget_details()
        elif name in self._open:
            self._open.remove(name)
            if not self._open:
                self._about = self._cause
        elif not self._open and self._about != self._cause:
            self._open = [item for item in self.generation.inquest if item != name]
            self._opened_at = now

    @property
    def _cause(self) -> tuple[float, int]:
        """Return the cause that the registers of the parts detail."""
        return self.values.get(STATE, math.nan), self.errors

    def report(self, telemetry: Telemetry, name: str, now: float, ours: bool) -> Telemetry:
        """Return telemetry with the last property taken."""
        generation, values = self.generation, self.values
        if name in generation.telemetry and name in values:
            reported: dict[str, Any] = {generation.telemetry[name]: values[name]}
            telemetry = telemetry._replace(**reported)
        if name in generation.warnings:
            telemetry = telemetry._replace(warnings=self._warnings())
        if name not in generation.inquest or STATE not in values or self._open:
            return telemetry
        return telemetry._replace(
            status_time=now, armed=values[STATE] == CLOSED_LOOP_CONTROL,
            faults=self.faults(values, ours))

    def faults(self, values: Mapping[str, float], ours: bool) -> tuple[str, ...]:
        """
        Return the names of all faults, from the values of properties.

        A watchdog that expires without power is not a fault.
        """
        generation = self.generation
        armed = values.get(STATE) == CLOSED_LOOP_CONTROL
        bits = _number(values, generation.errors)
        if not (ours or armed):
            bits &= ~generation.watchdog_expired
        # The reason of an earlier loss of power is not a fault of an armed motor.
        reason = 0 if armed else _number(values, generation.reason)
        names = generation.names_of(bits | reason)
        for register in generation.details:
            value = _number(values, register.path)
            if not (register.counts and value in NO_REASON):
                names += register.names_of(value)
        return names

    def _warnings(self) -> tuple[str, ...]:
        """Return the warnings of limits that are near."""
        generation, values = self.generation, self.values
        current = values.get(EFFECTIVE_CURRENT, math.inf)
        constant = values.get(generation.torque_constant, math.inf)
        names: tuple[str, ...] = ()
        if current * constant < 0.99 * self._torque_limit:
            names = (f'effective_current_lim {current:.3g} A',)
        if values.get(SATURATED, 0.0) == 1.0:
            names += (SATURATED,)
        return names


def _number(values: Mapping[str, float], name: str) -> int:
    """Return the bits of a register, none where it is not known."""
    value = values.get(name, 0.0)
    return int(value) if math.isfinite(value) else 0


MARKER = 'marker'


class Properties:
    """
    Requests one property at a time, and matches the values to the requests.

    After an overdue or an unrequested value it is out of sync: it sends a numbered marker, and
    accepts no value until the reply to the marker.

    Parameters
    ----------
    timeout : float
        After which an answer counts as lost [s].

    Attributes
    ----------
    asked : str or None
        Property whose value is pending.
    asked_at : float
        Time of the last request [s].
    value : float or None
        The last reply; None for text that is not a number, such as "invalid property".
    marker : int
        Number of the last marker.

    """

    def __init__(self, timeout: float):
        self.asked: Optional[str] = None
        self.asked_at = -math.inf
        self.value: Optional[float] = None
        self._timeout = timeout
        self.marker = codec.MARKERS[0]
        self._marked_at: Optional[float] = None  # None: in sync

    @property
    def in_sync(self) -> bool:
        """Return whether the next value is the reply to the pending request."""
        return self._marked_at is None

    @property
    def free(self) -> bool:
        """Return whether a property can be requested now."""
        return self.in_sync and self.asked is None

    def lose_sync(self) -> None:
        """Accept no value until a marker, still to be sent, has been answered."""
        self.asked = None
        self._marked_at = -math.inf

    def ask(self, name: str, path: str, now: float) -> bytes:
        """
        Return the request for a property, a marker where one is needed, or nothing yet.

        Parameters
        ----------
        name, path : str
            Name of the property in this package and in the drive.
        now : float
            [s]

        """
        if self.free:
            self.asked, self.asked_at = name, now
            return codec.read(path)
        if self._marked_at is not None and now - self._marked_at > self._timeout:
            following = self.marker + 1
            self.marker = following if following in codec.MARKERS else codec.MARKERS[0]
            self._marked_at = now
            return codec.marker(self.marker)
        return b''

    def take(self, text: str) -> Optional[str]:
        """
        Take a reply; return the property that it answers, `MARKER`, or None if it answers none.

        Text that answers a request means that there is no such property.
        """
        value = codec.parse_number(text)
        if not self.in_sync and value == self.marker:
            self._marked_at = None
            return MARKER
        if self.free or not self.in_sync:
            if value is not None and self.in_sync:
                self.lose_sync()
            return None
        name, self.asked, self.value = self.asked, None, value
        return name

    def overdue(self, now: float) -> bool:
        """Return whether a reply is overdue; then it is out of sync."""
        if self.asked is None or now - self.asked_at <= self._timeout:
            return False
        self.lose_sync()
        return True
