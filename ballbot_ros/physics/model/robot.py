# SPDX-License-Identifier: Apache-2.0
"""The parameters of a ball robot, their sources, and plausibility checks."""
from dataclasses import dataclass, field, fields
import hashlib
import math
from pathlib import Path
from types import MappingProxyType
from typing import Any, Dict, Iterator, Mapping, NamedTuple, Optional, Type, Union
import warnings

from ballbot_ros.config.fields import (
    build, changed, Checked, checked_values, expect_mapping, flag, Problems, Provenance,
    quantity, read_values, text)
from ballbot_ros.config.files import load_config
from ballbot_ros.errors import ConfigurationError, PlausibilityWarning
from ballbot_ros.physics.model.terrain import friction_coefficient


@dataclass(frozen=True, repr=False)
class ContactOptions(Checked):
    """
    Interpretation of eqs. (7)-(10).

    As printed, they are ``ContactOptions(pulling=True, slip_lever='radius')``.
    """

    pulling: bool = flag(
        'let the damper of eq. (7) pull the ball back to the ground when it rebounds, as the '
        'printed equation does; otherwise the normal force is never negative', default=False)
    friction_ramp: str = text(
        'shape of mu_scale in eq. (9): linear, or a smooth cubic',
        default='linear', choices=('linear', 'smooth'))
    slip_lever: str = text(
        'lever in the slip of eq. (8): the distance from centre to contact, as in eq. (10), so '
        'that friction always dissipates energy; or the full radius, as printed',
        default='contact', choices=('contact', 'radius'))


# The files of `contact_laws`; the first is the default.
CONTACT_LAWS = ('kelvin_voigt', 'hunt_crossley')

LEAD, AIR = 11340.0, 1.2  # plausible range of the density of a robot [kg/m3]
DENSITIES = (20.0, 5000.0)  # of robots: a unit that gives such a density was probably meant
DEEPEST = 0.25  # largest plausible static penetration [radii]
# Penetration above which a shell is not a stiff spring [radii].
PENETRATION_MAX = 0.1
SPEED_MAX = 20.0  # plausible for a robot [m/s]
HORIZONTAL = 90.0  # pendulum angle [deg]
GRAVITY_MAX = 30.0  # more than on any planet with a surface [m/s2]
STALL_MAX = 500.0  # plausible stall torque of a geared motor per mass of its robot [N m/kg]
TORQUE_CONSTANT_MIN = 1e-3  # of a plausible motor [N m/A]
# Torque and speed constant of a motor are equal in SI units, except for a factor of at most 2.5
# between the conventions for brushless motors (peak or rms, phase or line).
CONSTANTS_RATIO = 5.0

MASSES = {'g': 1e-3, 'mg': 1e-6}
LENGTHS = {'mm': 1e-3, 'cm': 1e-2}
INERTIAS = {'kg cm2': 1e-4, 'g m2': 1e-3, 'kg mm2': 1e-6, 'g cm2': 1e-7, 'g mm2': 1e-9}
STIFFNESSES = {'N/mm': 1e3, 'kN/m': 1e3, 'N/cm': 1e2}
TORQUE_CONSTANTS = {'mN m/A': 1e-3, 'N cm/A': 1e-2}
RPM = 30.0 / math.pi  # per rad/s


