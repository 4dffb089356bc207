# SPDX-License-Identifier: Apache-2.0
"""An emulated motor controller on a serial device, in real time, which drives a ball."""
from collections import deque
from concurrent import futures
from dataclasses import replace
import math
from pathlib import Path
from queue import SimpleQueue
import random
from threading import Event, Thread
import time
from typing import Any, Callable, Deque, Optional, Tuple

from ballbot_ros.clock import steady_time
from ballbot_ros.drives import CAN, device_class, driver_class, line_of, SERIAL
from ballbot_ros.drives.emulated_device import Device, DriveSettings
from ballbot_ros.emulator.ball import Ball, PERIOD, settings_for
from ballbot_ros.emulator.line import Direction
from ballbot_ros.emulator.terminal import PseudoTerminal, SlcanAdapter
from ballbot_ros.errors import BallbotError, ConfigurationError
from ballbot_ros.physics.model.state import State
from ballbot_ros.physics.simulation.scene import Scene
from ballbot_ros.plant import ImuSample, Pace
from ballbot_ros.steering import required_steering

# Largest number of periods to catch up in one step.  After a longer pause the ball skips the rest,
# which a bridge detects as a jump of the encoder.
MOST_PERIODS = 200
# The log drops its oldest entries beyond this number.
LONGEST_LOG = 1_000_000
# Shortest sleep: data within this time are handled together [s].
SHORTEST_WAIT = 5e-5


def _sensed_by(device: str) -> Any:
    """Return a property for the measurements of one of two devices."""
    return property(lambda self: getattr(self, device).sensed,
                    lambda self, sensed: setattr(getattr(self, device), 'sensed', sensed))


