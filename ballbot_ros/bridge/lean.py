# SPDX-License-Identifier: Apache-2.0
"""
Lateral axis of a steered robot: lean from its encoder, and torque of the steering law.

Tilt and yaw rate are not measured.  An observer computes them with the lateral model and the
measured lean; while there is no set-point it is reset to rest, so that its errors do not
accumulate.
"""
from typing import Callable, NamedTuple, Optional

from ballbot_ros.bridge.hardware_file import Hardware
from ballbot_ros.bridge.sensing import AxisSensing
from ballbot_ros.bridge.supervisor import PendulumMotion
from ballbot_ros.drives.contract import Telemetry
from ballbot_ros.estimation.encoder import EncoderCheck
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.steering import follow, LateralState, law, required_steering, servo_torque
from ballbot_ros.steering.model import accelerations


class LeanEstimate(NamedTuple):
    """Lateral state from encoder and observer; an `AxisEstimate`."""

    stamp: float  # of the measurement [s]
    readings: LateralState
    speed: float  # of the ball [m/s]


class LateralAxis(AxisSensing[LeanEstimate]):
    """
    Converts telemetry of the lateral drive to lateral states, and these to torques; an `AxisLaw`.

    The hardware is that of the lateral axis; `speed` returns the speed of the ball [m/s], or None
    while it is unknown, `yaw_rate` the commanded yaw rate [rad/s], or None without a set-point.
    """

    def __init__(self, hardware: Hardware, robot: Robot, speed: Callable[[], Optional[float]],
                 yaw_rate: Callable[[], Optional[float]]):
        super().__init__(hardware)
        self._robot, self._speed, self._yaw_rate = robot, speed, yaw_rate
        self._limits = required_steering(robot)
        self.rezero()
        self.state = LateralState()
        self.estimate: Optional[LeanEstimate] = None

    def begin(self, now: float) -> None:
        super().begin(now)
        self.rezero()
        self.estimate = None

    def rezero(self) -> None:
        """Use the next reading as zero (hanging pendulum), unless the encoder retains its zero."""
        self._zero, self._check = self._joint.encoder_zero, EncoderCheck()

    def forget(self) -> None:
        """Restart the observer from rest."""
        self.state = self.state._replace(tilt=0.0, tilt_rate=0.0, yaw_rate=0.0)

    def take(self, telemetry: Telemetry) -> Optional[LeanEstimate]:
        """See `AxisSensing`; raises `EstimateLostError` as `EncoderCheck` does."""
        reading = self.new_measurement(telemetry)
        if reading is None:
            return None
        if self._zero is None:
            self._zero = reading.angle
        before, check = self.state, self._check
        self._check = EncoderCheck()
        check = check.after(reading)
        pause, rate, speed = check.pause, reading.rate, self._speed() or 0.0
        lean = reading.angle - self._zero
        if not pause:
            self.state = LateralState(lean, rate or 0.0, heading=before.heading)
        else:
            if rate is None:
                rate = (lean - before.lean) / pause
            speed_before = self.estimate.speed if self.estimate is not None else speed
            acceleration = (speed - speed_before) / pause
            check = check.moved(
                accelerations(self._robot, before, speed, (rate - before.lean_rate) / pause,
                              acceleration).torque,
                self._limits.largest_torque, self._limits.largest_lean_rate)
            self.state = follow(
                self._robot, before, 0.5 * (speed_before + speed), rate, pause,
                acceleration)._replace(lean=lean)
        self._check = check
        self.estimate = LeanEstimate(self.stamp, self.state, speed)
        return self.estimate

    def motion(self, now: float) -> Optional[PendulumMotion]:
        if self.estimate is None or self.is_stale(now) or self._speed() is None:
            return None
        return PendulumMotion(self.state.lean, self.state.lean_rate, self.state.lean_rate)

    def torque(self, readings: LateralState, in_force: float, e_stop: bool) -> float:
        """Return the torque for a new lateral state, 0 without a set-point [N m]."""
        yaw_rate = self._yaw_rate()
        if e_stop or yaw_rate is None:
            self.forget()
            return 0.0
        speed = self._speed() or 0.0
        return servo_torque(
            self._robot, readings, speed, law(self._robot, readings, speed, yaw_rate))
