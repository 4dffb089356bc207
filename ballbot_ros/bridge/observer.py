# SPDX-License-Identifier: Apache-2.0
"""The interface for the events of a session; `black_box.ring` implements it."""
from enum import IntEnum
from typing import Optional

from ballbot_ros.bridge.motor_state import MotorState
from ballbot_ros.bridge.supervisor import Supervisor
from ballbot_ros.control import SetPoint
from ballbot_ros.drives.contract import Telemetry
from ballbot_ros.errors import MessageError
from ballbot_ros.estimation import Estimate, ImuReading


class Level(IntEnum):
    """Level of an event: a log line, a change of state, or a fault, which triggers a dump."""

    LOG = 0
    EVENT = 1
    FAULT = 2


class SessionObserver:
    """Receives the events of a session, from any thread; this base class ignores them."""

    def period(self, now: float, estimate: Optional[Estimate], supervisor: Supervisor,
               telemetry: Telemetry, state: MotorState) -> None:
        """Receive the result of a period of the loop."""

    def command(self, torque: float, stamp: float) -> None:
        """Receive a torque command [N m]."""

    def set_point(self, given: SetPoint) -> None:
        """Receive a set-point."""

    def imu(self, reading: ImuReading) -> None:
        """Receive an IMU reading."""

    def record(self, direction: str, data: bytes) -> None:
        """Receive traffic of the link, as `drives.capture.Recorder` does."""

    def event(self, text: str, level: Level = Level.EVENT) -> None:
        """Receive an event."""

    def refused(self, what: str, error: MessageError) -> None:
        """Receive a refused message with the reason."""
