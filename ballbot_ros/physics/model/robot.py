# SPDX-License-Identifier: Apache-2.0
"""The ball robot as a set of numbers, and where each number comes from."""
from dataclasses import dataclass, field, fields
import hashlib
import math
from pathlib import Path
from types import MappingProxyType
from typing import Any, Mapping, Optional, Type, Union
import warnings

from ballbot_ros.config.fields import (
    build, Checked, checked_values, expect_mapping, Problems, quantity, text)
from ballbot_ros.config.files import load_config
from ballbot_ros.config.provenance import Provenance, read_values
from ballbot_ros.errors import ConfigurationError, PlausibilityWarning
from ballbot_ros.physics.model.plausibility import implausible

@dataclass(frozen=True)
class Motor(Checked):
    """
    Direct-current motor with its gear, as seen at the pendulum joint.

    Inductance is neglected (electrical time constants are far below the mechanical ones)
    and rotor inertia counts as part of the pendulum.
    """

    gear_ratio: float = quantity('1', 'motor turns per turn of the pendulum joint', above=0.0)
    gear_efficiency: float = quantity('1', 'torque out over torque in', above=0.0, maximum=1.0)
    torque_constant: float = quantity('N m/A', 'motor torque per ampere', above=0.0)
    speed_constant: float = quantity('V s/rad', 'back voltage per motor speed', minimum=0.0)
    resistance: float = quantity('ohm', 'armature resistance', above=0.0)
    maximum_voltage: float = quantity('V', 'supply voltage', above=0.0)
    maximum_torque: float = quantity('N m', 'largest torque at the pendulum joint', above=0.0)

    @property
    def stall_torque_per_volt(self) -> float:
        """Return gear_ratio gear_efficiency torque_constant / resistance [N m/V]."""
        return self.gear_ratio * self.gear_efficiency * self.torque_constant / self.resistance

    @property
    def back_voltage(self) -> float:
        """Return the voltage per rate of the joint, gear_ratio speed_constant [V s/rad]."""
        return self.gear_ratio * self.speed_constant


@dataclass(frozen=True)
class Steering(Checked):
    """
    Lateral axis of the pendulum, see `ballbot_ros.steering`.

    The lean is the angle between pendulum and ball about the axis that points forwards.
    """

    largest_lean: float = quantity('rad', 'largest lean to either side', above=0.0, maximum=1.4)
    largest_lean_rate: float = quantity('rad/s', 'largest rate of the lean', above=0.0)
    largest_torque: float = quantity(
        'N m', 'largest torque of the lateral axis', above=0.0)