def implausible(robot: Any) -> Iterator[str]:
    """
    Yield a sentence for each parameter of a `Robot` that is physically implausible.

    It names the likely unit if the value would be plausible in another unit.
    """
    radius, mass = robot.ball_radius, robot.total_mass
    volume = 4.0 / 3.0 * math.pi * radius**3
    density = mass / volume
    if density > LEAD:
        yield (f'the mean density of robot {robot.name!r} is {density:.3g} kg/m3, above that of '
               f'lead: ball_mass is {robot.ball_mass:g} kg, ball_radius {radius:g} m'
               + _meant(robot.ball_mass, 'kg', MASSES,
                        tuple(limit * volume for limit in DENSITIES)))
    if density < AIR:
        yield (f'the mean density of robot {robot.name!r} is {density:.3g} kg/m3, below that of '
               f'air: ball_mass is {robot.ball_mass:g} kg, ball_radius {radius:g} m'
               + _meant(radius, 'm', LENGTHS, tuple(
                   (mass / limit / (4.0 / 3.0 * math.pi)) ** (1.0 / 3.0)
                   for limit in reversed(DENSITIES))))
    shell = robot.ball_mass * radius**2
    if robot.ball_inertia > shell * (1.0 + 1e-9):
        yield (f'ball_inertia is {robot.ball_inertia:g} kg m2, above {shell:.3g} kg m2, which is '
               'ball_mass ball_radius^2, with all mass at the shell'
               + _meant(robot.ball_inertia, 'kg m2', INERTIAS, (0.1 * shell, shell)))
    reach = robot.pendulum_mass * (radius + robot.pendulum_length)**2
    if robot.pendulum_inertia > reach * (1.0 + 1e-9):
        yield (f'pendulum_inertia is {robot.pendulum_inertia:g} kg m2, above {reach:.3g} kg m2: '
               'such a pendulum does not fit into the ball'
               + _meant(robot.pendulum_inertia, 'kg m2', INERTIAS, (1e-3 * reach, reach)))
    # With a wrong mass the penetration follows from that.
    if density <= LEAD and robot.static_penetration > DEEPEST * radius:
        softest = robot.weight / (0.05 * radius)
        yield (f'at rest the ball would sink {robot.static_penetration:.3g} m into the ground, '
               f'{robot.static_penetration / radius:.2g} of its radius: contact_stiffness is '
               f'{robot.contact_stiffness:g} N/m'
               + _meant(robot.contact_stiffness, 'N/m', STIFFNESSES, (softest, math.inf)))
    if robot.gravity > GRAVITY_MAX:
        yield (f'gravity is {robot.gravity:g} m/s2'
               + _meant(robot.gravity, 'm/s2', {'mm/s2': 1e-3, 'cm/s2': 1e-2}, (9.0, 10.5)))
    if robot.motor is not None:
        yield from _implausible_motor(robot.motor, radius, STALL_MAX * mass)


def _implausible_motor(motor: Any, radius: float, strongest: float) -> Iterator[str]:
    """Yield a sentence for the first implausible property of a motor; others follow from it."""
    torque, back, supply = motor.torque_constant, motor.speed_constant, motor.maximum_voltage
    stall = motor.stall_torque_per_volt * supply
    rolling = motor.no_load_rate * radius if back else 0.0
    if back and not 1.0 / CONSTANTS_RATIO <= torque / back <= CONSTANTS_RATIO:
        yield (f'torque_constant is {torque:g} N m/A and speed_constant {back:g} V s/rad; in '
               'these units a motor has nearly the same number for both'
               + (_meant(torque, 'N m/A', TORQUE_CONSTANTS, (
                   max(TORQUE_CONSTANT_MIN, back / CONSTANTS_RATIO), back * CONSTANTS_RATIO))
                  or _meant(back, 'V s/rad', {
                      'mV s/rad': 1e-3, 'V/rpm': RPM, 'V/krpm': 1e-3 * RPM,
                      'rpm/V': RPM / back**2},
                      (torque / CONSTANTS_RATIO, torque * CONSTANTS_RATIO))))
    elif rolling > SPEED_MAX:
        yield (f'without load the motor would roll the robot at {rolling:.3g} m/s: gear_ratio is '
               f'{motor.gear_ratio:g}, speed_constant {back:g} V s/rad, maximum_voltage '
               f'{supply:g} V' + _meant(supply, 'V', {'mV': 1e-3}, (1.0, 100.0)))
    elif stall > strongest:
        yield (f'the stall torque of the motor is {stall:.3g} N m at the joint, above '
               f'{STALL_MAX:g} N m per kg of the robot: gear_ratio is {motor.gear_ratio:g}, '
               f'torque_constant {torque:g} N m/A, resistance {motor.resistance:g} ohm, '
               f'maximum_voltage {supply:g} V'
               + _meant(torque, 'N m/A', TORQUE_CONSTANTS, (TORQUE_CONSTANT_MIN, 1.0)))
    if motor.maximum_torque > strongest:
        yield (f'maximum_torque is {motor.maximum_torque:g} N m, above {STALL_MAX:g} N m per kg '
               'of the robot' + _meant(motor.maximum_torque, 'N m', {'mN m': 1e-3, 'N cm': 1e-2},
                                       (0.0, stall)))


