# SPDX-License-Identifier: Apache-2.0
"""
What is known about the power of a motor, and what changes it: a table and pure functions.

Only `Event.ARMED` leads to power, and every way from there leads to a stop that is repeated until
the drive confirms it, or to a drive that is away and is stopped by its own watchdog.
"""
from enum import auto, Enum
from types import MappingProxyType
from typing import Mapping, NamedTuple, Optional, Tuple

from ballbot_ros.drives.contract import Telemetry

# Without a measurement for so long there is no torque [s].
SILENCE = 0.1
# Without a confirmed status of an armed drive for so long the e-stop engages [s].
STATUS_TIMEOUT = 0.2
# After so long without an answer the drive is looked for anew: it may have been switched off and
# on [s].
LOST = 0.3


class MotorState(Enum):
    """What is known about the power of the motor."""

    DISCONNECTED = auto()  # no drive answers
    DISARMED = auto()  # confirmed by the drive
    ARMED = auto()
    STOPPING = auto()  # the stop is repeated until it is confirmed


class Event(Enum):
    """What changes it; the values are the names under which it is counted."""

    FOUND = 'found'  # a drive answered the handshake and confirmed that its motor is stopped
    ARMED = 'armed'  # the drive confirmed that the motor is under power
    NOT_ARMED = 'not_armed'  # it was to be, and the drive did not confirm it
    WITHDRAWN = 'withdrawn'  # there is to be no power any more
    SILENT = 'silent'  # the drive did not answer under power; it may have been off and on
    UNCONFIRMED = 'unconfirmed'  # the drive answered, but did not report that it is armed
    DISARMED_BY_DRIVE = 'disarmed_by_drive'
    HAZARD = 'hazards'  # another sender commands the drive, or its settings have changed
    STOPPED = 'stopped'  # the drive confirmed the stop
    LOST = 'links_lost'  # the line failed, or the drive did not answer for long
    CLOSED = 'closed'

    @property
    def in_words(self) -> str:
        """Return what has happened, as people write it."""
        return self.value.replace('_', ' ').replace('links', 'drive')


class Transition(NamedTuple):
    """A row of the table."""

    to: MotorState
    fault: bool = False  # the e-stop engages, unless the robot may go on by itself


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
    """The state of the motor and since when; each event gives the next."""

    state: MotorState = MotorState.DISCONNECTED
    since: float = 0.0  # [s]

    def after(self, event: Event, now: float) -> 'Power':
        """Return the power after an event; raise `KeyError` for one that cannot happen here."""
        return Power(TRANSITIONS[self.state, event].to, now)

    def is_fault(self, event: Event) -> bool:
        """Return whether the e-stop is to engage with an event."""
        return TRANSITIONS[self.state, event].fault

    def observe(self, telemetry: Telemetry, silence: float, status_age: float
                ) -> Optional[Tuple[Event, str]]:
        """
        Return what a drive that answers has done by itself, and in words; None for nothing.

        Parameters
        ----------
        telemetry : Telemetry
        silence : float
            How long it has owed an answer [s].
        status_age : float
            Time in which its status could have been confirmed and was not [s].

        """
        if self.state is not MotorState.ARMED:
            return None
        if silence > SILENCE:
            return Event.SILENT, f'the drive fell silent for {SILENCE:g} s'
        if status_age > STATUS_TIMEOUT:
            return Event.UNCONFIRMED, (
                f'the drive has not reported for {STATUS_TIMEOUT:g} s whether it is armed, or its '
                f'measurements are older than {SILENCE:g} s')
        if telemetry.hazards:
            return Event.HAZARD, ', '.join(telemetry.hazards)
        is_new = telemetry.status_time is not None and telemetry.status_time > self.since
        if is_new and (telemetry.faults or telemetry.armed is False):
            return Event.DISARMED_BY_DRIVE, 'the drive disarmed the motor: ' + (
                ', '.join(telemetry.faults) or 'no reason given')
        return None
