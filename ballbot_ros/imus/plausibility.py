# SPDX-License-Identifier: Apache-2.0
"""
Plausibility of an inertial sensor in the shell: it measures, in SI units, in the axes as mounted.

Three checks, each with a limit that no motion of the robot exceeds:

* Readings have noise, so consecutive identical readings are not measurements.  If the joint angle
  is known, they count only while it changes: a simulated sensor may have no noise.
* The specific force stays near gravity, except for impacts, falls and bounces.
  A force in multiples of g, or with gravity removed, does not.
* Gyro, gravity and joint give the same angles.  The angle of the shell by the gyro, which gravity
  slowly corrects, is that of the specific force, within a quarter turn: with a gyro that is
  reversed, saturated, frozen or in deg/s, or with exchanged axes, the difference grows as the ball
  rolls.  The angle of the shell plus that of the joint is that of the pendulum, which its limits
  keep within a range: with an IMU upside down, or a frozen or reversed encoder, the sum leaves
  that range.  Both detect a fault at any speed.  An impact or a fall may turn the pendulum over:
  the sum restarts.
"""
import math
from typing import NamedTuple, Optional, Tuple

# Identical readings over a longer time are not measurements [s].
LONGEST_REPETITION = 0.25
# Change of the joint angle beyond which the joint, and the shell with it, has moved [rad].
JOINT_MOTION = 0.1
# Range of the specific force, in multiples of gravity, and the longest time outside it [s]: a drop
# from 1 m with its bounces takes less than 1 s.
LOWEST_FORCE, HIGHEST_FORCE = 0.5, 2.0
LONGEST_OUTSIDE = 1.5
# Time constant with which gravity corrects the angle of the shell [s]: a gyro error of 0.36 rad/s,
# which is 3 % of 12 rad/s, amounts to 1.4 rad.
DRIFT_TIME = 4.0
# Largest angle between the specific force and gravity by the gyro [rad], and the longest time of a
# larger one, of an impact [s].
LARGEST_TILT = 0.5 * math.pi
LONGEST_IMPACT = 0.1
# After a longer pause between readings, the angle of the shell restarts [s].
LONGEST_PAUSE = 0.1


class ImuPlausibility(NamedTuple):
    """State of the checks after a reading; `after` returns the next state."""

    # Reason code of the check that failed last: ``'imu_frozen'``, ``'imu_gravity'`` or
    # ``'imu_turn_rate'``; empty while all hold.
    fault: str = ''
    stamp: float = -math.inf
    values: Tuple[float, ...] = ()  # of the last reading
    repeated_since: float = math.inf  # [s]
    joint_then: float = 0.0  # joint angle at the start of the repetition [rad]
    outside_since: float = math.inf  # since when the force is out of its range [s]
    joint_angle: Optional[float] = None  # with the last reading [rad]
    shell: float = 0.0  # angle by the gyro, corrected by gravity [rad]
    start: Optional[float] = None  # sum of the angles of shell and joint at the restart [rad]
    tilted_since: float = math.inf  # since when force and gyro contradict each other [s]

    def after(self, stamp: float, turn_rate: float, forward: float, upward: float,
              gravity: float, joint_angle: Optional[float] = None,
              largest_swing: float = 4.0) -> 'ImuPlausibility':
        """
        Return the state after a reading at a stamp, not before the last one [s].

        The turn rate is that of the shell, counter-clockwise positive [rad/s]; `forward` and
        `upward` are the specific force in the plane of motion, like gravity [m/s2].  The joint
        angle is that of the pendulum against the shell, counter-clockwise positive, from any zero
        that does not jump [rad]; None if it is unknown, or its zero has moved.
        `largest_swing` is the range of the pendulum angle: twice its limit, plus the possible
        overshoot [rad].
        """
        values = (turn_rate, forward, upward)
        repeated, then = self.repeated_since, self.joint_then
        if values != self.values:
            repeated, then = math.inf, 0.0
        elif repeated == math.inf:
            repeated, then = self.stamp, self.joint_angle or 0.0
        frozen = stamp - repeated > LONGEST_REPETITION and (
            joint_angle is None or abs(joint_angle - then) > JOINT_MOTION)
        inside = LOWEST_FORCE * gravity <= math.hypot(forward, upward) <= HIGHEST_FORCE * gravity
        outside = math.inf if inside else min(self.outside_since, stamp)
        pause, vertical = stamp - self.stamp, math.atan2(forward, upward)
        shell, start, swing, tilted = vertical, None, 0.0, math.inf
        if pause <= LONGEST_PAUSE:
            shell = self.shell + turn_rate * pause
            if inside:
                error = math.remainder(vertical - shell, math.tau)
                shell += pause / DRIFT_TIME * error
                tilted = min(self.tilted_since, stamp) if abs(error) > LARGEST_TILT else math.inf
        if inside and joint_angle is not None:
            start = shell + joint_angle
            if self.start is not None and pause <= LONGEST_PAUSE:
                start, swing = self.start, start - self.start
        fault = ''
        if frozen:
            fault = 'imu_frozen'
        elif stamp - outside > LONGEST_OUTSIDE:
            fault = 'imu_gravity'
        elif stamp - tilted > LONGEST_IMPACT or abs(swing) > largest_swing:
            fault, start = 'imu_turn_rate', None  # the zero of the encoder may have moved
        return ImuPlausibility(fault, stamp, values, repeated, then, outside, joint_angle,
                               shell, start, tilted)


# Text and remedy of each fault.
EXPLANATIONS = {
    'imu_frozen': (
        f'the IMU has repeated the same reading for more than {LONGEST_REPETITION:g} s: it does '
        'not measure; check its supply and its driver'),
    'imu_gravity': (
        f'the specific force of the IMU has been below {LOWEST_FORCE:g} g or above '
        f'{HIGHEST_FORCE:g} g for more than {LONGEST_OUTSIDE:g} s: it must be in m/s2, with '
        'gravity included (the raw topic of its driver)'),
    'imu_turn_rate': (
        'the turn rate of the IMU contradicts its specific force or the encoder: it must be in '
        'rad/s, with the axes forward, left, up; check the unit, the range and the mounting of '
        'the IMU, and the direction of the joint'),
}
