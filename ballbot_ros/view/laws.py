# SPDX-License-Identifier: Apache-2.0
"""User-selected control law and set-point for the motor of a simulated robot."""
from dataclasses import replace
import math
from typing import Any, Mapping, Optional, Tuple

from ballbot_ros.control import JointReadings, load_tuning, Mode, PendulumController, SetPoint
from ballbot_ros.physics.model.actuation import (
    Actuation, Actuator, applied_torque, set_rate_for_speed, TORQUE)
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.state import State

# Law -> unit of its set-point in the page.  All laws but `speed` are those of scene files;
# `speed` is the speed law of the controller, computed once per period.
UNITS: Mapping[str, str] = {
    'free': '', 'speed': 'm/s', 'position': 'deg', 'velocity': 'm/s', 'voltage': 'V',
    'torque': 'N m'}
SET_SPEED_MAX = 1.5  # set speed [m/s]


class MotorLaw:
    """
    A control law of `UNITS` with its set-point in the unit of the law, for one robot.

    The actuation of the scene file, `base`, applies until the user has chosen another law or
    set-point; from then on the motor of the robot file limits the torque.  Raises
    `ConfigurationError` if the robot cannot follow this law.
    """

    def __init__(self, robot: Robot, law: str, set_point: float, base: Actuation,
                 chosen: bool):
        self.robot, self.law, self.set_point, self.base = robot, law, set_point, base
        self.chosen = chosen
        self._controller: Optional[PendulumController] = None
        if law == 'speed':
            self._controller = PendulumController(robot, load_tuning('published'))
        else:
            self._actuation = self._actuation_of(law, set_point) if chosen else base
        self.begin(State())  # refuses a law that the robot cannot follow

    @classmethod
    def of_scene(cls, robot: Robot, actuation: Actuation) -> 'MotorLaw':
        """Return the law of the actuation section of a scene file."""
        value = {'position': math.degrees(actuation.set_angle), 'voltage': actuation.voltage,
                 'velocity': actuation.set_rate * robot.ball_radius,
                 'torque': actuation.torque}.get(actuation.law, 0.0)
        return cls(robot, actuation.law, value, actuation, chosen=False)

    def changed(self, robot: Optional[Robot] = None, law: Optional[str] = None,
                set_point: Optional[float] = None) -> 'MotorLaw':
        """Return a modified copy; another law starts with a set-point of 0."""
        other = law is not None and law != self.law
        value = set_point if set_point is not None else 0.0 if other else self.set_point
        return MotorLaw(robot or self.robot, law or self.law, value, self.base,
                        self.chosen or other or set_point is not None)

    def begin(self, state: State) -> None:
        """Restart the integrals of the law at this state."""
        if self._controller is not None:
            self._controller.reset()
            self._controller.give(SetPoint(Mode.SPEED, self.set_point, state.time))
        else:
            self._actuator = self._actuation.actuator(self.robot, state.time, state.joint_angle)

    @property
    def sampled(self) -> bool:
        """Return whether the torque is computed once per period, from the state at its start."""
        return self._controller is not None

    def actuator(self, state: State) -> Actuator:
        """Return the actuation from this state on."""
        if self._controller is None:
            return self._actuator
        requested = self._controller.torque(JointReadings.of(state))
        # The limits of the motor at the joint rate apply, as in a `Plant`.
        return Actuator(TORQUE, applied_torque(
            requested, state.joint_rate, self.robot.motor_line, 1e9))

    def _actuation_of(self, law: str, value: float) -> Actuation:
        """Return the actuation of a law that the user selected."""
        if law == 'free':
            return Actuation('free')
        given: Any = {
            'position': {'set_angle': math.radians(value)}, 'torque': {'torque': value},
            'velocity': {'set_rate': set_rate_for_speed(self.robot, value)},
            'voltage': {'voltage': value}}[law]
        largest = self.robot.motor.maximum_torque if self.robot.motor else math.inf
        return replace(self.base, law=law, torque_limit=min(self.base.torque_limit, largest),
                       **given)


def laws_of(robot: Robot) -> Tuple[str, ...]:
    """Return the laws that a robot can follow."""
    if not robot.has_pendulum:
        return ('free',)
    return tuple(law for law in UNITS if law != 'voltage' or robot.motor is not None)


def bounds_of(robot: Robot, law: str) -> Tuple[float, float]:
    """Return the set-point range of a law other than ``free``, in the unit of the law."""
    motor = robot.motor
    if law in ('speed', 'velocity'):
        largest = SET_SPEED_MAX
    elif law == 'position':
        largest = 180.0
    elif law == 'voltage' and motor is not None:
        largest = motor.maximum_voltage
    else:
        largest = motor.maximum_torque if motor else 2.0 * robot.largest_gravity_torque
    return -largest, largest
