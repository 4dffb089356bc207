# SPDX-License-Identifier: Apache-2.0
"""The base class of every driver, which keeps the contract; see contract.py."""
from abc import ABC, abstractmethod
from collections import Counter
import math
import time
from typing import Any, Callable, ClassVar, Type

from ballbot_ros.drives.contract import (
    DriveOptions, Identity, SerialLine, Setting, StreamParser, Telemetry, WireBudget)
from ballbot_ros.drives.pending_requests import Match, PendingRequests
from ballbot_ros.errors import DriveError, MessageError

STOP_PERIOD = 0.02  # after which a stop that is not confirmed is repeated [s]


class Driver(ABC):
    """
    A motor controller behind a line.

    Parameters
    ----------
    line : SerialLine
        A `Link` or a `Replay`.
    options : DriveOptions
        Of the class `Options` of this driver.
    clock : callable
        Gives seconds and never goes back.

    Attributes
    ----------
    telemetry : Telemetry
        The newest.
    counts : Counter
        ``sent`` (writes), ``bytes`` (received), ``replies``, ``lost`` (asked and not answered
        in time), ``unexpected`` (not asked for), ``refused`` (checksum or form is wrong),
        ``skipped`` (bytes that belong to no message), as far as a protocol shows them.

    """

    protocol: ClassVar[str]
    maker: ClassVar[str]  # as error messages name it
    Options: ClassVar[Type[DriveOptions]] = DriveOptions
    baud_rates: ClassVar[tuple[int, ...]] = (115200,)  # to try, the maker's default first
    shortest_answer: ClassVar[int] = 1  # to `ask`; a loop is not woken for fewer bytes
    keeping: ClassVar[str] = ''  # what a person types to keep settings over a restart
    replies_are_named: ClassVar[bool] = False  # each names the request that it answers
    closes_torque_loop: ClassVar[bool] = True  # by measuring current; else by a computed voltage

    _parser: StreamParser

    def __init__(self, line: SerialLine, options: DriveOptions,
                 clock: Callable[[], float] = time.monotonic):
        self.line = line
        self.options = options
        self.clock = clock
        self.telemetry = Telemetry()
        self.counts: Counter[str] = Counter(lost=0)
        self._armed = False  # by us, and not stopped since
        self._off_asked_at = -math.inf  # of the last request whose reply showed no power [s]
        self._pending = PendingRequests(options.reply_timeout, self.replies_are_named)
        self._begin()

    # What waits

    @abstractmethod
    def identify(self, patience: float = 0.5) -> Identity:
        """
        Do the handshake and return who answered.

        Raises
        ------
        DriveError
            ``silent``, ``garbled`` or ``wrong_protocol`` if no such drive answers,
            ``firmware`` if it is one that commands would mean something else to.

        """

    @abstractmethod
    def read_settings(self, patience: float = 0.5) -> tuple[Setting, ...]:
        """
        Read back every setting that safety rests on, and judge it.

        Raises
        ------
        DriveError
            ``silent`` if the drive does not reply.

        """

    def arm(self, patience: float = 0.5) -> None:
        """
        Put the motor under power at zero torque.

        Raises
        ------
        DriveError
            ``not_armed``, with the faults that the drive names.

        """
        self._until(lambda: not self._pending or self._pending.may_send(self.clock()),
                    self.clock() + patience)
        self.telemetry = self.telemetry._replace(hazards=())
        self._arm(self.clock() + patience)
        self._armed = True

    def stop(self, patience: float = 0.5) -> None:
        """
        Take the power off the motor; repeat it until the drive confirms.

        Raises
        ------
        DriveError
            ``not_stopped`` if it does not within `patience`: the drive's own watchdog must
            then do it.

        """
        begin = self.clock()
        while True:
            self.send_stop()
            soon = self.clock() + STOP_PERIOD
            if self._until(lambda: self.stopped_since(begin), soon):
                return
            if self.clock() >= begin + patience:
                raise DriveError('not_stopped', (
                    f'{self.line.port}: the drive did not confirm the stop within {patience:g} s; '
                    f'its own watchdog disarms it after {self.options.watchdog:g} s'))

    def clear_faults(self, patience: float = 0.5) -> tuple[str, ...]:
        """Clear what latched, without power, and return what is still named; may refuse."""
        raise DriveError('not_clearable', f'a {self.maker} clears no faults on request')

    # What does not wait

    def send_torque(self, torque: float, ask: bool = True) -> None:
        """
        Send a torque; feeds the watchdog.

        Parameters
        ----------
        torque : float
            At the motor shaft [N m]; cut to the torque limit.
        ask : bool
            Send the requests of this period, too, in the same write.

        Raises
        ------
        MessageError
            If it is not finite.  Nothing is sent.
        DriveError
            ``not_armed`` before `arm` and after a stop.  Nothing is sent.

        """
        if not self._armed:
            raise DriveError('not_armed', f'{self.line.port}: the motor has not been armed')
        if not math.isfinite(torque):
            raise MessageError('not_finite', f'torque must be finite, got {torque!r}')
        limit = self.options.torque_limit
        self._send(self._torque_message(min(max(torque, -limit), limit))
                   + (self._requests() if ask else b''))

    def ask(self) -> None:
        """Send the requests of this period only; this keeps no torque alive."""
        if self._armed or self._pending.may_send(self.clock()):
            self._send(self._requests())

    @abstractmethod
    def feed(self) -> None:
        """Feed the watchdog of the drive and leave its torque as it is."""

    def send_stop(self) -> None:
        """Write zero torque, power off, and the requests whose answers confirm it."""
        self._armed = False
        self._send(self._stop_message())

    def stopped_since(self, time: float) -> bool:
        """Return whether the drive, asked after `time`, confirmed that the motor has no power."""
        return self._off_asked_at >= time

    def poll(self) -> Telemetry:
        """Read what has arrived and return the newest telemetry."""
        self._take(self.line.read(), self.clock())
        return self.telemetry

    @abstractmethod
    def budget(self) -> WireBudget:
        """Return what one period of `send_torque` and its replies put on the line at most."""

    # For drivers

    def _until(self, condition: Callable[[], bool], deadline: float) -> bool:
        """Poll until a condition holds or the deadline has come; return whether it holds."""
        while True:
            self.poll()
            if condition():
                return True
            left = deadline - self.clock()
            if left <= 0.0:
                return False
            self.line.wait(left)

    def _soon(self, deadline: float) -> float:
        """Return when a reply to what is asked now is overdue, at most a deadline."""
        patience: float = self.options.reply_timeout
        return min(deadline, self.clock() + patience)

    def _ask_until(self, answered: Callable[[], bool], request: Callable[[], bytes],
                   deadline: float, what: str = '') -> None:
        """
        Ask again and again until there is an answer.

        Parameters
        ----------
        answered : callable
            Returns whether there is one.
        request : callable
            Returns the bytes to send.
        deadline : float
            [s]
        what : str
            What does not answer, for the error; empty in a handshake.

        Raises
        ------
        DriveError
            ``silent``; in a handshake that of `_handshake_error`.

        """
        before = self.counts.copy()
        while not answered():
            self._send(request())
            if not self._until(answered, self._soon(deadline)) and self.clock() >= deadline:
                raise DriveError('silent', (
                    f'{self.line.port}: the {self.maker} does not answer {what}')
                ) if what else self._handshake_error(before)

    def _handshake_error(self, before: Counter[str]) -> DriveError:
        """Return why a handshake failed; `before` are the counts from its beginning."""
        received = self.counts['bytes'] - before['bytes']
        if not received:
            return DriveError('silent', (
                f'{self.line.port}: no {self.maker} answers; is it powered, are RX and TX '
                'crossed, is its serial port set to this protocol?'))
        return DriveError('garbled', (
            f'{self.line.port}: {received} bytes came that no {self.maker} would send: wrong baud '
            'rate, another protocol, or noise'))

    @abstractmethod
    def _begin(self) -> None:
        """Make the parser, and what else this driver keeps; the end of `__init__`."""

    @abstractmethod
    def _arm(self, deadline: float) -> None:
        """See `arm`."""

    @abstractmethod
    def _stop_message(self) -> bytes:
        """Return the bytes of `send_stop`."""

    def _send(self, data: bytes) -> None:
        if data:
            before = self.clock()
            self.line.write(data)
            self._pending.written(before, self.clock())
            self.counts['sent'] += 1

    @abstractmethod
    def _torque_message(self, torque: float) -> bytes:
        """Return the bytes that command a torque [N m]."""

    @abstractmethod
    def _requests(self) -> bytes:
        """Return the bytes that ask for the telemetry of this period."""

    @abstractmethod
    def _take_reply(self, reply: Any, now: float) -> None:
        """Update telemetry and counts from a reply that the parser found."""

    def _take(self, data: bytes, now: float) -> None:
        """Update telemetry and counts from received bytes; `data` may be empty."""
        if data:
            self.counts['bytes'] += len(data)
            for reply in self._parser.feed(data):
                self.counts['replies'] += 1
                self._take_reply(reply, now)
            dict.update(self.counts, self._parser.counts)
        self.counts['lost'] += self._pending.take_lost(now)

    def _add_hazard(self, text: str) -> None:
        """Report why an armed motor must be stopped; each reason once."""
        if self._armed and text not in self.telemetry.hazards:
            self.telemetry = self.telemetry._replace(
                hazards=(*self.telemetry.hazards, text))

    def _match(self, kind: object, now: float) -> Match:
        """Return the request that a reply answers; see `PendingRequests`."""
        match = self._pending.match(kind, now)
        self.counts['unexpected'] += match.sent == -math.inf
        return match