def speed_warnings(speed: float, name: str) -> Iterator[str]:
    """Yield a warning about an implausible speed [m/s]."""
    if abs(speed) > SPEED_MAX:
        yield (f'{name} is {speed:g} m/s, {3.6 * abs(speed):.0f} km/h: check the unit')


def height_warnings(robot: Any, height: float, where: str) -> Iterator[str]:
    """Yield a warning about a step [m] that no ball of this size can cross."""
    diameter = 2.0 * robot.ball_radius
    if height > diameter:
        yield (f'the step of {height:g} m {where} is higher than the ball ({diameter:g} m), which '
               'cannot get over it' + (
                   f': {height:g} mm are {1e-3 * height:g}' if height >= 1.0 else ''))


def edge_warnings(robot: Any, speed: float, height: float) -> Iterator[str]:
    """
    Yield a warning about an impact on the edge of a step that is too fast for the contact law.

    Parameters
    ----------
    robot : Robot
    speed : float
        Of the centre at the contact, horizontal [m/s].
    height : float
        Of the edge [m].

    """
    depth = PENETRATION_MAX * robot.ball_radius
    # The kinetic energy of the normal velocity compresses the spring: M v^2 / 2 = k p^2 / 2.
    fastest = depth * math.sqrt(robot.contact_stiffness / robot.total_mass)
    above = max(robot.ball_radius - height, 0.0) / robot.ball_radius  # centre above the edge
    if speed * math.sqrt(1.0 - above * above) > fastest:
        yield (f'robot {robot.name!r} hits the edge at more than {fastest:.3g} m/s along the '
               f'normal, at which the penetration may reach {1e3 * depth:.3g} mm, '
               f'{PENETRATION_MAX:.0%} of its radius: contact_stiffness is too low for this '
               'impact, and the height is not reliable')


def angle_warnings(degrees: float) -> Iterator[str]:
    """Yield a warning about a set angle of the pendulum above the horizontal."""
    if abs(degrees) > HORIZONTAL + 1e-9:
        yield (f'the pendulum is held at {degrees:g} degrees, above the horizontal, where a '
               'larger angle gives less torque: 90 is horizontal')


