# SPDX-License-Identifier: Apache-2.0
"""
Base class of the drivers, which implements the contract; see contract.py.

`PendingRequests` matches replies to requests, so that a time stamp is never later than its
measurement.  A drive replies in the order of the requests; some replies are lost, and any may be
delayed.  So a reply answers the oldest pending request of its kind, and the replies to earlier
requests are lost.  After a loss, stamps are one request too old, never too new, until the reply to
a kind that was requested once since the loss shows which requests are complete.  Drivers send such
requests in turn, each at most once in `LONGEST_LATENCY`.  A longer interruption ends in a stop,
and without power requests are dropped: see `may_send`.

If a drive reads slowly, commands accumulate in the output buffer.  The drive would execute them
before a stop, and they would feed its watchdog, so no torque is sent while `LARGEST_NUMBER`
requests are pending.

If replies identify their request (VESC), each request is a separate kind.
"""
from abc import ABC, abstractmethod
from collections import Counter, deque
import math
from typing import Any, Callable, ClassVar, NamedTuple, Optional, Type, Union

from ballbot_ros.clock import steady_time
from ballbot_ros.drives.contract import (
    DriveOptions, Hazard, Identity, SerialLine, Setting, StreamParser, Telemetry, WireBudget)
from ballbot_ros.errors import DriveError, MessageError

# Largest number of pending requests under power.  A drive that keeps up leaves one or two; a lost
# reply counts until a later reply shows the loss.
LARGEST_NUMBER = 4
# Requests are dropped when no reply has arrived for this time: longer than the bridge waits
# before it stops the motor [s].
LONGEST_LATENCY = 0.11
# After a longer write the time at which its bytes were sent is unknown [s].
LONGEST_WRITE = 0.001


class PendingRequest(NamedTuple):
    """A request, with the earliest and the latest time at which its bytes were sent [s]."""

    kind: object
    sent: float
    written: float


class Match(NamedTuple):
    """The request that a reply answers."""

    # Earliest time at which it was sent [s]; minus infinity for an unrequested reply.
    sent: float = -math.inf
    # Time of the measurement in the reply, the same as `sent` [s]; None if it is unknown, or the
    # reply counts as lost.
    measured: Optional[float] = None


class PendingRequests:
    """
    The requests that have no reply yet, oldest first.

    A reply counts as lost after a timeout [s]; with `named` each request is a separate kind.
    """

    def __init__(self, timeout: float, named: bool = False):
        self._timeout, self._named = timeout, named
        self._replied = -math.inf  # when the last reply arrived [s]
        self._queue: deque[PendingRequest] = deque()
        self._unsent: list[object] = []
        self._overdue = 0  # requests at the front of the queue that are counted as lost
        self._lost = 0

    def __bool__(self) -> bool:
        return bool(self._queue or self._unsent)

    @property
    def kinds(self) -> set[Any]:
        """Return the kinds of the pending requests."""
        return {request.kind for request in self._queue}.union(self._unsent)

    @property
    def is_full(self) -> bool:
        """Return whether no torque may be sent until a reply arrives."""
        return len(self._queue) >= LARGEST_NUMBER

    def is_stalled(self, now: float) -> bool:
        """Return whether a reply is overdue, and nothing was sent for most of that time."""
        return self._overdue > 0 and now - self._queue[-1].written > 0.5 * self._timeout

    def may_send(self, now: float, armed: bool) -> bool:
        """
        Return whether further requests may be sent.

        Under power, none may be sent while too many are pending.  Without power, none may be sent
        while a reply is overdue, until all pending replies have arrived or the requests time out.
        """
        if armed:
            return len(self._queue) - self._overdue < LARGEST_NUMBER
        if self._named or not self._queue or now - self._queue[0].sent <= self._timeout:
            return True
        if now - max(self._queue[-1].written, self._replied) <= LONGEST_LATENCY:
            return False
        self.clear()
        return True

    def add(self, kind: object) -> None:
        """Add a request whose bytes are written next."""
        self._unsent.append(kind)

    def written(self, before: float, after: float) -> None:
        """Stamp the added requests with the start and the end of their write [s]."""
        self._queue.extend(PendingRequest(kind, before, after) for kind in self._unsent)
        self._unsent.clear()

    def clear(self) -> None:
        """Drop all requests."""
        self._drop(len(self._queue))
        self._unsent.clear()

    def match(self, kind: object, now: float) -> Match:
        """Match a reply of a kind, read at a time [s], and return the request that it answers."""
        for index, request in enumerate(self._queue):
            if request.kind == kind:
                self._drop(index)
                self._queue.popleft()
                self._overdue = max(0, self._overdue - 1)
                self._replied = now
                known = request.written - request.sent <= LONGEST_WRITE \
                    and now - request.sent <= self._timeout
                return Match(request.sent, request.sent if known else None)
        return Match()

    def take_lost(self, now: float) -> int:
        """Return the number of replies lost since the last call."""
        while self._overdue < len(self._queue) \
                and self._queue[self._overdue].sent < now - self._timeout:
            self._overdue += 1
            self._lost += 1
        while self._named and self._queue and self._queue[0].sent < now - LONGEST_LATENCY:
            self._drop(1)
        lost, self._lost = self._lost, 0
        return lost

    def _drop(self, number: int) -> None:
        """Remove requests at the front of the queue, and count each as lost once."""
        self._lost += max(0, number - self._overdue)
        self._overdue = max(0, self._overdue - number)
        for _ in range(number):
            self._queue.popleft()


