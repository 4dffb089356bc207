# SPDX-License-Identifier: Apache-2.0
"""What can be counted on when a ball speeds up or brakes, on any slope."""
from ballbot_ros.control.speed_law import (
    acceleration, braking_distance, Numbers, SpeedLaw, steepest_slope, stopping_speed)
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.physics.model.robot import Robot


class Braking:
    """
    Accelerations and distances to be counted on; slopes are positive uphill [rad].

    The tuning says what can be counted on at `largest_lean` on a level floor; the same part of
    the weight of the pendulum is counted on at other angles and on slopes.

    Attributes
    ----------
    steepest : float
        The slope on which an emergency lean still holds the ball [rad].

    """

    def __init__(self, robot: Robot, tuning: DecisionTuning):
        """Work the constants out once."""
        law = SpeedLaw.of(robot, tuning.reaction_time)
        whole = acceleration(tuning.largest_lean, 0.0, law[:])

        def weaker(counted_on: float) -> Numbers:
            part = counted_on / whole
            return law._replace(gravity_torque=part * law.gravity_torque)[:]

        self._faster, self._slower = weaker(tuning.acceleration), weaker(tuning.deceleration)
        self._lean, self._furthest = tuning.largest_lean, tuning.emergency_lean
        self._delay = tuning.actuation_delay
        self.steepest = steepest_slope(tuning.emergency_lean, self._slower)

    def acceleration(self, slope: float) -> float:
        """Return the acceleration to be counted on [m/s2]; none or less on a steep slope."""
        return acceleration(self._lean, slope, self._faster)

    def deceleration(self, slope: float, emergency: bool = False) -> float:
        """Return the deceleration to be counted on [m/s2]; none or less on a steep descent."""
        return -acceleration(-self._lean_of(emergency), slope, self._slower)

    def distance(self, speed: float, slope: float, emergency: bool = False) -> float:
        """
        Return how far the ball rolls on before it stands [m].

        Parameters
        ----------
        speed : float
            Now [m/s]; backwards is at rest.
        slope : float
            Of the ground that it brakes on [rad].
        emergency : bool
            Whether it leans as far as in an emergency.

        Returns
        -------
        float
            Infinite where it does not stop.

        """
        return braking_distance(
            speed, slope, self._lean_of(emergency), self._delay, self._slower)

    def speed_within(self, room: float, slope: float, emergency: bool = False) -> float:
        """Return the speed from which the ball stands within some room [m/s]; see `distance`."""
        return stopping_speed(
            room, slope, self._lean_of(emergency), self._delay, self._slower)

    def _lean_of(self, emergency: bool) -> float:
        return self._furthest if emergency else self._lean
