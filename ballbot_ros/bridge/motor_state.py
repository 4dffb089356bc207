# SPDX-License-Identifier: Apache-2.0
"""
State machine of the motor power: a transition table and pure functions.

Only `Event.ARMED` enables power, and every transition from there leads to a stop that is repeated
until the drive confirms it, or to a disconnected drive that its own watchdog stops.
"""
from enum import auto, Enum
from types import MappingProxyType
from typing import Mapping, NamedTuple, Optional, Tuple

from ballbot_ros.bridge.supervisor import EStop, StopReason
from ballbot_ros.drives.contract import Telemetry

# Largest age of a measurement for torque [s].
MEASUREMENT_AGE_MAX = 0.1
# Timeout of the confirmed status of an armed drive, after which the e-stop engages [s].
STATUS_TIMEOUT = 0.2
# Timeout of a reply, after which the link reconnects [s]: the drive may have lost power.
RECONNECT_TIMEOUT = 0.3


class MotorState(Enum):
    """State of the motor power."""

    DISCONNECTED = auto()  # no connected drive
    DISARMED = auto()  # confirmed by the drive
    ARMED = auto()
    STOPPING = auto()  # the stop is repeated until it is confirmed


class Event(Enum):
    """Events of the state machine; the values are the names of their counters."""

    FOUND = 'found'  # handshake complete, motor confirmed stopped
    ARMED = 'armed'  # the drive confirmed that the motor has power
    NOT_ARMED = 'not_armed'  # the drive did not confirm a request to arm
    WITHDRAWN = 'withdrawn'  # power is no longer requested
    SILENT = 'silent'  # no reply while armed; the drive may have restarted
    UNCONFIRMED = 'unconfirmed'  # a reply without a confirmed armed status
    DISARMED_BY_DRIVE = 'disarmed_by_drive'
    HAZARD = 'hazards'  # another sender commands the drive, or its settings have changed
    STOPPED = 'stopped'  # the drive confirmed the stop
    LOST = 'links_lost'  # the link failed, or replies timed out
    CLOSED = 'closed'

    @property
    def in_words(self) -> str:
        """Return the event as text."""
        return self.value.replace('_', ' ').replace('links', 'drive')


class Transition(NamedTuple):
    """A row of the transition table."""

    to: MotorState
    fault: bool = False  # the e-stop engages, unless the bridge may rearm by itself


TRANSITIONS: Mapping[Tuple[MotorState, Event], Transition] = MappingProxyType({
    (MotorState.DISCONNECTED, Event.FOUND): Transition(MotorState.DISARMED),
    (MotorState.DISCONNECTED, Event.CLOSED): Transition(MotorState.DISCONNECTED),
    (MotorState.DISARMED, Event.ARMED): Transition(MotorState.ARMED),
    (MotorState.DISARMED, Event.NOT_ARMED): Transition(MotorState.STOPPING, fault=True),
    (MotorState.DISARMED, Event.LOST): Transition(MotorState.DISCONNECTED),
    (MotorState.DISARMED, Event.CLOSED): Transition(MotorState.DISCONNECTED),
    (MotorState.ARMED, Event.WITHDRAWN): Transition(MotorState.STOPPING),
    (MotorState.ARMED, Event.SILENT): Transition(MotorState.STOPPING, fault=True),
    (MotorState.ARMED, Event.UNCONFIRMED): Transition(MotorState.STOPPING, fault=True),
    (MotorState.ARMED, Event.DISARMED_BY_DRIVE): Transition(MotorState.STOPPING, fault=True),
    (MotorState.ARMED, Event.HAZARD): Transition(MotorState.STOPPING, fault=True),
    (MotorState.ARMED, Event.LOST): Transition(MotorState.DISCONNECTED, fault=True),
    (MotorState.STOPPING, Event.STOPPED): Transition(MotorState.DISARMED),
    (MotorState.STOPPING, Event.LOST): Transition(MotorState.DISCONNECTED, fault=True),
    (MotorState.STOPPING, Event.CLOSED): Transition(MotorState.DISCONNECTED),
})


class Power(NamedTuple):
    """The state of the motor and its start time; each event returns the next."""

    state: MotorState = MotorState.DISCONNECTED
    since: float = 0.0  # [s]

    def after(self, event: Event, now: float) -> 'Power':
        """Return the state after an event; raise `KeyError` for one that the table lacks."""
        return Power(TRANSITIONS[self.state, event].to, now)

    def is_fault(self, event: Event) -> bool:
        """Return whether an event engages the e-stop."""
        return TRANSITIONS[self.state, event].fault

    def observe(self, telemetry: Telemetry, silence: float, status_age: float
                ) -> Optional[EStop]:
        """
        Return the fault of an armed drive, or None; its reason is the value of an `Event`.

        Parameters
        ----------
        telemetry : Telemetry
        silence : float
            Time since the unanswered request [s].
        status_age : float
            Time without a confirmed status [s].

        """
        if self.state is not MotorState.ARMED:
            return None
        if silence > MEASUREMENT_AGE_MAX:
            return EStop(StopReason.SILENT, f'no reply of the drive for {MEASUREMENT_AGE_MAX:g} s')
        if status_age > STATUS_TIMEOUT:
            return EStop(
                StopReason.UNCONFIRMED, 'the drive has not reported its armed state for '
                f'{STATUS_TIMEOUT:g} s, or its measurements are older than '
                f'{MEASUREMENT_AGE_MAX:g} s')
        if telemetry.hazards:
            settings, texts = zip(*telemetry.hazards)
            return EStop(StopReason.HAZARD, ', '.join(texts), settings)
        is_new = telemetry.status_time is not None and telemetry.status_time > self.since
        if is_new and (telemetry.faults or telemetry.armed is False):
            return EStop(
                StopReason.DISARMED_BY_DRIVE, 'the drive disarmed the motor: '
                + (', '.join(telemetry.faults) or 'no reason given'), telemetry.faults)
        return None
