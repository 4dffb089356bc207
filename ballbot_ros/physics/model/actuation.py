# SPDX-License-Identifier: Apache-2.0
"""Control of the pendulum motor during a simulation: section 4.2 of the paper."""
from dataclasses import dataclass
import math
from numbers import Real
from typing import Any

import numpy as np

from ballbot_ros.config.fields import Checked, flag, quantity, text
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.model.parameters import Actuator, POSITION, TORQUE, VELOCITY, VOLTAGE
from ballbot_ros.physics.model.robot import Robot

LAWS = ('free', 'position', 'velocity', 'voltage', 'torque')
# The law that each set value belongs to; with another law, it would silently do nothing.
SET_VALUES = {'set_angle': 'position', 'set_rate': 'velocity', 'voltage': 'voltage',
              'torque': 'torque'}


def refuse_degrees(where: str, name: str, angle: float) -> None:
    """Raise `ConfigurationError` for an angle [rad] beyond half a turn: one in degrees."""
    if isinstance(angle, Real) and math.pi < abs(angle) < math.inf:
        raise ConfigurationError(
            f'{where}: {name} is in radians, within +-pi, got {angle:g}; '
            f'{angle:g} degrees are math.radians({angle:g})', 'out_of_range', name)


@dataclass(frozen=True, repr=False)
class Actuation(Checked):
    """
    One law of actuation with its set value; gains are the paper's unless given.

    ``free``      no torque, the motor is detached
    ``position``  eq. (11), holds the absolute pendulum angle `set_angle`
    ``velocity``  eq. (12), holds the joint rate `set_rate`; rolling at v it is v / R
    ``voltage``   open-loop voltage on the DC motor of the robot file
    ``torque``    a constant torque
    """

    law: str = text('law of actuation', default='free', choices=LAWS)
    set_angle: float = quantity('rad', 'reference of the absolute pendulum angle', default=0.0,
                                minimum=-math.pi, maximum=math.pi)
    set_rate: float = quantity('rad/s', 'reference of the pendulum joint rate', default=0.0)
    voltage: float = quantity('V', 'voltage on the motor', default=0.0)
    torque: float = quantity('N m', 'constant torque', default=0.0)
    position_kp: float = quantity('N m/rad', 'kP of eq. (11)', default=40.0, minimum=0.0)
    position_kd: float = quantity('N m s/rad', 'kD of eq. (11)', default=10.0, minimum=0.0)
    velocity_kp: float = quantity('N m s/rad', 'kP of eq. (12)', default=10.0, minimum=0.0)
    velocity_ki: float = quantity('N m/rad', 'kI of eq. (12)', default=0.0, minimum=0.0)
    gravity_compensation: bool = flag('add M2 g e sin(angle) to (11) and (12)', default=True)
    torque_limit: float = quantity(
        'N m', 'largest torque; the default is above the torque of any gains',
        default=1e9, above=0.0)

    def __post_init__(self) -> None:
        """Check each value; refuse one that is not of the law, and an angle in degrees."""
        refuse_degrees('Actuation', 'set_angle', self.set_angle)
        super().__post_init__()
        given = [name for name in SET_VALUES if getattr(self, name) != 0.0]
        # One value and no law: forgotten.  Several are settings, of which a law takes its own.
        if self.law == 'free' and len(given) == 1:
            name, value = given[0], getattr(self, given[0])
            raise ConfigurationError(
                f"Actuation: {name} is given without its law, and law 'free' would ignore it; "
                f'write Actuation({SET_VALUES[name]!r}, {name}={value:g})', 'inconsistent', name)

    def actuator(self, robot: Robot, start_time: float = 0.0,
                 start_joint_angle: float = 0.0) -> Actuator:
        """
        Return this actuation, for a robot, as the kernels read it.

        Parameters
        ----------
        robot : Robot
        start_time : float
            When the set-point was given [s].
        start_joint_angle : float
            theta2 at that time [rad]; the integral of eq. (12) counts from there.

        Raises
        ------
        ConfigurationError
            If the robot has no pendulum, or no motor for the voltage law.

        """
        self.check_fits(robot)
        return self.actuators(robot, start_time, start_joint_angle)

    def actuators(self, robot: Robot, start_time: float, start_joint_angle: float) -> Actuator:
        """Return the result of `actuator`, unchecked; with columns if there are any."""
        if self.law == 'free':
            return Actuator()
        gravity = robot.largest_gravity_torque if self.gravity_compensation else 0.0
        if self.law == 'position':
            return Actuator(POSITION, self.set_angle, self.position_kp, self.position_kd,
                            gravity, self.torque_limit)
        if self.law == 'velocity':
            return Actuator(VELOCITY, self.set_rate, self.velocity_kp, self.velocity_ki,
                            gravity, self.torque_limit, start_time, start_joint_angle)
        if self.law == 'torque':
            return Actuator(TORQUE, self.torque, limit=self.torque_limit)
        assert robot.motor is not None  # checked
        return Actuator(
            VOLTAGE, self.voltage, robot.motor.stall_torque_per_volt, robot.motor.back_voltage,
            limit=np.minimum(self.torque_limit, robot.motor.maximum_torque))

    @property
    def start_angle(self) -> float:
        """Return the pendulum angle of an attempt that gives none: the one that is held [rad]."""
        return self.set_angle if self.law == 'position' else 0.0

    def fits(self, robot: Robot) -> Any:
        """Return whether a robot has the parameters of the law; a column if there are any."""
        if self.law == 'free':
            return True
        if self.law != 'voltage' or robot.motor is None:
            return robot.has_pendulum & (self.law != 'voltage')
        return robot.has_pendulum & (abs(self.voltage) <= robot.motor.maximum_voltage)

    def check_fits(self, robot: Robot) -> None:
        """Raise `ConfigurationError` if a robot lacks the parameters of the law."""
        if self.fits(robot):
            return
        if not robot.has_pendulum:
            raise ConfigurationError(
                f'actuation: law {self.law!r} needs a pendulum and robot {robot.name!r} has '
                "none; use 'free'", 'missing', 'law')
        if robot.motor is None:
            raise ConfigurationError(
                f"actuation: law 'voltage' needs a motor and robot {robot.name!r} describes "
                'none; add a motor section to its file', 'missing', 'motor')
        raise ConfigurationError(
            f'actuation: voltage must be within +-{robot.motor.maximum_voltage:g} V of the '
            f'motor of {robot.name!r}, got {self.voltage:g}', 'out_of_range', 'voltage')


def set_rate_for_speed(robot: Robot, speed: float) -> float:
    """Return the joint rate of eq. (12) that rolls the ball at `speed`, v / R [rad/s]."""
    if not math.isfinite(speed):
        raise ConfigurationError(f'speed must be a finite number [m/s], got {speed!r}',
                                 'not_finite', 'speed')
    return speed / robot.ball_radius
