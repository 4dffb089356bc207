# SPDX-License-Identifier: Apache-2.0
"""An emulated inertial sensor on a pseudo-terminal, in a thread."""
from pathlib import Path
import threading
from typing import Optional

from ballbot_ros.clock import steady_time
from ballbot_ros.emulator.terminal import PseudoTerminal
from ballbot_ros.imus import emulated_class

# Poll period of the terminal [s].
POLL_PERIOD = 0.002


class ImuLine:
    """
    A sensor of `imus.IMUS` with factory defaults on a pseudo-terminal.

    Its y axis is the axle, to the left; x is forward and z up.  `failure` is the error that ended
    the thread.  Raises `ConfigurationError` if the link cannot be created, or there is no
    such sensor.
    """

    def __init__(self, link: Optional[Path] = None, sensor: str = 'witmotion'):
        self.device, self._terminal = emulated_class(sensor)(), PseudoTerminal(link)
        self.failure: Optional[Exception] = None
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name='imu line', daemon=True)
        self._thread.start()

    @property
    def path(self) -> str:
        return self._terminal.path

    def measure(self, turn_rate: float, forward: float, upward: float) -> None:
        """Set the true motion: turn rate counter-clockwise [rad/s], specific force [m/s2]."""
        self.device.turn_rate, self.device.force = (0.0, -turn_rate, 0.0), (forward, 0.0, upward)

    def stop(self) -> None:
        self._ending.set()
        self._thread.join()
        self._terminal.unplug()

    def _run(self) -> None:
        try:
            while not self._ending.is_set():
                self._terminal.wait(POLL_PERIOD)
                received = self._terminal.read()
                data = self.device.tick(steady_time())
                # With another baud rate, neither side receives valid data.
                if self._terminal.baud == self.device.baud:
                    self._terminal.write(data)
                    self.device.receive(received)
        except Exception as error:  # noqa: BLE001 its owner reads it
            self.failure = error
