# SPDX-License-Identifier: Apache-2.0
"""
One drive from handshake to stop: what is done to it in each period of the loop.

A session may be used from several threads; each call holds its lock.  It sleeps only where a
driver waits for an answer: in `configure`, `deactivate`, and in a `tick` that arms the motor
or looks for a drive that was lost.
"""
from collections import Counter
import math
import threading
import time
from typing import Callable, List, Optional, Tuple

from ballbot_ros.bridge.connect import handshake
from ballbot_ros.bridge.hardware_file import Hardware
from ballbot_ros.bridge.report import Power, Report
from ballbot_ros.bridge.supervisor import Motion, Supervisor
from ballbot_ros.errors import (
    BallbotError, DriveError, EstimateLostError, LinkError, RefusedError)
from ballbot_ros.estimation import Estimate, Fusion, ImuReading
from ballbot_ros.hardware.driver import Driver, Identity, Setting, Telemetry
from ballbot_ros.physics.robot import Robot

# Without a measurement for so long there is no torque, and after LOST the drive is looked for
# anew: it may have been switched off and on [s].
SILENCE, LOST = 0.1, 0.3
# Between two attempts to find a drive that was lost [s].
RETRY = 0.1
# Between two attempts to arm a drive that could not, where the file says `rearm` [s].
ARM_AGAIN = 0.3
# Patience with a drive that answers, when one was lost: together well below a second at first,
# more for one that is slow [s].
HANDSHAKE, MOST_PATIENCE = 0.25, 1.0
# Between two repetitions of a stop that is not confirmed yet [s].
STOP_AGAIN = 0.01
# Patience with the stop at the end; the drive's watchdog does the rest [s].
LAST_STOP = 0.5


