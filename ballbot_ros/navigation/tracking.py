# SPDX-License-Identifier: Apache-2.0
"""
Path following: speed and yaw rate that keep the ball on a path within its curvature limit.

The law is that of a unicycle with feedforward curvature and feedback of cross-track and heading
error, with both poles at one distance (Kanayama et al., 1990).  A path may be travelled backward;
its errors then refer to the direction of travel.
"""
import math
from typing import NamedTuple, Sequence, Tuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.floors.floor import Point
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.steering import curvature_limit

# Distance constant of both poles of the errors: minimum [m], and increase per speed [s].
SETTLING_DISTANCE, SETTLING_TIME = 0.35, 1.2
# The lean responds with a delay: the feedforward looks ahead by this time [s].
LEAN_LEAD = 0.6
# Steering of a crossing stops before the edge: distance [m], plus time at the current speed [s].
EDGE_DISTANCE, EDGE_TIME = 0.3, 0.8
# Speed is reduced this far before a turn, and kept this far behind it [m].
SLOWDOWN_BEFORE, SLOWDOWN_BEHIND = 0.2, 0.1
# Deceleration towards the end of a path [m/s2], and time constant of the last part [s].
DECELERATION, LAST_TIME_CONSTANT = 0.15, 0.7
# Fraction of the curvature limit that a path may use: the rest is for feedback, and for robots in
# the range that turn less than the nominal one.
CURVATURE_FRACTION = 0.9


class Path(NamedTuple):
    """
    A path with its direction of travel.

    Attributes
    ----------
    points : (n, 2) array
        [m]
    along : (n,) array
        Path length up to each point [m].
    courses : (n,) array
        Direction of travel, unwrapped [rad].
    curvatures : (n,) array
        Derivative of the direction of travel with respect to length [1/m].
    direction : int
        1 forward, -1 backward.

    """

    points: NDArray[np.float64]
    along: NDArray[np.float64]
    courses: NDArray[np.float64]
    curvatures: NDArray[np.float64]
    direction: int

    @classmethod
    def of(cls, points: Sequence[Point], direction: int) -> 'Path':
        """Return the path through at least two points."""
        array = np.array(points, float)
        array = array[np.concatenate([[True], np.hypot(*np.diff(array, axis=0).T) > 1e-6])]
        steps = np.diff(array, axis=0)
        lengths = np.hypot(*steps.T)
        courses = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
        # The course of each step applies at its midpoint.
        along = np.concatenate([[0.0], np.cumsum(lengths)])
        middles = 0.5 * (along[1:] + along[:-1])
        at_points = np.interp(along, middles, courses)
        curvatures = np.gradient(at_points, along) if len(along) > 2 else np.zeros(len(along))
        return cls(array, along, at_points, curvatures, direction)

    @property
    def length(self) -> float:
        """Return the length [m]."""
        return float(self.along[-1])

    def project(self, x: float, y: float, since: float) -> Tuple[float, float]:
        """
        Return the path length at the projection of a position, and its offset to the left [m].

        Only the part from 0.1 m before the length `since` to 0.5 m beyond it is considered.
        """
        end = len(self.along) - 1
        first = min(max(0, int(np.searchsorted(self.along, since - 0.1)) - 1), end - 1)
        last = min(end, int(np.searchsorted(self.along, since + 0.5)))
        one, two = self.points[first:last], self.points[first + 1:last + 1]
        step = two - one
        lengths = np.hypot(*step.T)
        share = np.clip(((x - one[:, 0]) * step[:, 0] + (y - one[:, 1]) * step[:, 1])
                        / lengths**2, 0.0, 1.0)
        if last == end:
            # The last step extends beyond the end.
            share[-1] = max(share[-1], float(
                ((x, y) - one[-1]) @ step[-1] / lengths[-1]**2))
        foot = one + share[:, None] * step
        best = int(np.argmin(np.hypot(x - foot[:, 0], y - foot[:, 1])))
        left = (step[best, 0] * (y - foot[best, 1])
                - step[best, 1] * (x - foot[best, 0])) / lengths[best]
        return float(self.along[first + best] + share[best] * lengths[best]), float(left)