@dataclass(frozen=True, repr=False)
class Robot(Checked):
    """
    A ball with or without a pendulum; symbols are those of the paper's nomenclature.

    A robot without a pendulum has ``pendulum_mass == 0`` and then no other pendulum
    quantity either; it has equations of its own (the mass matrix of the full ones would
    be singular).

    Attributes
    ----------
    provenance : mapping of str to Provenance
        By field name.
    motor : Motor or None
    steering : Steering or None
        A robot without it drives straight.

    Raises
    ------
    ConfigurationError
        If a value is out of range, or the values contradict each other.

    """

    name: str = text('name of the robot')
    ball_mass: float = quantity('kg', 'mass of the ball, M1', above=0.0)
    ball_inertia: float = quantity('kg m2', 'inertia of the ball, J1', above=0.0)
    ball_radius: float = quantity('m', 'radius of the ball, R', above=0.0)
    pendulum_mass: float = quantity('kg', 'mass of the pendulum, M2; 0 for none', minimum=0.0)
    pendulum_inertia: float = quantity(
        'kg m2', 'inertia of the pendulum about its own centre of mass, J2', minimum=0.0)
    pendulum_length: float = quantity(
        'm', 'ball centre to centre of mass of the pendulum, e', minimum=0.0)
    rolling_friction: float = quantity(
        'N m s/rad', 'viscous resistance to the rotation of the ball, c1', minimum=0.0)
    joint_friction: float = quantity(
        'N m s/rad', 'viscous friction of the pendulum joint, c2', minimum=0.0)
    contact_stiffness: float = quantity('N/m', 'stiffness of the shell, k', above=0.0)
    contact_damping: float = quantity('N s/m', 'damping of the shell, kd', minimum=0.0)
    surface_friction: float = quantity(
        '1', 'coefficient of friction on a surface, mu', minimum=0.0)
    edge_friction: float = quantity(
        '1', 'coefficient of friction on the edge of a step, mu', minimum=0.0)
    slip_threshold: float = quantity(
        'm/s', 'slip velocity at which friction is fully there, eq. (9)', above=0.0,
        default=0.01)
    gravity: float = quantity('m/s2', 'acceleration of gravity, g', minimum=0.0, default=9.81)
    contact_dissipation: float = quantity(
        's/m', 'dissipation of the shell by Hunt and Crossley, lambda: beside kd, a damping of '
        'k lambda times the penetration', minimum=0.0, default=0.0)
    motor: Optional[Motor] = None
    steering: Optional[Steering] = None
    provenance: Mapping[str, Provenance] = field(
        default_factory=lambda: MappingProxyType({}), compare=False, repr=False)

    def __post_init__(self) -> None:
        """Check each value, then that they fit together."""
        super().__post_init__()
        if self.consistent:
            for sentence in implausible(self):
                warnings.warn(sentence, PlausibilityWarning, stacklevel=3)
            return
        if self.pendulum_mass == 0.0:
            for name in ('pendulum_inertia', 'pendulum_length', 'joint_friction'):
                if getattr(self, name) != 0.0:
                    raise ConfigurationError(
                        f'Robot: {name} must be 0 for a robot without a pendulum '
                        f'(pendulum_mass is 0), got {getattr(self, name)!r}', 'inconsistent',
                        name)
        if self.pendulum_length > self.ball_radius:
            raise ConfigurationError(
                f'Robot: pendulum_length must be at most ball_radius ({self.ball_radius:g} m), '
                f'got {self.pendulum_length!r}', 'inconsistent', 'pendulum_length')
        raise ConfigurationError(
            'Robot: a pendulum needs a pendulum_inertia or a pendulum_length above 0: '
            'with both 0 nothing resists the motor', 'inconsistent', 'pendulum_inertia')

    @classmethod
    def from_mapping(cls, mapping: Any, where: str) -> 'Robot':
        """Build from the mapping of a YAML file, in which values may carry their `Provenance`."""
        content = dict(expect_mapping(mapping, where))
        parts = {name: content.pop(name, None) for name in PARTS}
        problems = Problems()
        values: dict[str, Any] = {}
        provenance: dict[str, Any] = {}
        with problems.collected():
            values, provenance = read_values(cls, content, where)
        for name, entries in parts.items():
            if entries is None:
                continue
            place = f'{where}: {name}'
            with problems.collected():
                given, sources = read_values(PARTS[name], expect_mapping(entries, place), place)
                provenance.update({f'{name}.{key}': item for key, item in sources.items()})
                values[name] = build(PARTS[name], given, place)
        problems.refuse()
        return build(cls, {**values, 'provenance': MappingProxyType(provenance)}, where)

    def replace(self, where: str = 'Robot.replace', /, **changes: Any) -> 'Robot':
        """
        Return a robot with other parameters, checked; their provenance is dropped.

        >>> load_robot('gimball').replace(ball_mass=4.0).total_mass
        5.6

        Parameters
        ----------
        where : str, optional
            Place for error messages.
        **changes
            Values by name of the parameter.

        Raises
        ------
        ConfigurationError
            Naming parameter, value and allowed range.

        """
        kept = {key: item for key, item in self.provenance.items()
                if key.partition('.')[0] not in changes}
        parts = {name: changes.pop(name, getattr(self, name)) for name in PARTS}
        for name, part in parts.items():
            if part is not None and not isinstance(part, PARTS[name]):
                raise ConfigurationError(
                    f'{where}: {name} must be a {PARTS[name].__name__} or None, got {part!r}',
                    'wrong_type', name)
        current = {item.name: getattr(self, item.name) for item in fields(self)
                   if 'kind' in item.metadata}
        values = checked_values(Robot, {**current, **changes}, where)
        return build(Robot, {**values, **parts, 'provenance': MappingProxyType(kept)}, where)

    def __repr__(self) -> str:
        """Return a short description; ``dataclasses.asdict`` has all parameters."""
        return (f'Robot({self.name!r}, {self.total_mass:g} kg, ball_radius='
                f'{self.ball_radius:g} m)')

    @property
    def consistent(self) -> bool:
        """Return whether all that is known of the pendulum fits together, and into the ball."""
        resists = (self.pendulum_inertia > 0.0) | (self.pendulum_length > 0.0)
        nothing = ((self.pendulum_inertia == 0.0) & (self.pendulum_length == 0.0)
                   & (self.joint_friction == 0.0))
        return (self.pendulum_length <= self.ball_radius) & (
            self.has_pendulum & resists | (self.pendulum_mass == 0.0) & nothing)

    @property
    def has_pendulum(self) -> bool:
        """Return whether there is a pendulum inside the ball."""
        return self.pendulum_mass > 0.0

    @property
    def digest(self) -> str:
        """Return a fingerprint of the numbers of robot and motor, not of steering and name."""
        numbers = [(type(part).__name__, item.name, getattr(part, item.name))
                   for part in (self, self.motor) if part is not None
                   for item in fields(part) if item.metadata.get('kind') is float]
        return hashlib.sha256(repr(numbers).encode()).hexdigest()[:16]

    @property
    def total_mass(self) -> float:
        """Return M1 + M2 [kg]."""
        return self.ball_mass + self.pendulum_mass

    @property
    def weight(self) -> float:
        """Return (M1 + M2) g [N]."""
        return self.total_mass * self.gravity

    @property
    def static_penetration(self) -> float:
        """Return how deep the ball rests in a level surface, M g / k [m]."""
        return self.weight / self.contact_stiffness

    @property
    def largest_gravity_torque(self) -> float:
        """Return the torque of a level pendulum about the joint, M2 g e [N m]."""
        return self.pendulum_mass * self.gravity * self.pendulum_length

    @property
    def motor_line(self) -> tuple[float, float, float, float]:
        """
        Return the speed-torque line of the motor, see `laws.applied_torque`.

        Stall torque per volt [N m/V], back voltage [V s/rad], supply voltage [V] and largest
        torque [N m].  A robot that describes no motor has one without limits.
        """
        if self.motor is None:
            return 1.0, 0.0, math.inf, math.inf
        return (self.motor.stall_torque_per_volt, self.motor.back_voltage,
                self.motor.maximum_voltage, self.motor.maximum_torque)

    @property
    def slope_limit(self) -> float:
        """Return the steepest slope the pendulum can hold, asin(M2 e / (M R)) [rad]."""
        lever = self.pendulum_mass * self.pendulum_length
        return math.asin(min(1.0, lever / (self.total_mass * self.ball_radius)))

    @property
    def damping_ratio(self) -> float:
        """Return the damping ratio of the ball on its contact spring, zeta."""
        critical = 2.0 * math.sqrt(self.contact_stiffness * self.total_mass)
        return self.contact_damping / critical

    @property
    def restitution(self) -> float:
        """
        Return exp(-pi zeta / sqrt(1 - zeta^2)), 0 where overdamped (unclamped bounce).

        Of eq. (7) alone; with `contact_dissipation` it depends on the speed.
        """
        zeta = self.damping_ratio
        return math.exp(-math.pi * zeta / math.sqrt(1.0 - zeta**2)) if zeta < 1.0 else 0.0


# The sections of a robot file.
PARTS: Mapping[str, Type[Checked]] = {'motor': Motor, 'steering': Steering}

# A robot, or the name or the file of one.
RobotLike = Union[Robot, str, Path]


def load_robot(name_or_path: RobotLike) -> Robot:
    """
    Read a robot of the package by name, or a custom file.

    A `Robot` is returned as it is.

    >>> load_robot('gimball').provenance['ball_mass'].source
    'derived'

    Raises
    ------
    ConfigurationError
        Naming file, field, value and allowed range.

    """
    if isinstance(name_or_path, Robot):
        return name_or_path
    return load_config(Robot, 'robots', name_or_path)
