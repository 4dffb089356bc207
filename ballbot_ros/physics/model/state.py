# SPDX-License-Identifier: Apache-2.0
"""
The state of the ball as a value, its energies and contacts, and the order of its vector.

All angles are counter-clockwise positive; see `mechanics.equations` for a figure.
"""
from typing import NamedTuple

# Indices of a state vector: coordinates, rates, then energies transferred since the start.
(BALL_ANGLE, PENDULUM_ANGLE, X, Y, BALL_RATE, PENDULUM_RATE, VELOCITY_X, VELOCITY_Y,
 CONTACT_LOSS, FRICTION_LOSS, ROLLING_LOSS, JOINT_LOSS, MOTOR_WORK) = range(13)
SIZE = 13
COORDINATES = 4


class State(NamedTuple):
    """
    All state variables; see `mechanics.equations` for a figure of the angles.

    The last five are energies transferred since the start [J].
    """

    time: float = 0.0
    ball_angle: float = 0.0  # theta1 [rad]
    pendulum_angle: float = 0.0  # absolute, theta1 + theta2 [rad]
    x: float = 0.0  # of the ball centre [m]
    y: float = 0.0
    ball_rate: float = 0.0  # [rad/s]
    pendulum_rate: float = 0.0
    velocity_x: float = 0.0  # [m/s]
    velocity_y: float = 0.0
    contact_loss: float = 0.0  # dissipated by the contact dampers
    friction_loss: float = 0.0  # by friction in the contacts
    rolling_loss: float = 0.0  # by rolling friction c1
    joint_loss: float = 0.0  # by friction c2 of the pendulum joint
    motor_work: float = 0.0  # done by the motor

    @property
    def joint_angle(self) -> float:
        """Return theta2, the pendulum angle relative to the ball [rad]."""
        return self.pendulum_angle - self.ball_angle

    @property
    def joint_rate(self) -> float:
        """Return the rate of theta2 [rad/s]."""
        return self.pendulum_rate - self.ball_rate

    @property
    def dissipated_energy(self) -> float:
        """Return the energy dissipated by dampers and friction [J]."""
        return self.contact_loss + self.friction_loss + self.rolling_loss + self.joint_loss


class Touch(NamedTuple):
    """One contact with the ground, for output and messages."""

    kind: int  # SURFACE, EDGE or CORNER of `contact`
    x: float  # contact point on the ground [m]
    y: float
    normal_x: float
    normal_y: float
    penetration: float  # [m]
    normal_force: float  # [N]
    friction_force: float  # along (normal_y, -normal_x) [N]
    slip_velocity: float  # [m/s]


def force_components(normal: float, friction: float, normal_x: float,
                     normal_y: float) -> tuple[float, float]:
    """
    Return the components x and y of a contact force [N].

    Normal force and friction are in N, as in `Touch`; the normal is a unit vector.
    """
    return normal * normal_x + friction * normal_y, normal * normal_y - friction * normal_x


class Energies(NamedTuple):
    """The energy of a state [J]."""

    kinetic: float
    potential: float
    contact: float  # stored in the contact springs

    @property
    def total(self) -> float:
        """Return the sum [J]."""
        return self.kinetic + self.potential + self.contact