def _meant(value: float, unit: str, others: Mapping[str, float],
           plausible: tuple[float, ...]) -> str:
    """Return a hint at another unit in which a value would be plausible, empty for none."""
    low, high = plausible
    for other, factor in others.items():
        if low <= value * factor <= high:
            return f'; {value:g} {other} would be {value * factor:g} {unit}'
    return ''


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

    @property
    def no_load_rate(self) -> float:
        """Return the highest rate of the joint, without torque [rad/s]; it may be infinite."""
        return self.maximum_voltage / self.back_voltage if self.back_voltage else math.inf


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

    A robot without a pendulum has ``pendulum_mass == 0``, and all other pendulum quantities
    are 0; it has separate equations, because the full mass matrix would be singular.

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
    surface_friction: float = friction_coefficient(
        'coefficient of friction on a surface, mu')
    edge_friction: float = friction_coefficient(
        'coefficient of friction on the edge of a step, mu')
    slip_threshold: float = quantity(
        'm/s', 'slip velocity at which friction is fully developed, eq. (9)', above=0.0,
        default=0.01)
    gravity: float = quantity('m/s2', 'acceleration of gravity, g', minimum=0.0, default=9.81)
    contact_law: str = text(
        'law of the normal force: kelvin_voigt, k p - kd v as in eq. (7), or hunt_crossley, '
        'k p (1 - lambda v)', default='kelvin_voigt', choices=CONTACT_LAWS)
    contact_dissipation: float = quantity(
        's/m', 'dissipation of the shell, lambda, of hunt_crossley', minimum=0.0, default=0.0)
    motor: Optional[Motor] = field(default=None, metadata={'part': Motor})
    steering: Optional[Steering] = field(default=None, metadata={'part': Steering})
    provenance: Mapping[str, Provenance] = field(
        default_factory=lambda: MappingProxyType({}), compare=False, repr=False)

    def __post_init__(self) -> None:
        """Check each value, then their consistency."""
        super().__post_init__()
        if self.consistent:
            for sentence in implausible(self):
                warnings.warn(sentence, PlausibilityWarning, stacklevel=3)
            return
        if not self.has_law_of_dissipation:
            raise ConfigurationError(
                f'Robot: contact_dissipation is given without its law, and {self.contact_law} '
                'would ignore it; write contact_law: hunt_crossley', 'inconsistent',
                'contact_dissipation')
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
            Location for error messages.
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
        """Return whether the parameters of contact law, pendulum and ball are consistent."""
        resists = (self.pendulum_inertia > 0.0) | (self.pendulum_length > 0.0)
        nothing = ((self.pendulum_inertia == 0.0) & (self.pendulum_length == 0.0)
                   & (self.joint_friction == 0.0))
        return self.has_law_of_dissipation & (self.pendulum_length <= self.ball_radius) & (
            self.has_pendulum & resists | (self.pendulum_mass == 0.0) & nothing)

    @property
    def has_law_of_dissipation(self) -> bool:
        """Return whether the contact law uses the dissipation, or that is 0."""
        return (self.contact_dissipation == 0.0) | (self.contact_law != 'kelvin_voigt')

    @property
    def law_number(self) -> float:
        """Return the number of the contact law in `CONTACT_LAWS`."""
        return float(CONTACT_LAWS.index(self.contact_law))

    @property
    def has_pendulum(self) -> bool:
        """Return whether there is a pendulum inside the ball."""
        return self.pendulum_mass > 0.0

    @property
    def digest(self) -> str:
        """Return a fingerprint of the numbers of robot and motor, not of steering and name."""
        numbers = [(type(part).__name__, name, getattr(part, name))
                   for part in (self, self.motor) if part is not None
                   for name in described(type(part))]
        if self.law_number:
            numbers.append(('Robot', 'contact_law', self.contact_law))
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
        """Return the penetration of the ball at rest on a level surface, M g / k [m]."""
        return self.weight / self.contact_stiffness

    @property
    def pendulum_moment(self) -> float:
        """Return the first moment of the pendulum about the joint, M2 e [kg m]."""
        return self.pendulum_mass * self.pendulum_length

    @property
    def joint_inertia(self) -> float:
        """Return the inertia of the pendulum about the joint, J2 + M2 e^2 [kg m2]."""
        # Not a power, whose last digit may differ between a number and a column.
        return self.pendulum_inertia + self.pendulum_mass * (
            self.pendulum_length * self.pendulum_length)

    @property
    def swing_inertia(self) -> float:
        """Return the inertia of a swing that moves the free ball, J2 + M2 e^2 M1 / M [kg m2]."""
        own = self.pendulum_mass * (self.pendulum_length * self.pendulum_length)
        return self.pendulum_inertia + own * self.ball_mass / self.total_mass

    @property
    def largest_gravity_torque(self) -> float:
        """Return the gravity torque about the joint with the pendulum horizontal, M2 g e [N m]."""
        return self.pendulum_mass * self.gravity * self.pendulum_length

    @property
    def motor_line(self) -> tuple[float, float, float, float]:
        """
        Return the speed-torque line of the motor, see `actuation.applied_torque`.

        Stall torque per volt [N m/V], back voltage [V s/rad], supply voltage [V] and largest
        torque [N m].  The line of a robot without a motor has no limits.
        """
        if self.motor is None:
            return 1.0, 0.0, math.inf, math.inf
        return (self.motor.stall_torque_per_volt, self.motor.back_voltage,
                self.motor.maximum_voltage, self.motor.maximum_torque)

    @property
    def slope_limit(self) -> float:
        """Return the steepest slope the pendulum can hold, asin(M2 e / (M R)) [rad]."""
        return math.asin(min(1.0, self.pendulum_moment / (self.total_mass * self.ball_radius)))

    @property
    def damping_ratio(self) -> float:
        """Return the damping ratio of the ball on its contact spring, zeta."""
        critical = 2.0 * math.sqrt(self.contact_stiffness * self.total_mass)
        return self.contact_damping / critical

    @property
    def restitution(self) -> float:
        """
        Return exp(-pi zeta / sqrt(1 - zeta^2)), 0 where overdamped (unclamped bounce).

        Valid for eq. (7); with hunt_crossley, restitution depends on the speed.
        """
        zeta = self.damping_ratio
        return math.exp(-math.pi * zeta / math.sqrt(1.0 - zeta**2)) if zeta < 1.0 else 0.0