class Session:
    """
    Keeps a drive in the state that is wanted, whatever happens to the line.

    Parameters
    ----------
    hardware : Hardware
    robot : Robot
    connect : callable
        Opens the line and returns a driver on it; called again after the line was lost.
    clock : callable
        Gives seconds and never goes back.

    Attributes
    ----------
    counts : Counter
        ``links_lost``, ``reconnects``, ``let_go`` (of the motor, by the drive), ``armed``.
    notices : list of str
        To be logged and cleared by the owner.
    trouble : str
        Why there is no drive at the moment; empty when there is.

    """

    def __init__(self, hardware: Hardware, robot: Robot, connect: Callable[[], Driver],
                 clock: Callable[[], float] = time.monotonic):
        """Start without a line, not active, the e-stop engaged."""
        self._hardware, self._connect, self.clock = hardware, connect, clock
        self._period = 1.0 / hardware.connection.loop_rate
        self.supervisor = Supervisor(hardware.limits, self._period)
        self.fusion = Fusion(robot, hardware.imu, hardware.estimate, hardware.joint.encoder_zero)
        self._lock = threading.RLock()
        self._driver: Optional[Driver] = None
        self._power = Power.OFF
        self._wanted = False  # a drive, that is between configure and close
        self._active = False
        self._sent = False
        self._stamp = -math.inf  # of the last estimate
        self._asked = self._answered = self._stop_sent = self._stop_since = self._armed_at = 0.0
        self._next_try = self._next_arm = 0.0
        self._failures = 0  # of looking for the drive, in a row
        self.identity: Optional[Identity] = None
        self.counts: Counter = Counter()
        self.notices: List[str] = []
        self.trouble = self._said = ''

    # What the owner wants

    def configure(self) -> Tuple[Identity, Tuple[Setting, ...]]:
        """
        Open the line, find the drive, stop its motor, and check its settings.

        Raises
        ------
        LinkError, DriveError
            If there is no such port, or not such a drive.
        ConfigurationError
            If a setting that safety rests on is not as it must be.

        """
        with self._lock:
            found = self._handshake(patience=0.5)
            self._wanted = True
            return found

    def activate(self) -> None:
        """
        Let the motor have power, once the e-stop is released.

        Raises
        ------
        RefusedError
            If there is no drive.

        """
        with self._lock:
            if self._driver is None:
                raise RefusedError(f'there is no drive: {self.trouble or "not configured"}')
            self._active = True

    def deactivate(self) -> None:
        """Take the power off the motor and wait until the drive confirms it."""
        with self._lock:
            self._active = False
            self.supervisor.quiet()
            self._stop_now()

    def close(self) -> None:
        """Stop the motor and close the line; whatever happens, nothing is raised."""
        with self._lock:
            self._wanted = self._active = False
            self.supervisor.quiet()
            self._stop_now()
            self._hang_up()

    def command(self, torque: float, stamp: float) -> None:
        """
        Take a command and send it at once, unless one went out this period already.

        Raises
        ------
        MessageError
            See `Supervisor.offer`.

        """
        with self._lock:
            self.supervisor.offer(torque, stamp, self.clock())
            if self._power is not Power.ON or not self._allowed:
                return
            if self._sent:
                self._sent = False  # the next tick sends it
                return
            try:
                self._send_torque()
            except LinkError as error:
                self._lose(error)

    def imu(self, reading: ImuReading) -> None:
        """Take an IMU reading; raise `MessageError` if it is out of order."""
        with self._lock:
            self.fusion.imu(reading)

    def engage(self, reason: str) -> None:
        """Engage the e-stop; the motor loses its power at once."""
        with self._lock:
            self.supervisor.trigger(reason)
            if self._power is Power.ON:
                self._begin_stop()

    def release(self) -> None:
        """
        Release the e-stop.

        Raises
        ------
        RefusedError
            With the reason why not.

        """
        with self._lock:
            self.supervisor.reset(self.clock(), self._obstacle())

    @property
    def link_up(self) -> bool:
        """Tell whether the drive answers."""
        return self._driver is not None

    @property
    def driver(self) -> Optional[Driver]:
        """Return the driver in use, for its counters."""
        return self._driver

    # What happens each period

    def tick(self) -> Optional[Report]:
        """Do what this period asks for; None before `configure` and after `close`."""
        with self._lock:
            if not self._wanted:
                return None
            if self._driver is None:
                self._look_for_drive()
            estimate, telemetry = None, Telemetry()
            if self._driver is not None:
                try:
                    telemetry = self._driver.poll()
                    now = self.clock()
                    estimate = self._measure(telemetry, now)
                    self._watch(telemetry, now)
                    self._act(self._driver, now)
                except (LinkError, DriveError) as error:
                    self._lose(error)
            supervisor = self.supervisor
            return Report(self.clock(), estimate, supervisor.torque, telemetry, self._power,
                          supervisor.e_stop, supervisor.timed_out, supervisor.commanded,
                          self._driver is not None)

    @property
    def _allowed(self) -> bool:
        return self._active and not self.supervisor.e_stop

    def _obstacle(self) -> str:
        """Return what speaks against releasing the e-stop."""
        driver = self._driver
        if driver is None:
            return f'the line to the drive is down ({self.trouble or "not configured"})'
        if not self._active:
            return 'the bridge is not active; activate it first'
        if self.clock() - (driver.telemetry.time or 0.0) > SILENCE:
            return 'the drive does not tell where the motor is'
        if self._power is Power.STOPPING:
            return 'the drive has not confirmed the stop yet'
        if self._needs_imu():
            return ('no IMU is heard, and without one the pendulum angle is a guess; publish imu, '
                    'or set imu_required: false in the hardware file for a level floor')
        return ''

    def _needs_imu(self) -> bool:
        return self._hardware.connection.imu_required and not self.fusion.has_imu(self.clock())

    def _measure(self, telemetry: Telemetry, now: float) -> Optional[Estimate]:
        """Take a new measurement, if there is one."""
        if telemetry.position is None or telemetry.time is None \
                or telemetry.time <= self._answered:
            return None
        self._answered = telemetry.time
        # The drive looked at its encoder when it was asked, not when the answer was read.
        stamp = self._asked if 0.0 <= telemetry.time - self._asked <= 2.0 * self._period \
            else telemetry.time
        self._stamp = max(stamp, self._stamp)  # of one that was late and one that was not
        try:
            return self.fusion.encoder(
                self._stamp, self._hardware.joint.joint_angle(telemetry.position),
                self.supervisor.torque)
        except EstimateLostError as error:
            # No policy goes on by itself from here: the next estimate takes rest for granted.
            self.supervisor.trigger(str(error))
            self._notice(str(error))
            return None

    def _motion(self, now: float) -> Optional[Motion]:
        """Return how the robot moves, None where that is not known well enough for torque."""
        estimate = self.fusion.estimate
        if estimate is None or now - self._answered > SILENCE or self._needs_imu():
            return None
        readings = estimate.readings
        return Motion(readings.pendulum_angle, readings.pendulum_rate, readings.joint_rate)

    def _watch(self, telemetry: Telemetry, now: float) -> None:
        """Notice a drive that fell silent, or let go of the motor by itself."""
        if now - max(self._answered, self._armed_at) > LOST:
            raise DriveError('silent', f'the drive has not answered for {LOST:g} s')
        if self._power is Power.ON and now - max(self._answered, self._armed_at) > SILENCE:
            # It may have been switched off and on, and forgotten what it was told.
            self._went_wrong(f'the drive fell silent for {SILENCE:g} s')
            self._begin_stop()
        told = telemetry.status_time is not None and telemetry.status_time > self._armed_at
        if self._power is Power.ON and told and (telemetry.faults or telemetry.armed is False):
            self.counts['let_go'] += 1
            self._went_wrong('the drive let go of the motor: '
                             + (', '.join(telemetry.faults) or 'no reason given'))
            self._begin_stop()

    def _act(self, driver: Driver, now: float) -> None:
        if self._power is Power.ON and not self._allowed:
            self._begin_stop()
        elif self._power is Power.ON:
            if not self._sent:
                self._send_torque()
            self._sent = False
            return
        elif self._power is Power.OFF and self._allowed and now >= self._next_arm:
            self._arm(driver)
        if self._power is Power.STOPPING and driver.stopped_since(self._stop_since):
            self._power = Power.OFF
        elif self._power is Power.STOPPING and now - self._stop_sent >= STOP_AGAIN:
            self._stop_sent = self._asked = now
            driver.send_stop()
            return
        self._asked = self.clock()
        driver.ask()

    def _send_torque(self) -> None:
        assert self._driver is not None
        now = self.clock()
        torque = self.supervisor.decide(now, self._motion(now))
        self._driver.send_torque(self._hardware.joint.motor_torque(torque))
        self._asked, self._sent = now, True

    def _arm(self, driver: Driver) -> None:
        try:
            driver.arm(HANDSHAKE)
        except DriveError as error:
            self._next_arm = self.clock() + ARM_AGAIN
            self._went_wrong(f'cannot arm: {error}')
            self._begin_stop()
            return
        self.supervisor.quiet()
        self._power, self._armed_at = Power.ON, self.clock()
        self.counts['armed'] += 1
        self._notice('the motor is under power')

    def _begin_stop(self) -> None:
        """Let the stop be repeated until the drive confirms it."""
        self.supervisor.quiet()
        self._power, self._sent = Power.STOPPING, False
        self._stop_since = self._stop_sent = self.clock()
        if self._driver is not None:
            try:
                self._driver.send_stop()
            except LinkError as error:
                self._lose(error)

    def _stop_now(self) -> None:
        """Stop and wait for the confirmation, where there is a drive."""
        if self._driver is not None:
            try:
                self._driver.stop(LAST_STOP)
            except BallbotError as error:
                self._notice(f'the stop was not confirmed: {error}')
        self._power = Power.OFF

    # Finding and losing the drive

    def _handshake(self, patience: float) -> Tuple[Identity, Tuple[Setting, ...]]:
        self._hang_up()
        self._driver, identity, settings = handshake(self._connect, patience)
        self.identity, self.trouble, self._power = identity, '', Power.OFF
        self._answered = self._armed_at = self.clock()
        return identity, settings

    def _look_for_drive(self) -> None:
        now = self.clock()
        if now < self._next_try:
            return
        try:
            self._handshake(min(HANDSHAKE * (1 + self._failures), MOST_PATIENCE))
        except BallbotError as error:
            self._failures += 1
            self._next_try = self.clock() + RETRY
            if str(error) != self.trouble:
                self.trouble = str(error)
                self._notice(f'looking for the drive: {error}')
            return
        self._failures = 0
        self.counts['reconnects'] += 1
        self._notice('the drive is back')

    def _lose(self, error: BallbotError) -> None:
        self.counts['links_lost'] += 1
        self.trouble = str(error)
        self._hang_up()
        if self._power is not Power.OFF:
            self._went_wrong(f'the line was lost: {error}')
        self.supervisor.quiet()
        self._power, self._next_try = Power.OFF, self.clock()
        self._notice(f'lost the drive: {error}')

    def _went_wrong(self, what: str) -> None:
        """Engage the e-stop, unless the robot may go on by itself."""
        if not self._hardware.limits.rearm:
            self.supervisor.trigger(what)
        self._notice(what)

    def _hang_up(self) -> None:
        driver, self._driver = self._driver, None
        if driver is not None:
            driver.line.close()

    def _notice(self, sentence: str) -> None:
        # What goes wrong again and again is said once, and an owner that does not look is spared.
        if sentence != self._said and len(self.notices) < 20:
            self.notices.append(sentence)
        self._said = sentence
