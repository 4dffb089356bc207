# SPDX-License-Identifier: Apache-2.0
"""
Compiled kernels of the filter, which runs in each period of the motor loop.

State, covariance and equations are those of `kalman`.  No kernel allocates an array: the caller
passes the output arrays.  From Python, pass ``numbers[:]`` for a `FilterNumbers`: kernels take
plain tuples.
"""
import math
from typing import NamedTuple, Tuple

from ballbot_ros.control.rolling_model import Array, Rolling, rolling_linearised
from ballbot_ros.estimation.imu import turned
from ballbot_ros.jit import compiled

# Order of the state.
PENDULUM, JOINT, PENDULUM_RATE, BALL_RATE, BIAS = range(5)
SIZE = 5

# A longer prediction is divided into several steps [s].
LONGEST_STEP = 0.005
# Stamps closer than this are the same [s].
SAME = 1e-9
# Correlation time of the error of the forward specific force [s].
STRAY_TIME = 0.1

# Whether the force on the support is measured, and its parts along the axes of the shell [m/s2].
Support = Tuple[bool, float, float]
Quad = Tuple[float, float, float, float]
# The numbers of a `FilterNumbers`.
Trust = Tuple[float, float, float, float, float, float, float, float, float, float, float]


class FilterNumbers(NamedTuple):
    """Parameters of robot and tuning, in addition to those of the rolling model."""

    moment: float  # M2 e [kg m]
    radius: float  # [m]
    gravity: float  # [m/s2]
    gyro_variance: float  # [rad2/s2]
    gravity_variance: float  # [m2/s4]
    gravity_gate: float  # [m/s2]
    # Process noise per second: of both rates without an IMU and with one [rad2/s3], and of the
    # bias.
    pendulum: float
    ball: float
    pendulum_with_imu: float
    ball_with_imu: float
    bias: float


@compiled
def take_over(mean: Array, covariance: Array, mean_after: Array, covariance_after: Array) -> None:
    """Copy an estimate into the output arrays."""
    for i in range(SIZE):
        mean_after[i] = mean[i]
        for j in range(SIZE):
            covariance_after[i, j] = covariance[i, j]


@compiled
def moved(column: Quad, step: float, by_pendulum: Quad, by_ball: Quad) -> Quad:
    """Return a small change of the first four states after a step [s]."""
    angle, joint, rate, ball_rate = column
    return (angle + step * rate, joint + step * (rate - ball_rate),
            rate + step * (by_pendulum[0] * angle + by_pendulum[1] * joint
                           + by_pendulum[2] * rate + by_pendulum[3] * ball_rate),
            ball_rate + step * (by_ball[0] * angle + by_ball[1] * joint + by_ball[2] * rate
                                + by_ball[3] * ball_rate))


@compiled
def spread(covariance: Array, step: float, by_pendulum: Quad, by_ball: Quad) -> None:
    """
    Propagate a covariance in place by a step of the linearised motion: F P F^T.

    Parameters
    ----------
    covariance : (5, 5) array
    step : float
        [s]
    by_pendulum, by_ball : tuple of 4 floats
        Derivatives of phi'' and theta1'' by phi, theta2, phi', theta1'.

    """
    for i in range(SIZE):
        (covariance[0, i], covariance[1, i], covariance[2, i], covariance[3, i]) = moved(
            (covariance[0, i], covariance[1, i], covariance[2, i], covariance[3, i]),
            step, by_pendulum, by_ball)
    for i in range(SIZE):
        (covariance[i, 0], covariance[i, 1], covariance[i, 2], covariance[i, 3]) = moved(
            (covariance[i, 0], covariance[i, 1], covariance[i, 2], covariance[i, 3]),
            step, by_pendulum, by_ball)


