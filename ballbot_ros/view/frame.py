# SPDX-License-Identifier: Apache-2.0
"""State of a robot at one time; unknown values are None."""
from dataclasses import dataclass
from typing import Any, NamedTuple, Optional, Tuple


class ContactForce(NamedTuple):
    """A ground contact force, in the plane of the model."""

    x: float  # point of action [m]
    y: float
    force_x: float  # normal force and friction together [N]
    force_y: float
    penetration: float  # [m]

    @classmethod
    def of(cls, contact: Any) -> 'ContactForce':
        """Return the force of a `Touch` of the model, or of a message Contact."""
        normal, friction = contact.normal_force, contact.friction_force
        return cls(contact.x, contact.y,
                   normal * contact.normal_x + friction * contact.normal_y,
                   normal * contact.normal_y - friction * contact.normal_x, contact.penetration)


class EnergyShares(NamedTuple):
    """Energies by kind, and their losses since the start [J]."""

    kinetic: Optional[float] = None
    potential: Optional[float] = None
    contact: Optional[float] = None  # stored in the contact springs
    dissipated: Optional[float] = None  # dissipated by dampers and friction
    motor_work: Optional[float] = None  # supplied by the motor


@dataclass(frozen=True)
class DecisionSign:
    """
    The obstacle decision, with the values that it provides.

    Attributes
    ----------
    kind, reason : str
        Values of `decision.Kind` and `decision.Reason`.
    explanation : str
        One sentence, may be empty.
    height : float or None
        Of the step ahead [m].
    distance : float or None
        From the centre of the ball to its face [m].
    speed : float or None
        Expected or required touch speed [m/s].
    margin : float or None
        Difference between the maximum step height and the height [m]; negative if too high.
    probability : float or None
        Success probability.

    """

    kind: str
    reason: str
    explanation: str = ''
    height: Optional[float] = None
    distance: Optional[float] = None
    speed: Optional[float] = None
    margin: Optional[float] = None
    probability: Optional[float] = None


@dataclass(frozen=True)
class Frame:
    """
    The robot at one moment; SI, angles and signs as in docs/model.md.

    Attributes
    ----------
    time : float
        On the clock of the source [s].
    x, y : float or None
        Centre of the ball [m].
    ball_angle, pendulum_angle : float or None
        theta1, and the absolute angle of the pendulum [rad].
    velocity_x, velocity_y : float or None
        Of the centre [m/s].
    ball_rate, pendulum_rate : float or None
        Absolute [rad/s].
    pendulum_torque : float or None
        Motor torque [N m].
    contacts : tuple of ContactForce or None
        Empty in flight, None if unknown.
    energies : EnergyShares or None
    decision : DecisionSign or None
    e_stop : bool or None
        Whether the e-stop is engaged.
    place : (float, float, float) or None
        x, y and heading in the frame of the start; None straight ahead [m], [rad].
    lean, tilt : float
        Of the pendulum in the ball and of the axle [rad].

    """

    time: float
    x: Optional[float] = None
    y: Optional[float] = None
    ball_angle: Optional[float] = None
    pendulum_angle: Optional[float] = None
    velocity_x: Optional[float] = None
    velocity_y: Optional[float] = None
    ball_rate: Optional[float] = None
    pendulum_rate: Optional[float] = None
    pendulum_torque: Optional[float] = None
    contacts: Optional[Tuple[ContactForce, ...]] = None
    energies: Optional[EnergyShares] = None
    decision: Optional[DecisionSign] = None
    e_stop: Optional[bool] = None
    place: Optional[Tuple[float, float, float]] = None
    lean: float = 0.0
    tilt: float = 0.0
