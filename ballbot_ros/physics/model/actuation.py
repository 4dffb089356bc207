# SPDX-License-Identifier: Apache-2.0
"""
The pendulum motor: its laws of actuation, section 4.2 of the paper, its torque, and its limits.

The simulator's own actuation and the controller node call the same functions: laws (11), (12) and
the DC motor.  All angles are counter-clockwise positive; ``pendulum_angle`` is absolute (theta1 +
theta2, 0 hanging down, positive towards +x), ``joint_rate`` is theta2', relative to the ball.
"""
from dataclasses import dataclass
import math
from numbers import Real
from typing import Any, NamedTuple

import numpy as np

from ballbot_ros.config.fields import Checked, flag, quantity, text
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.jit import compiled
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.state import (
    BALL_ANGLE, BALL_RATE, PENDULUM_ANGLE, PENDULUM_RATE)
from ballbot_ros.physics.model.terrain import Array

# Laws of actuation, for Actuator.law.
FREE, POSITION, VELOCITY, VOLTAGE, TORQUE = range(5)
LAWS = ('free', 'position', 'velocity', 'voltage', 'torque')
# The law that uses each set value; with another law, the value would have no effect.
SET_VALUES = {'set_angle': 'position', 'set_rate': 'velocity', 'voltage': 'voltage',
              'torque': 'torque'}


def refuse_degrees(where: str, name: str, angle: float) -> None:
    """Raise `ConfigurationError` for an angle beyond +-pi rad, which must be in degrees."""
    if isinstance(angle, Real) and math.pi < abs(angle) < math.inf:
        raise ConfigurationError(
            f'{where}: {name} is in radians, within +-pi, got {angle:g}; '
            f'{angle:g} degrees are math.radians({angle:g})', 'out_of_range', name)


class Actuator(NamedTuple):
    """The pendulum motor and its law, as returned by `Actuation.actuator`."""

    law: int = FREE
    set_value: float = 0.0  # rad, rad/s, V or N m, depending on the law
    kp: float = 0.0  # VOLTAGE: stall torque per volt [N m/V]
    kd_or_ki: float = 0.0  # VOLTAGE: back voltage [V s/rad]
    gravity_torque: float = 0.0  # M2 g e where compensated
    limit: float = math.inf  # of the torque [N m]
    start_time: float = 0.0  # of the set-point, for the integral of eq. (12)
    start_joint_angle: float = 0.0