def steered(left: float, turned: float, run_up: float, speed: float
            ) -> Tuple[float, float, float]:
    """
    Return the point of a straight run-up at which steering ends, and the errors of the ball there.

    Parameters
    ----------
    left, turned : float
        Errors at the start of the run-up: to the left of the path [m], and of the heading [rad].
    run_up : float
        [m]
    speed : float
        Speed at the end of the run-up [m/s].

    Returns
    -------
    (float, float, float)
        Distance from the start [m], and errors as above, for the poles of `Tracker` and the delay
        of the lean.

    """
    settling = max(SETTLING_DISTANCE, SETTLING_TIME * speed)
    steered_length = max(0.0, run_up - EDGE_DISTANCE - (EDGE_TIME + LEAN_LEAD) * speed)
    rate = left / settling + math.tan(turned)
    decayed = math.exp(-steered_length / settling)
    return steered_length, (left + rate * steered_length) * decayed, math.atan(
        (math.tan(turned) - rate * steered_length / settling) * decayed)


class Tracker:
    """
    Computes speed and yaw rate on a path.

    Parameters
    ----------
    robot : Robot
        A robot with steering.
    cruise_speed : float
        [m/s]

    """

    def __init__(self, robot: Robot, cruise_speed: float):
        self._speeds = np.linspace(0.05, max(cruise_speed, 1.2), 24)
        self._limits = np.array([curvature_limit(robot, speed) for speed in self._speeds])
        self._cruise = cruise_speed

    def follow(self, path: Path, along: float, left: float, heading: float, speed: float,
               top_speed: float) -> Tuple[float, float]:
        """
        Return speed along the heading [m/s] and yaw rate [rad/s].

        Parameters
        ----------
        path : Path
        along, left : float
            See `Path.project`.
        heading : float
            [rad]
        speed : float
            Measured speed along the heading [m/s].
        top_speed : float
            [m/s]

        """
        ahead = path.along >= along - SLOWDOWN_BEHIND
        # Braking ends before a turn starts.
        room = np.maximum(path.along[ahead] - along - SLOWDOWN_BEFORE, 0.0)
        # The speeds at which the curvatures are within the limit.
        turns = np.interp(-np.abs(path.curvatures[ahead]), -CURVATURE_FRACTION * self._limits,
                          self._speeds)
        remaining = max(path.length - along, 0.0)
        lost = DECELERATION * LAST_TIME_CONSTANT
        wanted = min(top_speed, self._cruise,
                     float(np.sqrt(turns**2 + 2.0 * DECELERATION * room).min(initial=math.inf)),
                     2.0 * DECELERATION * remaining
                     / (math.sqrt(lost * lost + 2.0 * DECELERATION * remaining) + lost))
        return path.direction * wanted, self.yaw_rate(path, along, left, heading, speed)

    def yaw_rate(self, path: Path, along: float, left: float, heading: float, speed: float
                 ) -> float:
        """Return the yaw rate that returns the ball to the path [rad/s]; see `follow`."""
        settling = max(SETTLING_DISTANCE, SETTLING_TIME * abs(speed))
        course = heading if path.direction > 0 else heading + math.pi
        error = math.remainder(course - float(np.interp(along, path.along, path.courses)),
                               2.0 * math.pi)
        # The ball may roll back on its path.
        progress = speed * path.direction
        feedforward = float(np.interp(along + LEAN_LEAD * progress, path.along, path.curvatures))
        curvature = math.copysign(1.0, progress) * (feedforward - left / settling**2) \
            - 2.0 * math.sin(error) / settling
        limit = float(np.interp(abs(speed), self._speeds, self._limits))
        return abs(speed) * min(max(curvature, -limit), limit)
