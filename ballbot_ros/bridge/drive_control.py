# SPDX-License-Identifier: Apache-2.0
"""Control of a drive: measure, arm, command, stop and reconnect, at the rate of the link."""
from collections import Counter
import logging
import math
from typing import Any, Callable, Generic, NamedTuple, Optional, Protocol, Tuple, Union

from ballbot_ros.bridge.condition import ConditionMonitor
from ballbot_ros.bridge.drive_line import DriveLine, HANDSHAKE
from ballbot_ros.bridge.hardware_file import Hardware
from ballbot_ros.bridge.motor_state import (
    Event, MEASUREMENT_AGE_MAX, MotorState, Power, RECONNECT_TIMEOUT)
from ballbot_ros.bridge.observer import Level, SessionObserver
from ballbot_ros.bridge.realtime import PAGE
from ballbot_ros.bridge.sensing import AxisEstimate, AxisSensing, Estimated
from ballbot_ros.bridge.supervisor import EStop, StopReason, Supervisor
from ballbot_ros.drives.contract import Telemetry
from ballbot_ros.drives.driver import Driver, STOP_PERIOD
from ballbot_ros.errors import (
    BallbotError, DriveError, EstimateLostError, LinkError, MessageError, RefusedError)

# The link carries one torque per period on average; one may be sent early by this [periods].
SEND_LEAD = 1.5
# The reply time of the controller varies, so a period may have no command: after this time without
# a torque [periods] the last one is repeated in each period until the next command.
REPEAT = 1.5
# Longest time between two decisions about the torque [periods].
TORQUE_INTERVAL_MAX = REPEAT + 1.0
# With `rearm`, time between two attempts to arm a drive [s].
ARM_AGAIN = 0.3
# Pause after a drive disarmed by itself [s]: `ARM_AGAIN` at first, doubled each time up to
# LONGEST_PAUSE; reset after the drive was armed for HELD.
LONGEST_PAUSE, HELD = 20.0, 10.0


class Pacer(NamedTuple):
    """
    Rate limits of the link: times of the next torque, stop and attempt to arm.

    Each method for an event returns the next state; times are in s.
    """

    period: float
    waiting: int = 0  # commands since the last torque
    repeating: bool = False
    torque_sent: float = -math.inf
    next_torque: float = -math.inf  # by the average rate of the link
    stop_sent: float = -math.inf
    next_arm: float = -math.inf
    pause: float = 0.0  # before `next_arm`

    def commanded(self) -> 'Pacer':
        """Record a command; if the rate limit delays it, a tick sends it, or the next one."""
        # Here and below the constructor is used: `_replace` takes longer than the decision.
        return Pacer(self.period, self.waiting + 1, *self[2:])

    def has_room(self, now: float) -> bool:
        """Return whether a torque may be sent between two ticks."""
        return now >= self.next_torque - SEND_LEAD * self.period

    def is_torque_due(self, now: float) -> bool:
        """
        Return whether a tick must send a torque.

        The only command since the last torque is sent if that leaves room for the next one, which
        replaces it otherwise: commands at the rate of the loop would all wait for a tick.
        """
        return (self.repeating or self.waiting > 1
                or self.waiting == 1 and self.has_room(now - self.period)
                or now - self.torque_sent >= REPEAT * self.period)

    def sent_torque(self, now: float) -> 'Pacer':
        """Record a sent torque, new or repeated."""
        due = self.next_torque if self.next_torque > now else now
        return Pacer(self.period, 0, not self.waiting, now, due + self.period, *self[5:])

    def is_stop_due(self, now: float) -> bool:
        """Return whether to repeat an unconfirmed stop."""
        return now - self.stop_sent >= STOP_PERIOD

    def sent_stop(self, now: float) -> 'Pacer':
        """Record a sent stop and drop the waiting command."""
        return self._replace(waiting=0, stop_sent=now)

    def may_arm(self, now: float) -> bool:
        """Return whether an attempt to arm is allowed."""
        return now >= self.next_arm

    def not_armed(self, now: float) -> 'Pacer':
        """Record a failed attempt to arm."""
        return self._replace(next_arm=now + ARM_AGAIN)

    def tripped(self, now: float, since: float) -> 'Pacer':
        """Record that the drive disarmed by itself; repeated trips lengthen the pause."""
        before = self.pause if now - since < HELD else 0.0
        pause = min(max(ARM_AGAIN, 2.0 * before), LONGEST_PAUSE)
        return self._replace(next_arm=now + pause, pause=pause)


LOG = logging.getLogger(__name__)