STOP_PERIOD = 0.02  # after which an unconfirmed stop is repeated [s]
LONGEST_WAIT = 0.01  # between two calls of `Driver.meanwhile` [s]


class Driver(ABC):
    """
    A motor controller behind a line.

    Parameters
    ----------
    line : SerialLine
        An open `Link` or `CanLink`.
    options : DriveOptions
        An instance of `Options` of this driver.
    clock : callable
        Monotonic, in seconds.

    Attributes
    ----------
    telemetry : Telemetry
        The latest values.
    counts : Counter
        ``sent`` (writes), ``bytes`` (received), ``replies``, ``lost`` (requested, not received
        in time), ``unexpected`` (not requested), ``refused`` (checksum or form is wrong),
        ``skipped`` (bytes that belong to no message, or to another axis), where a protocol
        allows it.
    meanwhile : callable
        Called while this driver waits, for instance to feed the watchdog of another axis.

    """

    protocol: ClassVar[str]
    maker: ClassVar[str]  # as error messages name it
    Options: ClassVar[Type[DriveOptions]] = DriveOptions
    baud_rates: ClassVar[tuple[int, ...]] = (115200,)  # to try, the maker's default first
    shortest_answer: ClassVar[int] = 1  # of the reply to `ask` [bytes]; fewer do not wake a loop
    keeping: ClassVar[str] = ''  # command that saves settings permanently
    replies_are_named: ClassVar[bool] = False  # each identifies its request
    separator: ClassVar[bytes] = b''  # sent after a pause to end a packet of corrupted length
    closes_torque_loop: ClassVar[bool] = True  # with measured current; else open-loop voltage
    # Option that distinguishes two axes on one line; empty if replies do not identify the axis.
    shares_line: ClassVar[str] = ''

    _parser: StreamParser

    def __init__(self, line: SerialLine, options: DriveOptions,
                 clock: Callable[[], float] = steady_time):
        self.line = line
        self.options = options
        self.clock = clock
        self.telemetry = Telemetry()
        self.counts: Counter[str] = Counter(lost=0)
        self._identified = False  # set by `identify`, where the protocol depends on the firmware
        self._armed = False  # by this driver, and not stopped since
        self._settings: dict[str, Union[float, str]] = {}  # first value of each setting
        self._off_requested_at = -math.inf  # of the last request whose reply showed no power [s]
        self._received_at = -math.inf  # when the last bytes were read [s]
        self._punctual_at = -math.inf  # of the last request answered within the timeout [s]
        self._pending = PendingRequests(options.reply_timeout, self.replies_are_named)
        self.meanwhile: Callable[[], None] = lambda: None
        self._begin()

    # Blocking methods

    @abstractmethod
    def identify(self, timeout: float = 0.5) -> Identity:
        """
        Perform the handshake and return the identity of the drive.

        Raises `DriveError` with reason ``silent``, ``garbled`` or ``wrong_protocol`` if no such
        drive answers, ``late`` if it answers too late, ``firmware`` if it does not support the
        commands.
        """

    @abstractmethod
    def read_settings(self, timeout: float = 0.5) -> tuple[Setting, ...]:
        """
        Read back and check each safety-relevant setting.

        Raises `DriveError` with reason ``silent`` if the drive does not reply, ``garbled`` if its
        replies are corrupted.
        """

    def arm(self, timeout: float = 0.5) -> None:
        """
        Enable motor power at zero torque.

        Raises `DriveError` with reason ``not_armed`` and the reported faults if the drive refuses,
        ``silent`` if replies are overdue.
        """
        deadline = self.clock() + timeout
        if not self._until(lambda: self._may_ask, deadline):
            raise self._error(
                f'replies of the {self.maker} to earlier requests are overdue', 'silent')
        self.telemetry = self.telemetry._replace(hazards=())
        self._arm(deadline)
        self._armed = True

    def stop(self, timeout: float = 0.5) -> None:
        """
        Disable motor power; repeat until the drive confirms.

        Raises `DriveError` with reason ``not_stopped`` if it does not within `timeout`; then the
        watchdog of the drive must stop the motor.
        """
        start = self.clock()
        while True:
            self.send_stop()
            soon = self.clock() + STOP_PERIOD
            if self._until(lambda: self.stopped_since(start), soon):
                return
            if self.clock() >= start + timeout:
                raise self._error(
                    f'the drive did not confirm the stop within {timeout:g} s; its own watchdog '
                    f'disarms it after {self.options.watchdog:g} s', 'not_stopped')

    @abstractmethod
    def clear_faults(self, timeout: float = 0.5) -> tuple[str, ...]:
        """
        Clear latched faults, without power, and return the remaining ones.

        Raises `DriveError` with reason ``not_clearable`` if the drive, or its state, does not
        permit it.
        """

    # Non-blocking methods

    def send_torque(self, torque: float, ask: bool = True) -> None:
        """
        Send a torque at the motor shaft, clipped to the torque limit [N m]; feeds the watchdog.

        With `ask`, the same write has the requests of this period.  Nothing is sent if it raises
        `MessageError` for a torque that is not finite, `DriveError` with reason ``not_armed``
        before `arm` and after a stop.
        """
        if not self._armed:
            raise self._error('the motor has not been armed', 'not_armed')
        if not math.isfinite(torque):
            raise MessageError(f'torque must be finite, got {torque!r}', 'not_finite', 'torque')
        limit = self.options.torque_limit
        self._send(self._torque_message(min(max(torque, -limit), limit))
                   + (self._requests() if ask else b''))

    def ask(self) -> None:
        """Send the requests of this period only; does not feed the watchdog."""
        if self._may_ask:
            self._send(self._requests())

    @property
    def may_command(self) -> bool:
        """Return whether the drive keeps up, so that few pending commands can precede a stop."""
        return not self._pending.is_full

    @property
    def _may_ask(self) -> bool:
        return self._pending.may_send(self.clock(), self._armed)

    @abstractmethod
    def feed(self) -> None:
        """Feed the watchdog of the drive without a change of its torque."""

    def send_stop(self) -> None:
        """Send zero torque, the command that disables power, and the requests that confirm it."""
        self._armed = False
        self._send(self._stop_message())

    def stopped_since(self, time: float) -> bool:
        """Return whether a reply requested after `time` confirmed that the motor has no power."""
        return self._off_requested_at >= time

    @property
    def awaits_reply(self) -> bool:
        """Return whether a request has no reply yet."""
        return bool(self._pending)

    def poll(self) -> Telemetry:
        """Read the received data and return the latest telemetry."""
        self._take(self.line.read(), self.clock())
        return self.telemetry

    @abstractmethod
    def budget(self) -> WireBudget:
        """Return the largest traffic of one period of `send_torque` and its replies."""

    # For subclasses

    def _error(self, text: str, reason: str, field: str = 'drive') -> DriveError:
        return DriveError(f'{self.line.port}: {text}', reason, field)

    def _require_identity(self, deadline: float) -> None:
        if not self._identified:
            self.identify(deadline - self.clock())

    def _until(self, condition: Callable[[], bool], deadline: float) -> bool:
        """Poll until a condition holds or the deadline has passed; return whether it holds."""
        while True:
            self.poll()
            if condition():
                return True
            left = deadline - self.clock()
            if left <= 0.0:
                return False
            self.meanwhile()
            self.line.wait(min(left, LONGEST_WAIT))

    def _soon(self, deadline: float) -> float:
        """Return when a reply to a request sent now is overdue, at latest the deadline [s]."""
        timeout: float = self.options.reply_timeout
        return min(deadline, self.clock() + timeout)

    def _ask_until(self, answered: Callable[[], bool], request: Callable[[], bytes],
                   deadline: float, what: str = '') -> None:
        """
        Send the bytes that `request` returns until `answered` is true.

        `what` names the request in the error message; empty in a handshake.  Raises the error of
        `_no_answer` at the deadline [s].
        """
        before = self.counts.copy()
        while not answered():
            self._send(request())
            if not self._until(answered, self._soon(deadline)) and self.clock() >= deadline:
                raise self._no_answer(before, what)

    def _no_answer(self, before: Counter[str], what: str) -> DriveError:
        """Return the error for a request without a reply; see `_ask_until`, `_handshake_error`."""
        if not what or self._corrupted_since(before):
            return self._handshake_error(before)
        return self._error(f'the {self.maker} does not answer {what}', 'silent')

    def _refuse_late(self, deadline: float) -> None:
        """Raise `DriveError` with reason ``late`` if no reply arrives within `reply_timeout`."""
        start, before = self.clock(), self.counts.copy()
        while self._punctual_at < start:
            self._send(self._requests())
            if not self._until(lambda: self._punctual_at >= start, self._soon(deadline)) \
                    and self.clock() >= deadline:
                raise Driver._handshake_error(self, before) if self._corrupted_since(before) \
                    else self._late(before)

    def _corrupted_since(self, before: Counter[str]) -> bool:
        return any(self.counts[kind] > before[kind] for kind in ('refused', 'skipped'))

    def _handshake_error(self, before: Counter[str]) -> DriveError:
        """Return the error for a failed handshake; `before` are the counts at its start."""
        received = self.counts['bytes'] - before['bytes']
        if not received:
            return self._error(
                f'no {self.maker} answers; is it powered, are RX and TX crossed, is its serial '
                'port set to this protocol and baud rate?', 'silent')
        if self.counts['replies'] > before['replies'] and not self._corrupted_since(before):
            return self._late(before)
        return self._error(
            f'{received} bytes received, but no complete reply of the {self.maker}: wrong baud '
            'rate, another protocol, or noise', 'garbled')

    def _late(self, before: Counter[str]) -> DriveError:
        return self._error(
            f'{self.counts["replies"] - before["replies"]} valid replies of the {self.maker} '
            'received, but none to the last request: they arrive too late, on a busy machine or a '
            f'slow line; reply_timeout is {self.options.reply_timeout:g} s', 'late')

    def _no_node(self, before: Counter[str], others: set[int], advice: str) -> DriveError:
        """Return the error for a failed handshake on a bus; `others` are the ids of seen nodes."""
        if self.counts['skipped'] > before['skipped']:
            return Driver._handshake_error(self, before)
        name, seen = self.shares_line, ', '.join(map(str, sorted(others)))
        return self._error(
            f'no {self.maker} with {name} {getattr(self.options, name)} answers'
            + (f', but messages from {seen} arrive: set {name}, or check the wiring' if seen else
               f'; is it powered, {advice}, is the bit rate the same, are both ends terminated '
               'with 120 ohm?'), 'silent', name if seen else 'drive')

    @abstractmethod
    def _begin(self) -> None:
        """Create the parser and the state of this driver; `__init__` calls it last."""

    @abstractmethod
    def _arm(self, deadline: float) -> None:
        """See `arm`."""

    @abstractmethod
    def _stop_message(self) -> bytes:
        """Return the bytes of `send_stop`."""

    def _send(self, data: bytes) -> None:
        if data:
            before = self.clock()
            if self.separator and self._pending.is_stalled(before):
                data = self.separator + data
                if before - self._received_at > LONGEST_WAIT:  # else a late reply may be arriving
                    for reply in self._parser.feed(self.separator):
                        self._take_reply(reply, before)
                    self._parser.counts['skipped'] -= len(self.separator)  # not received
            self.line.write(data)
            self._pending.written(before, self.clock())
            self.counts['sent'] += 1

    @abstractmethod
    def _torque_message(self, torque: float) -> bytes:
        """Return the bytes that command a torque [N m]."""

    @abstractmethod
    def _requests(self) -> bytes:
        """Return the bytes that request the telemetry of this period."""

    @abstractmethod
    def _take_reply(self, reply: Any, now: float) -> None:
        """Update telemetry and counts from a reply that the parser found."""

    def _take(self, data: bytes, now: float) -> None:
        """Update telemetry and counts from received bytes; `data` may be empty."""
        if data:
            self._received_at = now
            self.counts['bytes'] += len(data)
            others = self.counts['of_others']
            for reply in self._parser.feed(data):
                self.counts['replies'] += 1
                self._take_reply(reply, now)
            dict.update(self.counts, self._parser.counts)
            if self.counts['of_others'] > others:
                self._add_hazard('', 'another sender commands the drive')
        self.counts['lost'] += self._pending.take_lost(now)

    def _add_hazard(self, setting: str, text: str) -> None:
        """Report a reason to stop an armed motor, each reason once."""
        hazard, known = Hazard(setting, text), self.telemetry.hazards
        if self._armed and hazard not in known:
            self.telemetry = self.telemetry._replace(hazards=(*known, hazard))

    def _check_setting(self, name: str, value: Union[float, str]) -> None:
        """Report a setting that has changed since its first read; ignore NaN, an unknown value."""
        if value != value:
            return
        before = self._settings.setdefault(name, value)
        if value != before:
            words = [f'{item:g}' if isinstance(item, float) else item for item in (value, before)]
            self._add_hazard(name, f'{name} is {words[0]}, was {words[1]}')

    def _match(self, kind: object, now: float) -> Match:
        """Return the request that a reply answers; see `PendingRequests`."""
        match = self._pending.match(kind, now)
        self.counts['unexpected'] += match.sent == -math.inf
        if match.measured is not None:
            self._punctual_at = match.measured
        return match
