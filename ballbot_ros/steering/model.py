# SPDX-License-Identifier: Apache-2.0
"""
Lateral motion of a ball whose pendulum leans sideways; the derivation is in docs/steering.md.

The frame has x along the heading, horizontal, z upwards.  Angles are positive to the left: lean of
the pendulum in the ball, tilt of the axle (left end down), swing = lean - tilt of the pendulum
relative to the vertical, and yaw.
"""
import math
from typing import NamedTuple, Tuple

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.model.robot import Robot, Steering

BANDWIDTH = 20.0  # of the position control of the lateral axis, critically damped [rad/s]
LARGEST_STEP = 0.01  # of the integration [s]
# Range of the model: the axle is not vertical, and turns by less than 0.5 rad in a step.
TILT_MAX, RATE_MAX = 0.5 * math.pi, 0.5 / LARGEST_STEP


class LateralState(NamedTuple):
    """Lateral state of a ball on its path."""

    lean: float = 0.0  # of the pendulum in the ball [rad]
    lean_rate: float = 0.0  # [rad/s]
    tilt: float = 0.0  # of the axle [rad]
    tilt_rate: float = 0.0  # [rad/s]
    yaw_rate: float = 0.0  # of axle and pendulum about the vertical [rad/s]
    heading: float = 0.0  # horizontal direction of travel at zero tilt rate [rad]


def moved_to(place: Tuple[float, float], heading: float, ahead: float,
             left: float = 0.0) -> Tuple[float, float]:
    """Return the position at given distances ahead and to the left of another [m]."""
    return (place[0] + ahead * math.cos(heading) - left * math.sin(heading),
            place[1] + ahead * math.sin(heading) + left * math.cos(heading))


class GroundTrack(NamedTuple):
    """Pose of a ball that turns, in the frame of its start; `after` returns the next."""

    x: float = 0.0  # [m]
    y: float = 0.0  # [m]
    path: float = 0.0  # position of the odometry there [m]
    lateral: LateralState = LateralState()

    def after(self, path: float, lateral: LateralState, radius: float) -> 'GroundTrack':
        """Return the pose at a later path length [m] and lateral state, by the midpoint rule."""
        return GroundTrack(
            *moved_to((self.x, self.y), 0.5 * (self.lateral.heading + lateral.heading),
                      path - self.path, radius * (lateral.tilt - self.lateral.tilt)),
            path, lateral)

    @property
    def pose(self) -> Tuple[float, float, float]:
        """Return x, y and heading [m], [rad]."""
        return self.x, self.y, self.lateral.heading


class Accelerations(NamedTuple):
    """Result of the equations of motion for an acceleration of the lean."""

    tilt: float  # [rad/s2]
    yaw: float  # [rad/s2]
    torque: float  # of the lateral axis, on the pendulum [N m]


def required_steering(robot: Robot) -> Steering:
    """
    Return the section ``steering`` of a robot.

    Raises `ConfigurationError` for a robot that drives straight.
    """
    if robot.steering is None or not robot.has_pendulum:
        raise ConfigurationError(
            f'robot {robot.name!r} drives straight: its file has no section steering '
            '(largest_lean, largest_lean_rate, largest_torque)', 'missing', 'steering')
    return robot.steering


def accelerations(robot: Robot, state: LateralState, speed: float,
                  lean_acceleration: float, acceleration: float = 0.0) -> Accelerations:
    """
    Return tilt and yaw accelerations and the torque of the lateral axis, eqs. (S1) to (S3).

    `speed` is that of the ball along the heading [m/s], `acceleration` its derivative [m/s2];
    `lean_acceleration` is in rad/s2.
    """
    ball, pendulum, radius = robot.ball_inertia, robot.pendulum_inertia, robot.ball_radius
    first = robot.pendulum_moment
    second = first * robot.pendulum_length
    swing, rolling, yaw_rate = state.lean - state.tilt, speed / radius, state.yaw_rate
    swing_rate = state.lean_rate - state.tilt_rate
    sine, cosine = math.sin(swing), math.cos(swing)
    coupling = first * radius * cosine
    # Moments about the contact point, along the heading.
    rolled = ball + robot.total_mass * radius**2 - coupling
    swung = pendulum + second - coupling
    moment = (first * robot.gravity * sine + first * radius * sine * swing_rate**2
              + yaw_rate**2 * sine * (first * radius - second * cosine)
              - rolled * rolling * yaw_rate - robot.rolling_friction * state.tilt_rate)
    tilt = (moment + swung * lean_acceleration) / (rolled + swung)
    # Moments about the vertical through the centre.
    inertia = ball + pendulum + second * sine**2
    yaw = (ball * (rolling * state.tilt_rate / math.cos(state.tilt)**2
                   + acceleration / radius * math.tan(state.tilt))
           - 2.0 * second * sine * cosine * swing_rate * yaw_rate
           + first * sine * (acceleration - radius * yaw_rate * state.tilt_rate)) / inertia
    # Moments on the pendulum about the centre, along the heading.
    torque = ((pendulum + second) * (lean_acceleration - tilt)
              + first * cosine * (radius * tilt + speed * yaw_rate)
              + first * robot.gravity * sine - second * yaw_rate**2 * sine * cosine)
    return Accelerations(tilt, yaw, torque)


