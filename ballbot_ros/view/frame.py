# SPDX-License-Identifier: Apache-2.0
"""State of a robot at one time; unknown values are None."""
from dataclasses import dataclass
from typing import Any, NamedTuple, Optional, Tuple

from ballbot_ros.physics.model.state import force_components


class ContactForce(NamedTuple):
    """A ground contact force, in the plane of the model."""

    x: float  # point of action [m]
    y: float
    force_x: float  # sum of normal force and friction [N]
    force_y: float
    penetration: float  # [m]

    @classmethod
    def of(cls, contact: Any) -> 'ContactForce':
        """Return the force of a `Touch` of the model, or of a message Contact."""
        return cls(contact.x, contact.y, *force_components(
            contact.normal_force, contact.friction_force, contact.normal_x, contact.normal_y),
            contact.penetration)


class EnergyShares(NamedTuple):
    """Present energies by kind, and losses and motor work since the start [J]."""

    kinetic: Optional[float] = None
    potential: Optional[float] = None
    contact: Optional[float] = None  # stored in the contact springs
    dissipated: Optional[float] = None  # dissipated by dampers and friction
    motor_work: Optional[float] = None  # supplied by the motor


@dataclass(frozen=True)
class DecisionSign:
    """The obstacle decision, with the values that it provides."""

    kind: str  # values of `decision.Kind` and `decision.Reason`
    reason: str
    explanation: str = ''  # one sentence, may be empty
    height: Optional[float] = None  # of the step ahead [m]
    distance: Optional[float] = None  # from the centre of the ball to its face [m]
    speed: Optional[float] = None  # expected or required touch speed [m/s]
    # Difference between the maximum step height and the height [m]; negative if too high.
    margin: Optional[float] = None
    probability: Optional[float] = None  # success probability


@dataclass(frozen=True)
class Frame:
    """The robot at one time; SI units, angles and signs as in docs/model.md."""

    time: float  # on the clock of the source [s]
    x: Optional[float] = None  # centre of the ball [m]
    y: Optional[float] = None
    ball_angle: Optional[float] = None  # theta1, and the absolute angle of the pendulum [rad]
    pendulum_angle: Optional[float] = None
    velocity_x: Optional[float] = None  # of the centre [m/s]
    velocity_y: Optional[float] = None
    ball_rate: Optional[float] = None  # absolute [rad/s]
    pendulum_rate: Optional[float] = None
    pendulum_torque: Optional[float] = None  # motor torque [N m]
    contacts: Optional[Tuple[ContactForce, ...]] = None  # empty in flight, None if unknown
    energies: Optional[EnergyShares] = None
    decision: Optional[DecisionSign] = None
    e_stop: Optional[bool] = None  # whether the e-stop is engaged
    # x, y and heading relative to the start pose [m], [rad]; None for planar motion.
    place: Optional[Tuple[float, float, float]] = None
    lean: float = 0.0  # of the pendulum in the ball [rad]
    tilt: float = 0.0  # of the axle [rad]