@compiled
def step_on(mean: Array, covariance: Array, step: float, torque: float, support: Support,
            rolling: Rolling, trust: Trust) -> None:
    """Advance an estimate in place by a step [s]: trapezoidal in the angles, Euler in the rest."""
    own, (known, forward, upward) = FilterNumbers(*trust), support
    angle, joint, rate, ball_rate = mean[0], mean[1], mean[2], mean[3]
    pendulum, ball = rolling_linearised(angle, rate, ball_rate, torque, rolling)
    value, from_angle, from_rate, from_ball_rate = pendulum
    from_joint = 0.0
    if known:  # the force on the support is measured
        inertia, friction = rolling[0], rolling[4]
        # Rotated by minus the joint angle, the force is along and across the pendulum.
        across, along = turned(forward, upward, -joint)
        value = (torque - friction * (rate - ball_rate) - own.moment * across) / inertia
        from_angle, from_joint = 0.0, -own.moment * along / inertia
        from_rate, from_ball_rate = -friction / inertia, friction / inertia
    rate_after, ball_after = rate + step * value, ball_rate + step * ball[0]
    half = 0.5 * step
    mean[0] = angle + half * (rate + rate_after)
    mean[1] = joint + half * (rate + rate_after - ball_rate - ball_after)
    mean[2], mean[3] = rate_after, ball_after
    spread(covariance, step, (from_angle, from_joint, from_rate, from_ball_rate),
           (ball[1], 0.0, ball[2], ball[3]))
    covariance[2, 2] += step * (own.pendulum_with_imu if known else own.pendulum)
    covariance[3, 3] += step * (own.ball_with_imu if known else own.ball)
    covariance[4, 4] += step * own.bias


@compiled
def predicted(before: Tuple[float, Array, Array], stamp: float, torque: float, support: Support,
              numbers: Tuple[Rolling, Trust], mean: Array, covariance: Array) -> float:
    """
    Write the estimate at a later time, and return that time [s]; see `PendulumFilter.predict`.

    Parameters
    ----------
    before : tuple
        Stamp, mean and covariance.
    stamp : float
        [s]
    torque : float
        [N m]
    support : Support
    numbers : tuple
        Of a `RollingNumbers` and a `FilterNumbers`.
    mean : (5,) array
        To write to.
    covariance : (5, 5) array
        To write to.

    """
    now, mean_before, covariance_before = before
    take_over(mean_before, covariance_before, mean, covariance)
    while stamp > now + SAME:
        step = min(stamp - now, LONGEST_STEP)
        step_on(mean, covariance, step, torque, support, numbers[0], numbers[1])
        now += step
    return now


@compiled
def correct(mean: Array, covariance: Array, columns: Tuple[int, int],
            weights: Tuple[float, float], innovation: float, variance: float) -> None:
    """
    Correct an estimate in place by a measurement of a weighted sum of two states.

    Parameters
    ----------
    mean : (5,) array
    covariance : (5, 5) array
    columns : tuple of 2 ints
        Indices of the states.
    weights : tuple of 2 floats
        Of the states in the measurement.
    innovation : float
        Measured less predicted value.
    variance : float
        Of the measurement.

    """
    (one, other), (first, second) = columns, weights
    across = (
        covariance[0, one] * first + covariance[0, other] * second,
        covariance[1, one] * first + covariance[1, other] * second,
        covariance[2, one] * first + covariance[2, other] * second,
        covariance[3, one] * first + covariance[3, other] * second,
        covariance[4, one] * first + covariance[4, other] * second)
    total = across[one] * first + across[other] * second + variance
    for i in range(SIZE):
        gain = across[i] / total
        mean[i] += gain * innovation
        for j in range(SIZE):
            covariance[i, j] -= gain * across[j]


@compiled
def with_joint_angle(before: Tuple[Array, Array], innovation: float, variance: float,
                     mean: Array, covariance: Array) -> None:
    """Write the estimate corrected by an encoder angle; see `PendulumFilter.with_encoder`."""
    take_over(before[0], before[1], mean, covariance)
    correct(mean, covariance, (JOINT, JOINT), (1.0, 0.0), innovation, variance)


@compiled
def with_felt(before: Tuple[Array, Array], felt: Quad, period: float, trust: Trust, mean: Array,
              covariance: Array) -> None:
    """
    Write the estimate corrected by an IMU reading; see `PendulumFilter.with_imu`.

    The reading is a turn rate [rad/s], a forward and an upward specific force [m/s2] and a turn
    acceleration [rad/s2].
    """
    own, (turn_rate, forward, upward, turn_acceleration) = FilterNumbers(*trust), felt
    take_over(before[0], before[1], mean, covariance)
    correct(mean, covariance, (BALL_RATE, BIAS), (1.0, 1.0),
            turn_rate - (mean[BALL_RATE] + mean[BIAS]), own.gyro_variance)
    if abs(math.hypot(forward, upward) - own.gravity) > own.gravity_gate:
        return
    ahead, up = turned(forward, upward, mean[PENDULUM] - mean[JOINT])
    # The error varies slowly: the readings within its correlation time count as one.
    correct(mean, covariance, (PENDULUM, JOINT), (-up, up),
            -own.radius * turn_acceleration - ahead,
            own.gravity_variance * max(1.0, STRAY_TIME / max(period, 1e-6)))