# Timeout of the final stop [s]; after it the watchdog of the drive stops the motor.
LAST_STOP = 0.5
IMU_SILENT = 'the IMU timed out while the motor had torque'


class AxisLaw(Protocol):
    """Computes the torque of an axis."""

    def torque(self, readings: Any, in_force: float, e_stop: bool) -> float:
        """Return the torque for readings [N m]; see `SupervisedController.torque`."""

    def forget(self) -> None:
        """Stay idle until the next set-point."""


class DriveControl(Generic[Estimated]):
    """
    Operates the drive of one axis by its motor state and pacer; `Session` holds the lock.

    Attributes
    ----------
    law : AxisLaw or None
        Computes a torque for each estimate; None: torque commands come from a topic.
    counts : Counter
        Number of events by diagnostics name.
    refusal : str
        Reason why the last attempt to arm the motor failed; otherwise empty.
    unconfirmed : str
        Reason why the drive did not confirm the last stop; otherwise empty.
    others : tuple of DriveControl
        The other axes: torque requires that they are armed with fresh measurements, too.

    """

    def __init__(self, hardware: Hardware, sensing: AxisSensing[Estimated],
                 connect: Callable[[], Driver], clock: Callable[[], float],
                 observer: SessionObserver, law: Optional[AxisLaw] = None):
        self._observer = observer
        self._hardware, self._clock, self.law = hardware, clock, law
        period = 1.0 / hardware.connection.loop_rate
        self.line = DriveLine(connect, clock, hardware.connection.watchdog)
        self.supervisor = Supervisor(hardware.limits, TORQUE_INTERVAL_MAX * period)
        self.sensing = sensing
        self.others: Tuple['DriveControl[Any]', ...] = ()
        self.monitor = ConditionMonitor(
            hardware.battery, hardware.thermal, hardware.limits.torque_limit)
        self.power, self._pacer = Power(), Pacer(period)
        self._period, self._watched, self._unconfirmed = period, -math.inf, 0.0
        self.counts: Counter[str] = Counter()
        self.refusal = self.unconfirmed = ''

    def begin(self) -> None:
        """Start with a drive after its handshake, which has stopped the motor."""
        self._change(Event.FOUND)
        self.sensing.begin(self.power.since)

    def tick(self, active: bool) -> Optional[Estimated]:
        """Execute one period and return the new estimate, if there is one."""
        if self.line.driver is None and self.line.reconnect():
            self.begin()
        driver, estimate = self.line.driver, None
        if driver is not None:
            try:
                if self.sensing.expecting or driver.awaits_reply:  # otherwise all were read
                    estimate = self.measure(driver)
                if estimate is not None and self.answer(estimate):
                    self._pacer = self._pacer.commanded()
                now = self._clock()
                self._watch(driver, now)
                self._watch_imu(now)
                self._derate(driver.telemetry, now)
                self._act(driver, now, active and not self.supervisor.e_stop)
            except (LinkError, DriveError) as error:
                self.disconnect(driver, error)
        return estimate

    def measure(self, driver: Driver) -> Optional[Estimated]:
        """Read a new measurement, if there is one."""
        try:
            return self.sensing.take(driver.poll())
        except EstimateLostError as error:
            # Require a release by a person: the next estimate assumes a robot at rest.
            self.supervisor.trigger(EStop(StopReason(error.reason), str(error)))
            LOG.warning('%s', error)
            return None

    def answer(self, estimate: AxisEstimate) -> bool:
        """Compute the torque of the onboard controllers; return whether there is one to send."""
        law, supervisor = self.law, self.supervisor
        if law is None:
            return False
        torque = law.torque(estimate.readings, supervisor.torque, bool(supervisor.e_stop))
        if supervisor.e_stop or self.power.state is not MotorState.ARMED:
            return False
        try:
            supervisor.gate.offer(torque, estimate.stamp, self._clock())
        except MessageError:  # stale measurement, counted by the gate
            return False
        return True

    def follow(self, now: float) -> None:
        """Send the torque of a new command now if the link allows, else in the next tick."""
        driver = self.line.driver
        if driver is None or self.power.state is not MotorState.ARMED or self._is_held_up(now):
            return
        self._pacer = self._pacer.commanded()
        if self._pacer.has_room(now) and driver.may_command:
            try:
                self._send_torque(driver, now, ask=False)
            except (LinkError, DriveError) as error:
                self.disconnect(driver, error)

    def withdraw(self) -> None:
        """Start a stop if the motor has power."""
        driver = self.line.driver
        if driver is not None and self.power.state is MotorState.ARMED:
            self._begin_stop(driver, Event.WITHDRAWN)

    def stop(self) -> None:
        """After `withdraw`, stop and wait for the confirmation, if a drive is connected."""
        if self.line.driver is not None:
            try:
                self.line.driver.stop(LAST_STOP)
            except BallbotError as error:
                self.unconfirmed = f'the stop was not confirmed: {error}'
                LOG.warning('%s', self.unconfirmed)
                return
            self.unconfirmed = ''
        if self.power.state is MotorState.STOPPING:
            self._change(Event.STOPPED)

    def clear_faults(self, driver: Driver) -> Tuple[str, ...]:
        """Clear the faults of the drive and return those that remain; may raise `RefusedError`."""
        try:
            return driver.clear_faults(HANDSHAKE)
        except DriveError as error:
            raise RefusedError(str(error), 'failed', 'drive') from error
        except LinkError as error:
            self.disconnect(driver, error)
            raise RefusedError(str(error), 'failed', 'drive') from error
        finally:
            self._restart(self._clock())

    def close(self) -> None:
        """Stop the motor and close the link."""
        self.stop()
        self._change(Event.CLOSED)
        self.line.close()

    def disconnect(self, driver: Driver, error: BallbotError) -> None:
        """Continue without the drive; no effect if it is disconnected already."""
        if self.line.driver is driver:
            self._change(
                StopReason.LOST, EStop(StopReason.LOST, f'the line was lost: {error}'))
            self.line.disconnect(error)

    def _watch(self, driver: Driver, now: float) -> None:
        """Detect a delayed loop, and a drive that stopped answering or disarmed the motor."""
        if self.power.state is MotorState.ARMED and self._is_held_up(now):
            cause = EStop(
                StopReason.HELD_UP, f'the machine delayed the loop by {now - self._watched:.2f} s,'
                ' too long for the watchdog of the drive '
                f'({self._hardware.connection.watchdog:g} s), {PAGE}')
            self._restart(now)
            self._begin_stop(driver, StopReason.HELD_UP, cause)
            return
        silence = self.sensing.silence(now)
        if silence > RECONNECT_TIMEOUT:
            raise DriveError(f'the drive has not answered for {RECONNECT_TIMEOUT:g} s', 'silent',
                             'drive')
        observed = self.power.observe(
            driver.telemetry, silence, self._status_age(driver.telemetry, now))
        if observed is not None:
            if observed.reason is StopReason.HAZARD:  # arming again does not clear it
                self.supervisor.trigger(observed)
            self._begin_stop(driver, observed.reason, observed)

    def _is_held_up(self, now: float) -> bool:
        """Return whether the drive may have ended the torque without a new command."""
        # The last torque may have been sent a period before the last check.
        return now - self._watched + self._period > self._hardware.connection.watchdog

    def _restart(self, now: float) -> None:
        """Restart the timeouts after a time without requests."""
        self._watched, self._unconfirmed = now, 0.0
        self.sensing.restart(now)

    def _status_age(self, telemetry: Telemetry, now: float) -> float:
        """
        Return the time for which the drive could have confirmed status and motion but did not [s].

        Time in which this process was preempted does not count: no requests were sent then.
        """
        confirmed = max(telemetry.status_time or 0.0, self.power.since)
        if now - self.sensing.stamp > MEASUREMENT_AGE_MAX:
            confirmed = -math.inf  # replies arrive, but are too old
        elapsed = min(now - self._watched, TORQUE_INTERVAL_MAX * self._period)
        self._unconfirmed = 0.0 if confirmed > self._watched else self._unconfirmed + elapsed
        self._watched = now
        return self._unconfirmed

    def _watch_imu(self, now: float) -> None:
        """Drop the commands while a required IMU does not respond."""
        watch, supervisor = self.sensing.imu_watch, self.supervisor
        pulled = watch.update(now, supervisor.torque != 0.0)
        if not (self._hardware.connection.imu_required and watch.silent
                and self.power.state is MotorState.ARMED):
            return
        if pulled and not self._hardware.limits.rearm:
            supervisor.trigger(EStop(StopReason.IMU_SILENT, IMU_SILENT))
        if pulled:
            LOG.warning('%s', IMU_SILENT)
            self._observer.event(IMU_SILENT, Level.FAULT)
        self._forget()

    def _forget(self) -> None:
        """Drop the commands; the torque starts from zero again."""
        self.supervisor.quiet()
        self.sensing.commanded(0.0, self._clock())
        if self.law is not None:
            self.law.forget()

    def _derate(self, telemetry: Telemetry, now: float) -> None:
        condition = self.monitor.update(telemetry, self.supervisor.torque, now)
        self.supervisor.derating = condition.part
        if condition.stop and not self.supervisor.e_stop:
            self.supervisor.trigger(EStop(StopReason.BATTERY_EMPTY, condition.stop))
            LOG.error('%s', condition.stop)

    def _act(self, driver: Driver, now: float, allowed: bool) -> None:
        if self.power.state is MotorState.ARMED and not allowed:
            self._begin_stop(driver, Event.WITHDRAWN)
        elif self.power.state is MotorState.ARMED and self._pacer.is_torque_due(now) \
                and (driver.may_command or self.sensing.is_stale(now)):  # stale: zero torque
            self._send_torque(driver, now, ask=True)
            return
        elif self.power.state is MotorState.DISARMED and allowed and self._pacer.may_arm(now):
            self._arm(driver)
        if self.power.state is MotorState.STOPPING:
            if driver.stopped_since(self.power.since):
                self._change(Event.STOPPED)
            elif now - self.power.since > RECONNECT_TIMEOUT:
                raise DriveError(f'the drive has not confirmed the stop for {RECONNECT_TIMEOUT:g} '
                                 's', 'not_stopped', 'drive')
            elif self._pacer.is_stop_due(now):
                self._pacer = self._pacer.sent_stop(now)
                self.sensing.ask(now)
                driver.send_stop()
                return
        self.sensing.ask(self._clock())
        driver.ask()

    def _send_torque(self, driver: Driver, now: float, ask: bool) -> None:
        self._watch_imu(now)
        joint = self._hardware.joint
        together = all(axis.power.state is MotorState.ARMED and not axis.sensing.is_stale(now)
                       for axis in self.others)
        torque = self.supervisor.decide(now, self.sensing.motion(now) if together else None)
        self._pacer = self._pacer.sent_torque(now)
        self.sensing.commanded(torque, now)
        if ask:
            self.sensing.ask(now)
        driver.send_torque(joint.motor_torque(torque), ask)

    def _arm(self, driver: Driver) -> None:
        driver.meanwhile = self._feed_others
        try:
            driver.arm(HANDSHAKE)
        except DriveError as error:
            self._pacer = self._pacer.not_armed(self._clock())
            refusal = f'cannot arm: {error}'
            self._begin_stop(
                driver, StopReason.NOT_ARMED, EStop(StopReason.NOT_ARMED, refusal))
            self.refusal = refusal
            return
        self.refusal = ''
        self._change(Event.ARMED)
        self._restart(self.power.since)
        LOG.info('motor power is enabled')

    def _feed_others(self) -> None:
        """Keep the other axes armed while this one blocks."""
        for axis in self.others:
            axis.feed()

    def feed(self) -> None:
        """Feed the watchdog of an armed drive, and restart the timeouts."""
        driver, now = self.line.driver, self._clock()
        if driver is not None and self.power.state is MotorState.ARMED \
                and self._pacer.has_room(now):
            self._pacer = self._pacer.sent_torque(now)
            try:
                driver.poll()
                driver.feed()
            except LinkError as error:
                self.disconnect(driver, error)
        self._restart(now)

    def _begin_stop(self, driver: Driver, event: Union[Event, StopReason],
                    cause: Optional[EStop] = None) -> None:
        """Send a stop; it is repeated until the drive confirms it."""
        self._change(event, cause)
        self._pacer = self._pacer.sent_stop(self.power.since)
        try:
            driver.send_stop()
        except LinkError as error:
            self.disconnect(driver, error)

    def _change(self, event: Union[Event, StopReason], cause: Optional[EStop] = None) -> None:
        """Change the state of the motor and drop earlier commands; a fault has a cause."""
        name = event.value.replace('_', ' ').replace('links', 'drive')
        if cause is None:
            self._observer.event(name)
        else:
            self._observer.event(f'{name}: {cause.text}', Level.FAULT)
            if not self._hardware.limits.rearm:
                self.supervisor.trigger(cause)
            elif event not in (StopReason.NOT_ARMED, StopReason.LOST):  # the drive did not trip
                self._pacer = self._pacer.tripped(self._clock(), self.power.since)
            if event is not StopReason.LOST and cause.text != self.refusal:
                LOG.warning('%s', cause.text)  # repeated attempts are logged once
        self._forget()
        self.counts[event.value] += 1
        self.power = self.power.after(event, self._clock())
