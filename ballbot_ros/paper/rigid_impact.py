# SPDX-License-Identifier: Apache-2.0
"""
Rigid impacts with restitution and friction, and the motion between them.

The collision model of the Tumbleweed rovers: that of Kane and Levinson [35] as used by Hartl [34]
and others, in textbook form.  A rigid ball without moving parts (a pendulum counts as mass that
does not rotate) meets a step.  Its centre stays on or above a line: the floor raised by R, and the
arc of radius R about the edge.

*Impact.*  The velocity towards the line is reversed and multiplied by the coefficient of
restitution e.  The tangential impulse is the one that stops the slip s, -M kappa / (1 + kappa) s,
limited by friction to mu M (1 + e) |v_n|.

*Ride.*  On the line the ball rolls, or slides with full friction: an ordinary differential
equation along the line.  It lifts off where the line would have to pull.

*Flight.*  A parabola, until it meets the line again.

A bounce slower than `BOUNCE_SPEED_MIN` is suppressed, because an infinite sequence of bounces
cannot be simulated.
"""
import math
from typing import Optional

from ballbot_ros.crossing.attempt import RETREAT
from ballbot_ros.crossing.rules import touch_distance
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.studies.comparators import bisect, check, highest_passed, inertia_ratio

BOUNCE_SPEED_MIN = 0.005  # [m/s]; a flight that starts with it lasts 1 ms
FLIGHT_STEP = 5e-4  # time between checks of a flight, less than the shortest flight [s]
RIDE_STEP = 5e-4  # of the integration along the line [s]
CROSSING_TIME_MAX = 5.0  # after which a ball that is neither over nor back has failed [s]
TOUCH_ROUNDING = 1e-12  # penetration by rounding that is not a touch [m]

FLYING, FLOOR, EDGE = range(3)


def impact_with_restitution(robot: Robot, speed: float, restitution: Optional[float] = None,
                            tolerance: float = 1e-5) -> float:
    """
    Return the maximum step height of a rigid ball at a collision speed [m/s], to a tolerance [m].

    The restitution, from 0 to 1, is by default that of the robot's contact spring and damper.
    Valid for a shell so stiff that the impact ends before the ball has moved; a bounce takes no
    time.
    """
    check(robot, speed)
    bounce = robot.restitution if restitution is None else restitution
    return highest_passed(lambda height: RigidBall(robot, speed, height, bounce).passes(),
                          robot, speed, tolerance)


class RigidBall:
    """A ball that has rolled up to a step with its face at x = 0, in side view."""

    def __init__(self, robot: Robot, speed: float, height: float, restitution: float):
        """Start where the ball on the floor touches the edge."""
        self.robot, self.height, self.restitution = robot, height, restitution
        self.radius, self.kappa = robot.ball_radius, inertia_ratio(robot)
        self.reach = touch_distance(self.radius, height)
        self.x, self.y, self.velocity_x, self.velocity_y = -self.reach, self.radius, speed, 0.0
        self.rim_speed = speed  # R times the rate, positive rolling forward [m/s]
        self.on = FLOOR

    def passes(self) -> bool:
        """Run until the ball is over or back, or the time is up; return whether it is over."""
        self.touch(EDGE)
        for _ in range(round(CROSSING_TIME_MAX / min(FLIGHT_STEP, RIDE_STEP))):
            if self.on == FLYING:
                self.fly()
            else:
                self.ride()
            if self.x > 0.0:
                return True
            if self.x < -self.reach - RETREAT and self.velocity_x < 0.0:
                return False
        return False

    def lean(self) -> float:
        """Return the angle of the line's normal from the vertical, positive backwards [rad]."""
        return math.atan2(-self.x, self.y - self.height) if self.on == EDGE else 0.0

    def friction(self) -> float:
        """Return the coefficient of friction below the ball."""
        return self.robot.edge_friction if self.on == EDGE else self.robot.surface_friction

    def along(self, lean: float) -> float:
        """Return the speed along the line [m/s]."""
        return self.velocity_x * math.cos(lean) + self.velocity_y * math.sin(lean)

    def touch(self, what: int) -> None:
        """Apply an impact to the velocities; continue along the line, or bounce."""
        self.on = what
        lean = self.lean()
        sine, cosine = math.sin(lean), math.cos(lean)
        inward = max(self.velocity_x * sine - self.velocity_y * cosine, 0.0)
        bounce = self.restitution * inward
        if bounce < BOUNCE_SPEED_MIN:
            bounce = 0.0
        along = self.rub(self.along(lean), self.friction() * (inward + bounce))
        self.velocity_x = along * cosine - bounce * sine
        self.velocity_y = along * sine + bounce * cosine
        if bounce > 0.0:
            self.on = FLYING

    def rub(self, along: float, most: float) -> float:
        """
        Stop the slip by a tangential impulse and return the new speed along the line [m/s].

        `along` is the speed of the centre, `most` the maximum impulse of friction per mass, both
        [m/s].
        """
        wanted = self.kappa / (1.0 + self.kappa) * (self.rim_speed - along)
        given = min(max(wanted, -most), most)
        self.rim_speed -= given / self.kappa
        return along + given

    def ride(self) -> None:
        """
        Advance along the line by `RIDE_STEP`, or lift off where the line would have to pull.

        Half of the distance, all forces, the other half: second order.  Friction that can stop the
        slip of the step keeps a rolling ball rolling.
        """
        curvature = 1.0 / self.radius if self.on == EDGE else 0.0
        lean, gravity = self.lean(), self.robot.gravity
        along = self.along(lean)
        lean -= 0.5 * RIDE_STEP * along * curvature
        press = gravity * math.cos(lean) - curvature * along * along
        if press <= 0.0:
            self.on = FLYING
            return
        self.x += 0.5 * RIDE_STEP * along  # valid on the floor; overwritten on the edge
        along = self.rub(along - RIDE_STEP * gravity * math.sin(lean),
                         RIDE_STEP * self.friction() * press)
        self.x += 0.5 * RIDE_STEP * along
        lean -= 0.5 * RIDE_STEP * along * curvature
        self.velocity_x, self.velocity_y = along * math.cos(lean), along * math.sin(lean)
        if self.on == EDGE:
            self.x = -self.radius * math.sin(lean)
            self.y = self.height + self.radius * math.cos(lean)
            if self.y < self.radius:
                self.x, self.y = -self.reach, self.radius
                self.touch(FLOOR)
        elif self.x > -self.reach:
            self.x = -self.reach
            self.touch(EDGE)

    def fly(self) -> None:
        """Fly for `FLIGHT_STEP`, or until a touch."""
        begin = self.x, self.y, self.velocity_y

        def place(time: float) -> float:
            """Set the state at a flight time [s]; return the distance from the line [m]."""
            self.x = begin[0] + self.velocity_x * time
            self.y = begin[1] + (begin[2] - 0.5 * self.robot.gravity * time) * time
            self.velocity_y = begin[2] - self.robot.gravity * time
            return min(self.y, math.hypot(self.x, self.y - self.height)) - self.radius

        if place(FLIGHT_STEP) < -TOUCH_ROUNDING and self.x <= 0.0:
            place(bisect(lambda time: place(time) >= -TOUCH_ROUNDING, FLIGHT_STEP, 0.0, 1e-9))
            away = math.hypot(self.x, self.y - self.height)
            self.touch(FLOOR if self.y < away else EDGE)
