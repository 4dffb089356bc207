# SPDX-License-Identifier: Apache-2.0
"""
One drive from handshake to stop: what is done to it in each period of the loop.

A session may be used from several threads; each call holds its lock.  It sleeps only where a
driver waits for an answer: in `configure`, `deactivate`, and in a `tick` that arms the motor
or looks for a drive that was lost.
"""
from collections import Counter
import threading
import time
from typing import Callable, Optional, Tuple

from ballbot_ros.bridge.drive_line import DriveLine, HANDSHAKE
from ballbot_ros.bridge.hardware_file import Hardware
from ballbot_ros.bridge.notices import Notices
from ballbot_ros.bridge.report import Power, Report
from ballbot_ros.bridge.sensing import Sensing, SILENCE
from ballbot_ros.bridge.supervisor import Supervisor
from ballbot_ros.drives.contract import Identity, Setting, Telemetry
from ballbot_ros.drives.driver import Driver
from ballbot_ros.errors import BallbotError, DriveError, EstimateLostError, LinkError, RefusedError
from ballbot_ros.estimation import Estimate, Fusion, ImuReading
from ballbot_ros.physics.model.robot import Robot

# After so long without an answer the drive is looked for anew: it may have been switched off and
# on [s].
LOST = 0.3
# Between two attempts to arm a drive that could not, where the file says `rearm` [s].
ARM_AGAIN = 0.3
# Between two repetitions of a stop that is not confirmed yet [s].
STOP_AGAIN = 0.01
# Patience with the stop at the end; the drive's watchdog does the rest [s].
LAST_STOP = 0.5
# One torque goes out per period on average, and at most one of them so many periods early.
EARLY = 1.5
# A period may have no command, for the answers of the controller wander: torque is repeated where
# none has gone out for so many periods, and then in each until there is a command again.
REPEAT = 1.5
# So many periods pass between two decisions about the torque at most.
DECIDED = REPEAT + 1.0


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
    notices : Notices
        To be logged by the owner.
    line : DriveLine
        With the drive that there is, or why there is none.
    fusion : Fusion
        With the newest estimate.
    refusal : str
        Why the motor could not be put under power when that was last tried; else empty.

    """

    def __init__(self, hardware: Hardware, robot: Robot, connect: Callable[[], Driver],
                 clock: Callable[[], float] = time.monotonic):
        """Start without a line, not active, the e-stop engaged."""
        self._hardware, self.clock = hardware, clock
        self._period = 1.0 / hardware.connection.loop_rate
        self.counts: Counter[str] = Counter()
        self.notices = Notices()
        self.refusal = ''
        self.line = DriveLine(connect, clock, self.counts, self.notices)
        self.supervisor = Supervisor(hardware.limits, DECIDED * self._period)
        self._sensing = Sensing(hardware, robot)
        self.fusion: Fusion = self._sensing.fusion
        self._lock = threading.RLock()
        self._power = Power.OFF
        self._wanted = False  # a drive, that is between configure and close
        self._active = False
        self._unsent = False  # a command that came when none could go out
        self._repeating = False
        self._sent_at = self._next_torque = 0.0
        self._stop_sent = self._stop_since = self._armed_at = self._next_arm = 0.0

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
            found = self.line.open(patience=0.5)
            self._begin()
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
            if self.line.driver is None:
                raise RefusedError(f'there is no drive: {self.line.trouble or "not configured"}')
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
            self.line.close()

    def command(self, torque: float, stamp: float) -> None:
        """
        Take a command and send it at once, unless the line has been given its share.

        Raises
        ------
        MessageError
            See `Supervisor.offer`.

        """
        with self._lock:
            now = self.clock()
            self.supervisor.offer(torque, stamp, now)
            if self._power is not Power.ON or not self._allowed:
                return
            self._unsent = True  # the next tick sends it, if not even now there is room
            if now < self._next_torque - EARLY * self._period:
                return
            self._repeating = False
            try:
                self._send_torque(now, ask=False)
            except (LinkError, DriveError) as error:
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

    # What happens each period

    def tick(self) -> Optional[Report]:
        """Do what this period asks for; None before `configure` and after `close`."""
        with self._lock:
            if not self._wanted:
                return None
            if self.line.driver is None and self.line.look():
                self._begin()
            driver, estimate = self.line.driver, None
            if driver is not None:
                try:
                    estimate = self._measure(driver.poll())
                    now = self.clock()
                    self._watch(driver.telemetry, now)
                    self._act(driver, now)
                except (LinkError, DriveError) as error:
                    if self.line.driver is driver:  # else it is known already
                        self._lose(error)
            return self._report(estimate)

    @property
    def expecting(self) -> bool:
        """Tell whether the drive is to answer a question of this period."""
        return self._sensing.expecting and self.line.driver is not None

    def hear(self, patience: float) -> Optional[Report]:
        """
        Wait for what the drive answers, and report it if that is a measurement.

        Parameters
        ----------
        patience : float
            [s]; commands can be given and sent meanwhile.

        """
        driver = self.line.driver
        if driver is None:
            return None
        try:
            if not driver.line.wait(patience):
                return None
            with self._lock:
                if self.line.driver is not driver:
                    return None
                estimate = self._measure(driver.poll())
                return None if estimate is None else self._report(estimate)
        except LinkError as error:
            with self._lock:
                if self.line.driver is driver:
                    self._lose(error)
            return None

    def _report(self, estimate: Optional[Estimate]) -> Report:
        supervisor, driver = self.supervisor, self.line.driver
        return Report(self.clock(), estimate, supervisor.torque,
                      Telemetry() if driver is None else driver.telemetry, self._power,
                      supervisor.e_stop, supervisor.timed_out, supervisor.commanded,
                      driver is not None)

    @property
    def _allowed(self) -> bool:
        return self._active and not self.supervisor.e_stop

    def _obstacle(self) -> str:
        """Return what speaks against releasing the e-stop."""
        driver, now = self.line.driver, self.clock()
        if driver is None:
            return f'the line to the drive is down ({self.line.trouble or "not configured"})'
        if not self._active:
            return 'the bridge is not active; activate it first'
        if now - (driver.telemetry.time or 0.0) > SILENCE:
            return 'the drive does not tell where the motor is'
        if self._power is Power.STOPPING:
            return 'the drive has not confirmed the stop yet'
        if self._sensing.needs_imu(now):
            return ('no IMU is heard, and without one the pendulum angle is a guess; publish imu, '
                    'or set imu_required: false in the hardware file for a level floor')
        return ''

    def _measure(self, telemetry: Telemetry) -> Optional[Estimate]:
        """Take a new measurement, if there is one."""
        try:
            return self._sensing.take(telemetry, self.supervisor.torque)
        except EstimateLostError as error:
            # No policy goes on by itself from here: the next estimate takes rest for granted.
            self.supervisor.trigger(str(error))
            self.notices.add(str(error))
            return None

    def _watch(self, telemetry: Telemetry, now: float) -> None:
        """Notice a drive that fell silent, or let go of the motor by itself."""
        silent = min(self._sensing.silence(now), now - self._armed_at)
        if silent > LOST:
            raise DriveError('silent', f'the drive has not answered for {LOST:g} s')
        if self._power is Power.ON and silent > SILENCE:
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
        elif self._power is Power.ON and (
                self._unsent or self._repeating or now - self._sent_at >= REPEAT * self._period):
            self._repeating = not self._unsent
            self._send_torque(now, ask=True)
            return
        elif self._power is Power.OFF and self._allowed and now >= self._next_arm:
            self._arm(driver)
        if self._power is Power.STOPPING and driver.stopped_since(self._stop_since):
            self._power = Power.OFF
        elif self._power is Power.STOPPING and now - self._stop_sent >= STOP_AGAIN:
            self._stop_sent = now
            self._sensing.ask(now)
            driver.send_stop()
            return
        self._sensing.ask(self.clock())
        driver.ask()

    def _send_torque(self, now: float, ask: bool) -> None:
        assert self.line.driver is not None
        torque = self.supervisor.decide(now, self._sensing.motion(now))
        self._unsent, self._sent_at = False, now
        self._next_torque = max(self._next_torque, now) + self._period
        if ask:
            self._sensing.ask(now)
        self.line.driver.send_torque(self._hardware.joint.motor_torque(torque), ask)

    def _arm(self, driver: Driver) -> None:
        try:
            driver.arm(HANDSHAKE)
        except DriveError as error:
            self._next_arm = self.clock() + ARM_AGAIN
            self.refusal = f'cannot arm: {error}'
            self._went_wrong(self.refusal)
            self._begin_stop()
            return
        self.supervisor.quiet()
        self.refusal = ''
        self._power, self._armed_at = Power.ON, self.clock()
        self.counts['armed'] += 1
        self.notices.add('the motor is under power')

    def _begin_stop(self) -> None:
        """Let the stop be repeated until the drive confirms it."""
        self.supervisor.quiet()
        self._power, self._unsent = Power.STOPPING, False
        self._stop_since = self._stop_sent = self.clock()
        if self.line.driver is not None:
            try:
                self.line.driver.send_stop()
            except LinkError as error:
                self._lose(error)

    def _stop_now(self) -> None:
        """Stop and wait for the confirmation, where there is a drive."""
        if self.line.driver is not None:
            try:
                self.line.driver.stop(LAST_STOP)
            except BallbotError as error:
                self.notices.add(f'the stop was not confirmed: {error}')
        self._power = Power.OFF

    def _begin(self) -> None:
        """Start with a drive that has just answered the handshake, its motor stopped."""
        now = self.clock()
        self._power, self._armed_at = Power.OFF, now
        self._sensing.begin(now)

    def _lose(self, error: BallbotError) -> None:
        """Go on without the drive."""
        if self._power is not Power.OFF:
            self._went_wrong(f'the line was lost: {error}')
        self.supervisor.quiet()
        self._power = Power.OFF
        self.line.lose(error)

    def _went_wrong(self, what: str) -> None:
        """Engage the e-stop, unless the robot may go on by itself."""
        if not self._hardware.limits.rearm:
            self.supervisor.trigger(what)
        self.notices.add(what)