class Parameters(NamedTuple):
    """A robot and its contact law as the compiled kernels read them; all SI."""

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
    law: float  # number of the law in `CONTACT_LAWS`

    @classmethod
    def of(cls, robot: Robot, options: ContactOptions) -> 'Parameters':
        """Return the parameters of a robot; columns for a robot with columns."""
        return cls(
            robot.total_mass, robot.pendulum_moment, robot.ball_inertia, robot.swing_inertia,
            robot.joint_inertia, robot.rolling_friction, robot.joint_friction,
            robot.ball_radius, robot.contact_stiffness, robot.contact_damping,
            robot.slip_threshold, robot.gravity, float(options.pulling),
            float(options.friction_ramp == 'smooth'), float(options.slip_lever == 'radius'),
            robot.contact_dissipation * robot.contact_stiffness, robot.law_number)


# The sections of a robot file.
PARTS: Mapping[str, Type[Checked]] = {
    item.name: item.metadata['part'] for item in fields(Robot) if 'part' in item.metadata}

# A robot, or the name or the file of one.
RobotLike = Union[Robot, str, Path]


def load_robot(name_or_path: RobotLike) -> Robot:
    """
    Read a robot of the package by name, or a custom file.

    A `Robot` is returned unchanged.

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


def described(cls: Any, prefix: str = '') -> Dict[str, Mapping[str, Any]]:
    """Return the metadata of the numeric fields of a dataclass, by name."""
    return {prefix + item.name: item.metadata for item in fields(cls)
            if item.metadata.get('kind') is float}


ROBOT = described(Robot)
MOTOR, STEERING = (described(cls, f'{name}.') for name, cls in PARTS.items())


def with_parameters(robot: Robot, values: Mapping[str, Any]) -> Robot:
    """
    Return a robot with other parameters, SI, or with columns.

    Names are those of `ROBOT`, `MOTOR` and `STEERING`.  Raises `ConfigurationError` if a value is
    out of range, or belongs to a part that the robot does not have.
    """
    own: Dict[str, Any] = {name: value for name, value in values.items() if name in ROBOT}
    for part, known in (('motor', MOTOR), ('steering', STEERING)):
        given = {name.partition('.')[2]: value for name, value in values.items() if name in known}
        if given:
            if getattr(robot, part) is None:
                raise ConfigurationError(
                    f'robot {robot.name!r} has no {part} to change {min(given)} of',
                    'missing', part)
            own[part] = changed(getattr(robot, part), given)
    return changed(robot, own)