def step(robot: Robot, state: LateralState, speed: float, command: float, dt: float,
         acceleration: float = 0.0) -> LateralState:
    """
    Return the state a time later, with the lean following its set-point within the limits.

    The lateral axis holds its set-point by position control; rate and torque are limited.

    Parameters
    ----------
    speed : float
        Speed of the ball along the heading, in the middle of `dt` [m/s].
    command : float
        Set-point of the lean, see `law`; limited to the largest lean [rad].
    dt : float
        [s]
    acceleration : float, optional
        Mean derivative of the speed, by which a turning ball keeps its angular momentum [m/s2].

    Raises
    ------
    ConfigurationError
        If the robot has no steering.

    """
    limits = required_steering(robot)
    target = min(max(command, -limits.largest_lean), limits.largest_lean)
    count = max(1, math.ceil(dt / LARGEST_STEP))
    h = dt / count
    for _ in range(count):
        lean_rate = state.lean_rate + h * lateral_acceleration(
            robot, state, speed, servo_torque(robot, state, speed, target))
        state = follow(robot, state, speed, lean_rate, h, acceleration)
    return state


def follow(robot: Robot, state: LateralState, speed: float, lean_rate: float, dt: float,
           acceleration: float = 0.0) -> LateralState:
    """
    Return the state a short time later, with a given final rate of the lean.

    Parameters as in `step`; `lean_rate` is the final rate [rad/s].  Outside the model range,
    tilt and yaw restart from rest, with the heading from before.
    """
    lean_acceleration = (lean_rate - state.lean_rate) / dt
    # Midpoint rule; the lean rate is linear over the step.
    mean = 0.5 * (state.lean_rate + lean_rate)
    slope = accelerations(robot, state, speed, lean_acceleration, acceleration)
    middle = _moved(state, slope, mean, lean_acceleration, state, 0.5 * dt)
    slope = accelerations(robot, middle, speed, lean_acceleration, acceleration)
    moved = _moved(middle, slope, mean, lean_acceleration, state, dt)
    if abs(moved.tilt) < TILT_MAX and abs(moved.tilt_rate) < RATE_MAX \
            and abs(moved.yaw_rate) < RATE_MAX:
        return moved
    return LateralState(moved.lean, moved.lean_rate, heading=state.heading)


def pull(robot: Robot, state: LateralState, speed: float, torque: float, dt: float,
         acceleration: float = 0.0) -> LateralState:
    """
    Return the state a short time later, under a torque of the lateral axis [N m].

    Parameters as in `step`.
    """
    lean_acceleration = lateral_acceleration(robot, state, speed, torque)
    return follow(robot, state, speed, state.lean_rate + dt * lean_acceleration, dt, acceleration)


def _moved(rates: LateralState, slope: Accelerations, mean_lean_rate: float,
           lean_acceleration: float, start: LateralState, h: float) -> LateralState:
    """Return `start` advanced by a time with given rates."""
    return LateralState(
        start.lean + h * mean_lean_rate, start.lean_rate + h * lean_acceleration,
        start.tilt + h * rates.tilt_rate, start.tilt_rate + h * slope.tilt,
        start.yaw_rate + h * slope.yaw, start.heading + h * rates.yaw_rate)


def servo_torque(robot: Robot, state: LateralState, speed: float, target: float) -> float:
    """Return the torque of the position control of the lean, within the limits [N m]."""
    limits = required_steering(robot)
    largest = limits.largest_lean_rate
    wanted = min(max(0.5 * BANDWIDTH * (target - state.lean), -largest), largest)
    torque = accelerations(
        robot, state, speed, 2.0 * BANDWIDTH * (wanted - state.lean_rate)).torque
    return min(max(torque, -limits.largest_torque), limits.largest_torque)


def lateral_acceleration(robot: Robot, state: LateralState, speed: float, torque: float) -> float:
    """Return the acceleration of the lean under a torque, which is linear in it [rad/s2]."""
    # The inertia depends on the swing only; with large rates, rounding errors would hide it.
    still = LateralState(lean=state.lean - state.tilt)
    inertia = accelerations(robot, still, 0.0, 1.0).torque - accelerations(
        robot, still, 0.0, 0.0).torque
    return (torque - accelerations(robot, state, speed, 0.0).torque) / inertia


def lateral_speed(robot: Robot, state: LateralState) -> float:
    """Return the speed of the ball to the left of its heading, R tilt_rate [m/s]."""
    return robot.ball_radius * state.tilt_rate
