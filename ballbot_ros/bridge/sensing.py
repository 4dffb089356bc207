# SPDX-License-Identifier: Apache-2.0
"""What a session knows of the robot, and for how long it may be relied on."""
import math
from typing import Optional

from ballbot_ros.bridge.hardware_file import Hardware
from ballbot_ros.bridge.motor_state import SILENCE
from ballbot_ros.bridge.supervisor import PendulumMotion
from ballbot_ros.drives.contract import Telemetry
from ballbot_ros.estimation import Estimate, Fusion
from ballbot_ros.physics.model.robot import Robot


class Sensing:
    """
    Turns what the drive answers into estimates.  All times are of one clock [s].

    Attributes
    ----------
    fusion : Fusion
    expecting : bool
        Whether one was asked for and has not arrived.

    """

    def __init__(self, hardware: Hardware, robot: Robot):
        """Start without a measurement."""
        self._joint = hardware.joint
        self._imu_required = hardware.connection.imu_required
        self._patience = 2.0 / hardware.connection.loop_rate
        self.fusion = Fusion(robot, hardware.imu, hardware.estimate, hardware.joint.encoder_zero)
        self._asked = self._answered = self._waiting_since = 0.0
        self.expecting = False
        self._stamp = -math.inf  # of the last estimate

    def begin(self, now: float) -> None:
        """Begin anew with a drive that has just answered the handshake."""
        self._answered, self.expecting = now, False

    def ask(self, now: float) -> None:
        """Take note that the drive is asked for a measurement."""
        if not self.expecting:
            self._waiting_since = now
        self._asked, self.expecting = now, True

    def restart(self, now: float) -> None:
        """Count silence anew: what was just done has taken its time."""
        self._waiting_since = now

    def silence(self, now: float) -> float:
        """Return how long the drive has owed an answer [s]; without a question it owes none."""
        return now - self._waiting_since if self.expecting else 0.0

    def take(self, telemetry: Telemetry, torque: float) -> Optional[Estimate]:
        """
        Return an estimate from a new measurement, None if there is none in the telemetry.

        Raises as `Fusion.encoder` does.
        """
        if telemetry.position is None or telemetry.time is None \
                or telemetry.time <= self._answered:
            return None
        self._answered, self.expecting = telemetry.time, False
        # The drive looked at its encoder when it was asked, not when the answer was read.
        stamp = self._asked if 0.0 <= telemetry.time - self._asked <= self._patience \
            else telemetry.time
        self._stamp = max(stamp, self._stamp)  # of one that was late and one that was not
        return self.fusion.encoder(
            self._stamp, self._joint.joint_angle(telemetry.position), torque)

    def motion(self, now: float) -> Optional[PendulumMotion]:
        """Return how the robot moves, None where that is not known well enough for torque."""
        estimate = self.fusion.estimate
        if estimate is None or now - self._answered > SILENCE or self.needs_imu(now):
            return None
        readings = estimate.readings
        return PendulumMotion(
            readings.pendulum_angle, readings.pendulum_rate, readings.joint_rate)

    def needs_imu(self, now: float) -> bool:
        """Return whether there must be an IMU, and no reading of one arrives."""
        return self._imu_required and not self.fusion.has_imu(now)