@dataclass(frozen=True, repr=False)
class Actuation(Checked):
    """
    One law of actuation with its set value; gains are the paper's unless given.

    ``free``      no torque, the motor is detached
    ``position``  eq. (11), holds the absolute pendulum angle `set_angle`
    ``velocity``  eq. (12), holds the joint rate `set_rate`, which is v / R when rolling at v
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
        """Check each value; refuse a set value without its law, and an angle in degrees."""
        refuse_degrees('Actuation', 'set_angle', self.set_angle)
        super().__post_init__()
        given = [name for name in SET_VALUES if getattr(self, name) != 0.0]
        # One value: the law was forgotten.  Several are settings, of which a law uses its own.
        if self.law == 'free' and len(given) == 1:
            name, value = given[0], getattr(self, given[0])
            raise ConfigurationError(
                f"Actuation: {name} is given without its law, and law 'free' would ignore it; "
                f'write Actuation({SET_VALUES[name]!r}, {name}={value:g})', 'inconsistent', name)

    def actuator(self, robot: Robot, start_time: float = 0.0,
                 start_joint_angle: float = 0.0) -> Actuator:
        """
        Return this actuation, for a robot, as the kernels read it.

        `start_time` [s] and `start_joint_angle`, theta2 [rad], are those at which the integral of
        eq. (12) starts.  Raises `ConfigurationError` if the robot has no pendulum, or no motor for
        the voltage law.
        """
        self.check_fits(robot)
        return self.actuators(robot, start_time, start_joint_angle)

    def actuators(self, robot: Robot, start_time: float, start_joint_angle: float) -> Actuator:
        """Return the result of `actuator` without checks; the robot may have columns."""
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
        """Return the default pendulum angle of an attempt: the held angle, else 0 [rad]."""
        return self.set_angle if self.law == 'position' else 0.0

    def fits(self, robot: Robot) -> Any:
        """Return whether a robot has the parameters of the law; a column for columns."""
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
    if not np.all(np.isfinite(speed)):
        raise ConfigurationError(f'speed must be a finite number [m/s], got {speed!r}',
                                 'not_finite', 'speed')
    return speed / robot.ball_radius


@compiled
def position_torque(pendulum_angle: float, pendulum_rate: float, set_angle: float,
                    kp: float, kd: float, gravity_torque: float) -> float:
    """
    Return the torque of the position law, eq. (11) [N m].

    Parameters
    ----------
    pendulum_angle, pendulum_rate : float
        Absolute angle [rad] and rate [rad/s].
    set_angle : float
        Reference of the absolute angle [rad].
    kp, kd : float
        Gains [N m/rad], [N m s/rad]; 40 and 10 in the paper.
    gravity_torque : float
        M2 g e [N m], or 0 for no gravity compensation.

    """
    return (position_feedback(pendulum_angle, pendulum_rate, set_angle, kp, kd)
            + gravity_torque * math.sin(pendulum_angle))


@compiled
def position_feedback(pendulum_angle: float, pendulum_rate: float, set_angle: float, kp: float,
                      kd: float) -> float:
    """Return the result of `position_torque` without gravity compensation [N m]."""
    return kp * (set_angle - pendulum_angle) - kd * pendulum_rate


@compiled
def velocity_torque(pendulum_angle: float, joint_rate: float, joint_lag: float,
                    set_rate: float, kp: float, ki: float, gravity_torque: float) -> float:
    """
    Return the torque of the velocity law, eq. (12) [N m].

    Parameters
    ----------
    pendulum_angle : float
        Absolute angle [rad], for gravity compensation.
    joint_rate : float
        theta2', rate of the joint [rad/s]; v / R when rolling forward at v.
    joint_lag : float
        Integral of the rate error since the set-point was given [rad]; the paper's
        ``set_rate * t - theta2``.
    set_rate : float
        Reference of theta2' [rad/s].
    kp, ki : float
        Gains [N m s/rad], [N m/rad]; 10 and 0 in the paper.
    gravity_torque : float
        M2 g e [N m], or 0 for no gravity compensation.

    """
    return (velocity_feedback(joint_rate, joint_lag, set_rate, kp, ki)
            + gravity_torque * math.sin(pendulum_angle))


@compiled
def velocity_feedback(joint_rate: float, joint_lag: float, set_rate: float, kp: float,
                      ki: float) -> float:
    """Return the result of `velocity_torque` without gravity compensation [N m]."""
    return kp * (set_rate - joint_rate) + ki * joint_lag


@compiled
def motor_torque(voltage: float, joint_rate: float, stall_torque_per_volt: float,
                 back_voltage: float) -> float:
    """
    Return the torque of a DC motor and gear at the joint [N m].

    Parameters
    ----------
    voltage : float
        Armature voltage [V].
    joint_rate : float
        theta2' [rad/s].
    stall_torque_per_volt : float
        gear_ratio gear_efficiency torque_constant / resistance [N m/V].
    back_voltage : float
        gear_ratio speed_constant [V s/rad].

    """
    return stall_torque_per_volt * (voltage - back_voltage * joint_rate)


@compiled
def applied_torque(requested: float, joint_rate: float, line: tuple[float, float, float, float],
                   limit: float) -> float:
    """
    Return the torque at the joint for the requested torque of a control law [N m].

    It is limited by the speed-torque lines of the motor at minus and plus its supply voltage, then
    by the limit of the drive.  More torque is available against the rotation than along it, as the
    back voltage then adds to the supply; beyond the no-load speed even full voltage brakes.

    Parameters
    ----------
    requested : float
        [N m]
    joint_rate : float
        theta2' [rad/s].
    line : tuple of 4 floats
        See `Robot.motor_line`.
    limit : float
        [N m]

    """
    stall_torque_per_volt, back_voltage, supply, maximum_torque = line
    lowest = limited(motor_torque(
        -supply, joint_rate, stall_torque_per_volt, back_voltage), maximum_torque)
    highest = limited(motor_torque(
        supply, joint_rate, stall_torque_per_volt, back_voltage), maximum_torque)
    return limited(min(max(requested, lowest), highest), limit)


@compiled
def limited(torque: float, limit: float) -> float:
    """Return `torque` clipped to [-limit, limit]."""
    return min(max(torque, -limit), limit)


@compiled
def unsaturated_torque(time: float, state: Array, actuator: Actuator) -> float:
    """Return the torque tau2 of the law, without the limit [N m]."""
    sine = math.sin(state[PENDULUM_ANGLE]) if actuator.gravity_torque != 0.0 else 0.0
    return torque_asked(time, state, sine, actuator)


@compiled
def torque_asked(time: float, state: Array, sine: float, actuator: Actuator) -> float:
    """Return the result of `unsaturated_torque` for a known sine of the pendulum angle."""
    joint_rate = state[PENDULUM_RATE] - state[BALL_RATE]
    if actuator.law == POSITION:
        return actuator.gravity_torque * sine + position_feedback(
            state[PENDULUM_ANGLE], state[PENDULUM_RATE], actuator.set_value, actuator.kp,
            actuator.kd_or_ki)
    if actuator.law == VELOCITY:
        travel = state[PENDULUM_ANGLE] - state[BALL_ANGLE] - actuator.start_joint_angle
        lag = actuator.set_value * (time - actuator.start_time) - travel
        return actuator.gravity_torque * sine + velocity_feedback(
            joint_rate, lag, actuator.set_value, actuator.kp, actuator.kd_or_ki)
    if actuator.law == VOLTAGE:
        return motor_torque(actuator.set_value, joint_rate, actuator.kp, actuator.kd_or_ki)
    if actuator.law == TORQUE:
        return actuator.set_value
    return 0.0


@compiled
def torque_slopes(actuator: Actuator) -> tuple[float, float, float, float, float]:
    """
    Return the constant derivatives of `unsaturated_torque` without gravity compensation.

    They are by ball angle, pendulum angle, ball rate, pendulum rate and time.
    """
    if actuator.law == POSITION:
        return 0.0, -actuator.kp, 0.0, -actuator.kd_or_ki, 0.0
    if actuator.law == VELOCITY:
        # The lag grows with the ball angle and shrinks with the pendulum angle.
        return (actuator.kd_or_ki, -actuator.kd_or_ki, actuator.kp, -actuator.kp,
                actuator.kd_or_ki * actuator.set_value)
    if actuator.law == VOLTAGE:
        back = actuator.kp * actuator.kd_or_ki
        return 0.0, 0.0, back, -back, 0.0
    return 0.0, 0.0, 0.0, 0.0, 0.0


@compiled
def actuator_torque(time: float, state: Array, actuator: Actuator) -> float:
    """Return the torque tau2 of the pendulum motor, within its limit [N m]."""
    return limited(unsaturated_torque(time, state, actuator), actuator.limit)
