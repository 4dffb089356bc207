# SPDX-License-Identifier: Apache-2.0
"""Guaranteed acceleration and deceleration of a ball, on any slope."""
import math

from ballbot_ros.control import ControlTuning
from ballbot_ros.control.speed_law import (
    acceleration, braking_distance, Numbers, SpeedLaw, steepest_slope, stopping_speed)
from ballbot_ros.decision.planning.curve import bisected
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.physics.model.robot import Robot


class Braking:
    """
    Guaranteed accelerations and distances; slopes are positive uphill [rad].

    The tuning has the values at `largest_lean` on a level floor; the same fraction of
    the gravity torque of the pendulum is assumed at other angles and on slopes.

    Attributes
    ----------
    steepest : float
        Steepest slope on which the emergency lean holds the ball [rad].

    """

    def __init__(self, robot: Robot, tuning: DecisionTuning, control: ControlTuning):
        law = SpeedLaw.tuned(robot, control)
        nominal = acceleration(tuning.largest_lean, 0.0, law[:])

        def weaker(guaranteed: float) -> Numbers:
            fraction = guaranteed / nominal
            return law._replace(gravity_torque=fraction * law.gravity_torque)[:]

        self._faster, self._slower = weaker(tuning.acceleration), weaker(tuning.deceleration)
        self._expected = law._replace(speed_gain=math.inf)[:]
        self._gain = law.speed_gain
        self._lean, self._furthest = tuning.largest_lean, tuning.emergency_lean
        self._delay = tuning.dead_time
        self.steepest = steepest_slope(tuning.emergency_lean, self._slower)

    def acceleration(self, slope: float) -> float:
        """Return the guaranteed acceleration [m/s2]; 0 or negative on a steep slope."""
        return acceleration(self._lean, slope, self._faster)

    def deceleration(self, slope: float) -> float:
        """Return the guaranteed deceleration [m/s2]; 0 or negative on a steep descent."""
        return -acceleration(-self._lean, slope, self._slower)

    def distance(self, speed: float, slope: float, emergency: bool = False) -> float:
        """
        Return the stopping distance from a speed [m]; infinite if the ball does not stop.

        A ball that rolls backwards counts as at rest; `emergency` selects the emergency lean.
        """
        lean = self._furthest if emergency else self._lean
        return braking_distance(speed, slope, lean, self._delay, self._slower)

    def expected_distance(self, speed: float, slope: float) -> float:
        """Return the emergency stopping distance of the nominal robot; see `distance`."""
        return braking_distance(speed, slope, self._furthest, self._delay, self._expected)

    def speed_within(self, room: float, slope: float) -> float:
        """Return the speed from which the emergency lean stops the ball within `room` [m/s]."""
        return stopping_speed(room, slope, self._furthest, self._delay, self._slower)

    def touch_speed(self, speed: float, set_speed: float, room: float, slope: float) -> float:
        """
        Return the speed after a distance `room` [m] under `speed_law_step` [m/s].

        While the speed error requires more than the guaranteed acceleration, the latter applies;
        then the error decays as exp(-speed_gain t).  A backward speed counts as rest.
        """
        faster = set_speed > speed
        most = self.acceleration(slope) if faster else self.deceleration(slope)
        speed, sign = max(0.0, speed), 1.0 if faster else -1.0
        if not (room > 0.0 and most > 0.0):
            return speed
        eased = set_speed - sign * most / self._gain
        if sign * (eased - speed) > 0.0:
            travelled = abs(eased * eased - speed * speed) / (2.0 * most)
            if travelled >= room:
                return math.sqrt(max(0.0, speed * speed + sign * 2.0 * most * room))
            speed, room = eased, room - travelled

        def is_before(later: float) -> bool:
            # x = (u - v) / gain + set_speed / gain log((set_speed - u) / (set_speed - v))
            rest = (set_speed - speed) / (set_speed - later) if later != set_speed else math.inf
            return (speed - later) + set_speed * math.log(rest) < room * self._gain
        return bisected(is_before, set_speed, speed, 20)
