# SPDX-License-Identifier: Apache-2.0
"""An inertial sensor in software as a serial device, in a thread."""
from pathlib import Path
import threading
import time
from typing import Optional

from ballbot_ros.emulator.terminal import PseudoTerminal
from ballbot_ros.imus.emulated import EmulatedWitMotion

# How long a command may wait to be taken [s].
LISTEN = 0.002


class ImuLine:
    """
    A WitMotion sensor, as it leaves the factory, behind a pseudo-terminal.

    Its y axis is the axle, to the left; x is forward and z up.

    Parameters
    ----------
    link : Path
        Symbolic link to keep pointing to the device.

    Attributes
    ----------
    failure : Exception or None
        What ended the thread, if nobody asked for its end.

    Raises
    ------
    ConfigurationError
        If the link cannot be made.

    """

    def __init__(self, link: Optional[Path] = None):
        """Plug in."""
        self.device, self._terminal = EmulatedWitMotion(), PseudoTerminal(link)
        self.failure: Optional[Exception] = None
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name='imu line', daemon=True)
        self._thread.start()

    @property
    def path(self) -> str:
        """Return where to open it."""
        return self._terminal.path

    def measure(self, turn_rate: float, forward: float, upward: float) -> None:
        """Let it measure this from now on: counter-clockwise positive [rad/s], [m/s2]."""
        self.device.turn_rate, self.device.force = (0.0, -turn_rate, 0.0), (forward, 0.0, upward)

    def stop(self) -> None:
        """Unplug."""
        self._ending.set()
        self._thread.join()
        self._terminal.unplug()

    def _run(self) -> None:
        try:
            while not self._ending.is_set():
                self._terminal.wait(LISTEN)
                heard = self._terminal.read()
                data = self.device.tick(time.monotonic())
                # At another baud rate neither understands the other.
                if self._terminal.baud == self.device.baud:
                    self._terminal.write(data)
                    self.device.receive(heard)
        except Exception as error:  # noqa: BLE001 whatever it is, the owner must know it
            self.failure = error
