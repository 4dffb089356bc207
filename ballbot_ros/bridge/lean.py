# SPDX-License-Identifier: Apache-2.0
"""
The lateral axis of a robot that steers: lean from its encoder, and the torque of the laws.

Tilt and yaw rate are not measured.  An observer, the lateral model under the measured lean,
computes them; it starts from rest with each set-point after an idle time, so that its errors do
not accumulate.
"""
import math
from typing import Callable, List, NamedTuple, Optional, Tuple

from ballbot_ros.bridge.hardware_file import Hardware
from ballbot_ros.bridge.sensing import AxisSensing, LONGEST_PAUSE
from ballbot_ros.bridge.supervisor import PendulumMotion
from ballbot_ros.drives.contract import Telemetry
from ballbot_ros.errors import EstimateLostError
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.steering import (
    follow, lateral_acceleration, LateralState, law, required_steering, servo_torque)

# Comparison of the lean with the torque: time constant [s], and part of the largest torque from
# which it applies, more than weight and friction oppose at rest.
SMOOTHING, LEAST_PART = 0.1, 0.5


class LeanReadings(NamedTuple):
    """Lateral state by the encoder and the observer, and the speed of the ball [m/s]."""

    state: LateralState
    speed: float


class LeanEstimate(NamedTuple):
    """Readings and the time at which the drive measured them [s]."""

    stamp: float
    readings: LeanReadings


class GroundTrack(NamedTuple):
    """Pose of a ball that turns, in the frame of its start; `after` returns the next."""

    x: float = 0.0  # [m]
    y: float = 0.0  # [m]
    path: float = 0.0  # position of the odometry there [m]
    lateral: LateralState = LateralState()

    def after(self, path: float, lateral: LateralState, radius: float) -> 'GroundTrack':
        """Return the pose at a later path length [m] and lateral state, by the midpoint rule."""
        heading = 0.5 * (self.lateral.heading + lateral.heading)
        forward, left = path - self.path, radius * (lateral.tilt - self.lateral.tilt)
        return GroundTrack(self.x + forward * math.cos(heading) - left * math.sin(heading),
                           self.y + forward * math.sin(heading) + left * math.cos(heading),
                           path, lateral)

    @property
    def pose(self) -> Tuple[float, float, float]:
        """Return x, y and heading [m], [rad]."""
        return self.x, self.y, self.lateral.heading


class LeanSensing(AxisSensing):
    """
    Converts telemetry of the lateral drive to lateral states.

    Parameters
    ----------
    hardware : Hardware
        Of the lateral axis.
    robot : Robot
    speed : callable
        Returns the speed of the ball [m/s]; None while unknown.

    """

    def __init__(self, hardware: Hardware, robot: Robot, speed: Callable[[], Optional[float]]):
        super().__init__(hardware)
        self._robot, self._speed = robot, speed
        self._limits = required_steering(robot)
        self._zero = hardware.joint.encoder_zero
        self._given_zero = self._zero
        self._difference = 0.0  # of the lean rate from that by the torque, smoothed [rad/s]
        self._latency = 0.0  # longest one of late, between a stamp and its reply [s]
        # Time and torque of each command that may act after the last measurement [s], [N m].
        self._torques: List[Tuple[float, float]] = [(-math.inf, 0.0)]
        self.state = LateralState()
        self.estimate: Optional[LeanEstimate] = None

    def begin(self, now: float) -> None:
        """Restart with a drive after its handshake."""
        super().begin(now)
        self.rezero()
        self.estimate = None

    def rezero(self) -> None:
        """Assume that the pendulum hangs straight now, unless the encoder retains its zero."""
        self._zero, self._difference = self._given_zero, 0.0

    def forget(self) -> None:
        """Restart the observer from rest."""
        self.state = self.state._replace(tilt=0.0, tilt_rate=0.0, yaw_rate=0.0)

    def commanded(self, torque: float, now: float) -> None:
        """Record a torque before it is sent [N m]."""
        self._torques.append((now, torque))

    def take(self, telemetry: Telemetry, torque: float) -> Optional[LeanEstimate]:
        """Return an estimate from a new measurement, None if there is none in the telemetry."""
        before, measured = self.stamp, self.new_measurement(telemetry)
        if measured is None:
            return None
        angle, rate = measured
        pause, latency = self.stamp - before, self._answered - self.stamp
        # The drive executes commands and requests in the order of their transmission.
        torques = [torque for _, torque in self._torques]
        self._torques = [
            sent for sent, later in zip(self._torques, self._torques[1:])
            if later[0] > self.stamp] + self._torques[-1:]
        if self._zero is None:
            self._zero = angle
        lean, speed = angle - self._zero, self._speed() or 0.0
        if not 0.0 < pause <= LONGEST_PAUSE:
            self.state = LateralState(lean, rate or 0.0, heading=self.state.heading)
        else:
            if rate is None:
                rate = (lean - self.state.lean) / pause
            self._check_torque(rate - self.state.lean_rate, speed, torques, pause, latency)
            before_it = self.estimate.readings.speed if self.estimate is not None else speed
            self.state = follow(
                self._robot, self.state, 0.5 * (before_it + speed), rate, pause,
                (speed - before_it) / pause)._replace(lean=lean)
        self.estimate = LeanEstimate(self.stamp, LeanReadings(self.state, speed))
        return self.estimate

    def _check_torque(self, change: float, speed: float, torques: List[float], pause: float,
                      latency: float) -> None:
        """
        Raise `EstimateLostError` if a large torque does not accelerate the lean.

        Each torque that was commanded since the last measurement may have acted for the whole
        pause, and each measurement may be later than its stamp by the latency of the reply.
        """
        keep = max(0.0, 1.0 - pause / SMOOTHING)
        self._difference *= keep
        self._latency = max(latency, keep * self._latency)
        least, largest = min(torques), max(torques)
        if max(least, -largest) < LEAST_PART * self._limits.largest_torque:
            return
        low, high = (lateral_acceleration(self._robot, self.state, speed, torque)
                     for torque in (least, largest))
        self._difference += change - min(max(change, pause * low), pause * high)
        late = self._latency * max(abs(low), abs(high))
        if abs(self._difference) > self._limits.largest_lean_rate + late:
            self._difference = 0.0
            raise EstimateLostError(
                'the lean does not follow the torque of the lateral axis: its encoder is frozen '
                'or reversed, or the axis is blocked; check the section steering of the '
                'hardware file')

    def motion(self, now: float) -> Optional[PendulumMotion]:
        """Return the motion of the lateral axis, None if it is too old for torque."""
        if self.estimate is None or self.is_stale(now) or self._speed() is None:
            return None
        return PendulumMotion(self.state.lean, self.state.lean_rate, self.state.lean_rate)


class LeanLaw:
    """
    Computes the torque of the lateral axis; an `AxisLaw`.

    Parameters
    ----------
    robot : Robot
    yaw_rate : callable
        Returns the commanded yaw rate [rad/s]; None without a set-point.
    forget : callable
        Restarts the observer.

    """

    def __init__(self, robot: Robot, yaw_rate: Callable[[], Optional[float]],
                 forget: Callable[[], None]):
        self._robot, self._yaw_rate, self.forget = robot, yaw_rate, forget

    def answer(self, readings: LeanReadings, in_force: float, e_stop: bool) -> float:
        """Return the torque for a lateral state, 0 without a set-point [N m]."""
        yaw_rate = self._yaw_rate()
        if e_stop or yaw_rate is None:
            self.forget()
            return 0.0
        state, speed = readings
        return servo_torque(
            self._robot, state, speed, law(self._robot, state, speed, yaw_rate))
