# SPDX-License-Identifier: Apache-2.0
"""
State machine of the motor power: a transition table and pure functions.

Only `Event.ARMED` enables power, and every transition from `ARMED` leads to a stop, repeated
until the drive confirms it, or to a disconnected drive that its own watchdog stops.
"""
from enum import auto, Enum
from types import MappingProxyType
from typing import Mapping, NamedTuple, Optional, Tuple, Union

from ballbot_ros.bridge.supervisor import EStop, StopReason
from ballbot_ros.drives.contract import Telemetry

# Largest age of a measurement that permits torque [s].
MEASUREMENT_AGE_MAX = 0.1
# Timeout of the confirmed status of an armed drive, after which the e-stop engages [s].
STATUS_TIMEOUT = 0.2
# Timeout of a reply, after which the bridge reconnects [s]: the drive may have lost power.
RECONNECT_TIMEOUT = 0.3


class MotorState(Enum):
    """State of the motor power."""

    DISCONNECTED = auto()  # no connected drive
    DISARMED = auto()  # confirmed by the drive
    ARMED = auto()
    STOPPING = auto()  # the stop is repeated until it is confirmed


class Event(Enum):
    """Events of the motor besides its faults; the values are the names of their counters."""

    FOUND = 'found'  # handshake complete, motor confirmed stopped
    ARMED = 'armed'  # the drive confirmed that the motor has power
    WITHDRAWN = 'withdrawn'  # power is no longer requested
    STOPPED = 'stopped'  # the drive confirmed the stop
    CLOSED = 'closed'


# A fault engages the e-stop, unless the bridge may rearm by itself.  Other transitions are errors.
TRANSITIONS: Mapping[Tuple[MotorState, Union[Event, StopReason]], MotorState] = MappingProxyType({
    (MotorState.DISCONNECTED, Event.FOUND): MotorState.DISARMED,
    (MotorState.DISCONNECTED, Event.CLOSED): MotorState.DISCONNECTED,
    (MotorState.DISARMED, Event.ARMED): MotorState.ARMED,
    (MotorState.DISARMED, StopReason.NOT_ARMED): MotorState.STOPPING,
    (MotorState.DISARMED, StopReason.LOST): MotorState.DISCONNECTED,
    (MotorState.DISARMED, Event.CLOSED): MotorState.DISCONNECTED,
    (MotorState.ARMED, Event.WITHDRAWN): MotorState.STOPPING,
    (MotorState.ARMED, StopReason.SILENT): MotorState.STOPPING,
    (MotorState.ARMED, StopReason.UNCONFIRMED): MotorState.STOPPING,
    (MotorState.ARMED, StopReason.DISARMED_BY_DRIVE): MotorState.STOPPING,
    (MotorState.ARMED, StopReason.HAZARD): MotorState.STOPPING,
    (MotorState.ARMED, StopReason.HELD_UP): MotorState.STOPPING,
    (MotorState.ARMED, StopReason.LOST): MotorState.DISCONNECTED,
    (MotorState.STOPPING, Event.STOPPED): MotorState.DISARMED,
    (MotorState.STOPPING, StopReason.LOST): MotorState.DISCONNECTED,
    (MotorState.STOPPING, Event.CLOSED): MotorState.DISCONNECTED,
})


class Power(NamedTuple):
    """The state of the motor and its start time; each event returns the next."""

    state: MotorState = MotorState.DISCONNECTED
    since: float = 0.0  # [s]

    def after(self, event: Union[Event, StopReason], now: float) -> 'Power':
        """Return the state after an event; raise `KeyError` for one that the table lacks."""
        return Power(TRANSITIONS[self.state, event], now)

    def observe(self, telemetry: Telemetry, silence: float, status_age: float
                ) -> Optional[EStop]:
        """
        Return the fault of an armed drive, or None.

        `silence` is the time since the first unanswered request, `status_age` the time
        without a confirmed status [s].
        """
        if self.state is not MotorState.ARMED:
            return None
        if silence > MEASUREMENT_AGE_MAX:
            return EStop(
                StopReason.SILENT, f'no reply from the drive for {MEASUREMENT_AGE_MAX:g} s')
        if status_age > STATUS_TIMEOUT:
            return EStop(
                StopReason.UNCONFIRMED, 'the drive has not reported its armed state for '
                f'{STATUS_TIMEOUT:g} s, or its measurements are older than '
                f'{MEASUREMENT_AGE_MAX:g} s: replies are late or lost')
        if telemetry.hazards:
            settings, texts = zip(*telemetry.hazards)
            return EStop(StopReason.HAZARD, ', '.join(texts), settings)
        is_new = telemetry.status_time is not None and telemetry.status_time > self.since
        if is_new and (telemetry.faults or telemetry.armed is False):
            return EStop(
                StopReason.DISARMED_BY_DRIVE, 'the drive disarmed the motor: '
                + (', '.join(telemetry.faults) or 'no reason given'), telemetry.faults)
        return None
