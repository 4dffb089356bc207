# SPDX-License-Identifier: Apache-2.0
"""Robot, ground and motor as the compiled kernels read them; all SI."""
import math
from typing import NamedTuple

from ballbot_ros.jit import row_reader
from ballbot_ros.physics.model.robot import ContactOptions, Robot
from ballbot_ros.physics.model.terrain import Array

# Laws of actuation, for Actuator.law.
FREE, POSITION, VELOCITY, VOLTAGE, TORQUE = range(5)


class Parameters(NamedTuple):
    """A robot and its contact law."""

    mass: float  # M1 + M2
    pendulum_moment: float  # M2 e
    ball_inertia: float  # J1
    swing_inertia: float  # J2 + M2 e^2 M1 / M; 0 where there is no pendulum
    pendulum_inertia: float  # J2 + M2 e^2
    rolling_friction: float
    joint_friction: float
    radius: float
    stiffness: float
    damping: float
    slip_threshold: float
    gravity: float
    pulling: float  # switches are 0.0 or 1.0
    smooth_friction: float
    radius_lever: float
    dissipation: float  # k lambda, of Hunt and Crossley [N s/m2]
    law: float  # number of the law in `robot.CONTACT_LAWS`

    @classmethod
    def of(cls, robot: Robot, options: ContactOptions) -> 'Parameters':
        """Return the parameters of a robot; columns of columns."""
        # No power: of a number and of a column, its last digit may differ.
        own = robot.pendulum_mass * (robot.pendulum_length * robot.pendulum_length)
        return cls(
            robot.total_mass, robot.pendulum_mass * robot.pendulum_length, robot.ball_inertia,
            robot.pendulum_inertia + own * robot.ball_mass / robot.total_mass,
            robot.pendulum_inertia + own, robot.rolling_friction, robot.joint_friction,
            robot.ball_radius, robot.contact_stiffness, robot.contact_damping,
            robot.slip_threshold, robot.gravity, float(options.pulling),
            float(options.friction_ramp == 'smooth'), float(options.slip_lever == 'radius'),
            robot.contact_dissipation * robot.contact_stiffness, robot.law_number)


class Actuator(NamedTuple):
    """The pendulum motor and its law; see `Actuation.actuator` for making one."""

    law: int = FREE
    set_value: float = 0.0  # rad, rad/s, V or N m, as the law asks
    kp: float = 0.0  # VOLTAGE: stall torque per volt [N m/V]
    kd_or_ki: float = 0.0  # VOLTAGE: back voltage [V s/rad]
    gravity_torque: float = 0.0  # M2 g e where compensated
    limit: float = math.inf  # of the torque [N m]
    start_time: float = 0.0  # of the set-point, for the integral of eq. (12)
    start_joint_angle: float = 0.0


# Kernels that read the parameters of a robot, or a law, from a row of numbers.
read_parameters, read_actuator = row_reader(Parameters), row_reader(Actuator)


class System(NamedTuple):
    """All that the equations of motion depend on, beside time and state."""

    parameters: Parameters
    ground: Array  # (n, 7), see `Terrain.profile`
    actuator: Actuator