class BusOfTwo(Device):
    """
    Two devices of a protocol on a bus, as one device with a second output; see `Device`.

    The settings are those of the first; those of the second differ in `axis`.
    """

    def __init__(self, device: type[Device], settings: DriveSettings):
        self.first, self.other = device(settings), device(replace(settings, axis=1))
        self.settings = settings

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of the first device that this class does not have."""
        return getattr(self.__dict__['first'], name)

    sensed, second = _sensed_by('first'), _sensed_by('other')

    @property
    def baud(self) -> float:
        return self.first.baud

    @baud.setter
    def baud(self, baud: float) -> None:
        self.first.baud = self.other.baud = baud

    def torque(self) -> float:
        return self.first.torque()

    def second_torque(self) -> float:
        return self.other.torque()

    def tick(self, now: float) -> None:
        self.first.tick(now)
        self.other.tick(now)

    def receive(self, data: bytes, now: float) -> bytes:
        return self.first.receive(data, now) + self.other.receive(data, now)

    def reboot(self, now: float) -> None:
        self.first.reboot(now)
        self.other.reboot(now)

    def over_current(self) -> None:
        self.first.over_current()

    _receive = receive

    def _boot(self) -> None:
        """Do nothing: each device boots separately."""


def new_device(protocol: str, settings: DriveSettings, steering: bool) -> Device:
    """
    Return an emulated drive, with a second motor if the robot steers.

    Raises `ConfigurationError` for a second motor if replies of the protocol do not identify the
    axis.
    """
    device = device_class(protocol)
    if not steering:
        return device(settings)
    if not driver_class(protocol).shares_line:
        raise ConfigurationError(
            f'an emulated {protocol} has one motor; a second one that steers needs roboclaw, '
            'odrive_can or vesc_can', 'unsupported', 'steering')
    return BusOfTwo(device, settings) if line_of(protocol) is CAN else device(settings)


class Emulator:
    """
    A motor controller on a pseudo-terminal, or on a CAN bus with an slcan adapter as terminal.

    Start it, open `path` as a serial port, stop it; or use it as a context manager.  The model
    runs in a separate thread, so all methods may be called from another one.

    Parameters
    ----------
    protocol : str
        Of the drive; see `drives.DRIVES`.
    scene : Scene
        Robot, ground and start; the robot must have a motor.
    baud : int
        Of the drive; a host with another baud rate receives, and sends, noise.
    settings : DriveSettings, optional
        Those for the motor of the robot if not given.
    link : Path, optional
        Symbolic link that always points to the device.
    seed : int
        Of the random faults.
    steering : bool
        Whether a second motor, with the same gear, leans the pendulum: that on M2 of a RoboClaw,
        or one with a separate drive at the next address of the CAN bus.

    Raises
    ------
    ConfigurationError
        For an unknown protocol or firmware, a robot without a motor, or without the steering
        that is required, or a link that cannot be created.

    """

    def __init__(self, protocol: str, scene: Scene, baud: int = 115200,
                 settings: Optional[DriveSettings] = None, link: Optional[Path] = None,
                 seed: int = 0, steering: bool = False):
        self.settings = settings or settings_for(scene.model.robot)
        self.ball = Ball(scene, self.settings)
        if steering:
            required_steering(scene.model.robot)
        self.steering = steering
        self.device = new_device(protocol, self.settings, steering)
        self.device.baud = baud
        self.device.sensed = self.device.sensed._replace(
            bus_voltage=self.ball.motor.maximum_voltage)
        self.baud = baud
        rng = random.Random(seed)
        self.to_drive, self.from_drive = Direction(baud, rng), Direction(baud, rng)
        self.terminal = (
            PseudoTerminal if line_of(protocol) is SERIAL else SlcanAdapter)(link)
        # Changes of the torque: time of `steady_time` [s], torque at the motor shaft [N m].  The
        # garbage collector does not track plain tuples of numbers: each pass through a long log
        # of other objects would delay the drive beyond its watchdog.
        self.log: Deque[Tuple[float, float]] = deque(maxlen=LONGEST_LOG)
        self.encoder_jump = 0.0  # [rad at the motor shaft]
        self.silent_until = -math.inf  # until then the drive sends nothing [s]
        self.plug_at = math.inf
        self.read_rate = math.inf  # bytes per second that the drive reads
        self.failure: Optional[BallbotError] = None
        self._credit = 0.0
        self._pace = Pace(PERIOD, 1.0, MOST_PERIODS)
        self._replies: Deque[tuple[float, bytes]] = deque()  # send time [s], reply
        self._calls: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self.torque = 0.0  # at the motor shaft now [N m]
        self._running = False
        # Until Python 3.12, a thread whose join() a signal has interrupted counts as ended.
        self._ended = Event()
        self._ended.set()

    # From other threads

    @property
    def path(self) -> str:
        return self.terminal.path

    @property
    def pendulum_torque(self) -> float:
        """Return the torque at the pendulum joint over the last period [N m]."""
        return self.ball.plant.torque

    @property
    def state(self) -> State:
        return self.ball.state

    @property
    def dropped(self) -> int:
        """Return the number of periods of the model skipped because the machine is too slow."""
        return self._pace.dropped

    def imu(self) -> ImuSample:
        return self.ball.imu()

    def start(self) -> 'Emulator':
        """Start the thread and return the emulator."""
        self._running = True
        self._ended.clear()
        Thread(target=self._run, name='emulator', daemon=True).start()
        return self

    def stop(self) -> None:
        """Stop the thread and unplug; stopping twice is allowed."""
        self._running = False
        self._ended.wait()
        self.terminal.unplug()

    def wait(self) -> None:
        """Wait until the emulator has ended; `failure` is the error, if any."""
        self._ended.wait()

    def call(self, function: Callable[[], None]) -> None:
        """Run a function between two steps, and wait for its end; its exception is raised here."""
        if self._ended.is_set() and self.failure is None:
            function()
            return
        result: futures.Future[None] = futures.Future()

        def attempt() -> None:
            try:
                function()
                result.set_result(None)
            except Exception as error:  # noqa: BLE001 the caller raises it
                result.set_exception(error)
        self._calls.put(attempt)
        while not futures.wait([result], 0.1).done:
            if self._ended.is_set():
                raise self.failure or BallbotError('the emulator has ended')
        result.result()

    def __enter__(self) -> 'Emulator':
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.stop()

    # The thread

    def _run(self) -> None:
        try:
            before = steady_time()
            while self._running:
                now = steady_time()
                self._step(now, now - before)
                before = now
                self.terminal.wait(self._pause(now))
        except BallbotError as error:
            self.failure = error
            self.terminal.unplug()
        finally:
            self._ended.set()

    def _pause(self, now: float) -> float:
        """Return the time until the next event [s]."""
        due = min(now + PERIOD, self.to_drive.next_at(), self.from_drive.next_at(),
                  self._replies[0][0] if self._replies else math.inf)
        if self.read_rate < math.inf:
            time.sleep(PERIOD)  # pending data must not wake this thread
        return max(SHORTEST_WAIT, due - now)

    def _step(self, now: float, elapsed: float) -> None:
        self._run_calls()
        if now >= self.plug_at:
            self.plug_at = math.inf
            self.terminal.plug()
        self._advance_ball(now)
        data = self._read(elapsed)
        if self.terminal.plugged:
            # After reading: a host sets its baud rate before it writes.
            garbled = self.terminal.baud not in (None, self.baud)
            self.to_drive.garbled = self.from_drive.garbled = garbled
        self.to_drive.put(data, now)
        self.device.tick(now)
        arrived = self.to_drive.take(now)
        reply = self.device.receive(arrived, now)
        self._log_torque(now)
        if reply and now >= self.silent_until:
            self._replies.append((now + self.device.turnaround, reply))
        while self._replies and self._replies[0][0] <= now:
            self.from_drive.put(self._replies.popleft()[1], now)
        self.terminal.write(self.from_drive.take(now))

    def _read(self, elapsed: float) -> bytes:
        """Return received data, at most those that `read_rate` allows in the elapsed time [s]."""
        if self.read_rate == math.inf:
            return self.terminal.read()
        self._credit = min(self._credit + self.read_rate * elapsed, 4096.0)
        before = self.terminal.received  # an adapter returns more than it reads
        data = self.terminal.read(int(self._credit))
        self._credit -= self.terminal.received - before
        return data

    def _advance_ball(self, now: float) -> None:
        for _ in range(self._pace.due(now)):
            self.ball.advance(
                self.device.torque(), self.device.second_torque() if self.steering else 0.0)
            self.device.sensed = self.ball.sensed(self.device.sensed, self.encoder_jump)
            if self.steering:
                self.device.second = self.ball.lean_sensed(self.device.second)

    def _log_torque(self, now: float) -> None:
        torque = self.device.torque()
        if torque != self.torque:
            self.torque = torque
            self.log.append((now, torque))

    def _run_calls(self) -> None:
        while not self._calls.empty():  # no other thread takes from it
            self._calls.get()()
