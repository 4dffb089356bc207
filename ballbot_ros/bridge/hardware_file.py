# SPDX-License-Identifier: Apache-2.0
"""The hardware file of one real robot: drive, port, and the joint of the pendulum."""
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Mapping, Optional, Tuple

from ballbot_ros.bridge.condition import Battery, Thermal
from ballbot_ros.config.fields import (
    build, Checked, count, expect_mapping, flag, Provenance, quantity, read_values,
    refuse_missing, refuse_unknown, section, text)
from ballbot_ros.config.files import read_config
from ballbot_ros.drives import driver_class, DRIVES, read_options
from ballbot_ros.drives.contract import DriveOptions, RUNAWAY
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.estimation import FilterTuning, ImuMounting, OdometryTuning
from ballbot_ros.imus.source import ImuPort
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.steering import required_steering

# Actions after a command timeout; see `supervisor`.
ON_TIMEOUT = ('coast', 'brake', 'settle')


@dataclass(frozen=True)
class HardwareNames(Checked):
    """Names in a hardware file."""

    name: str = text('name of this hardware')
    robot: str = text('name or file of its robot')


@dataclass(frozen=True)
class Joint(Checked):
    """
    Transmission between the motor shaft and the pendulum joint.

    Angles and torques of the joint are those of the pendulum relative to the shell,
    counter-clockwise positive with +x to the right.
    """

    gear_ratio: float = quantity('1', 'motor turns per turn of the pendulum joint', above=0.0)
    gear_efficiency: float = quantity(
        '1', 'torque out over torque in', above=0.0, maximum=1.0, default=1.0)
    direction: int = count(
        '1 if the drive counts up when the pendulum swings to +x, else -1', default=1,
        minimum=-1, maximum=1)
    encoder_scale: Optional[float] = quantity(
        '1', 'turns of the joint per reported turn of the drive; 1 / gear_ratio if not given, '
        'for an encoder on the motor', above=0.0, optional=True)
    torque_factor: float = quantity(
        '1', 'actual torque over requested torque; measured by calibrate-motor',
        above=0.0, maximum=10.0, default=1.0)
    encoder_zero: Optional[float] = quantity(
        'rad', 'joint angle that the drive reports at joint angle 0, if it retains its zero',
        optional=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.direction == 0:
            raise ConfigurationError('Joint: direction must be 1 or -1, got 0',
                                     'not_a_choice', 'direction')

    @property
    def torque_ratio(self) -> float:
        """Return the torque at the pendulum per torque at the motor shaft, not calibrated."""
        return self.gear_ratio * self.gear_efficiency

    @property
    def scale(self) -> float:
        """Return the turns of the joint per reported turn of the drive."""
        return 1.0 / self.gear_ratio if self.encoder_scale is None else self.encoder_scale

    def joint_angle(self, position: float) -> float:
        """Return the joint angle for a position of the drive [rad]; applies to rates, too."""
        return self.direction * self.scale * position

    def motor_torque(self, torque: float) -> float:
        """Return the torque at the motor shaft for a torque at the pendulum [N m]."""
        return self.direction * torque / (self.torque_ratio * self.torque_factor)


@dataclass(frozen=True)
class SteeringAxis(Joint):
    """
    Lateral axis of the pendulum, on a drive of the same protocol.

    Its limits are those of the section ``steering`` of the robot.
    """

    port: str = text('port of its drive; if not given, that of the section connection, which '
                     'requires a protocol whose replies name the axis', default='')
    drive_torque_limit: float = quantity(
        'N m', 'largest torque of the axis, as scaled by the drive, that the limits of the drive '
        'may permit; the largest torque of the robot if that is larger',
        minimum=0.0, maximum=1000.0, default=0.0)
    drive: Optional[Mapping[str, Any]] = section(
        'options of its driver that differ from those of the section drive',
        default=None)


@dataclass(frozen=True)
class Limits(Checked):
    """Limits of the motion, and the action after a command timeout."""

    torque_limit: float = quantity(
        'N m', 'largest torque at the pendulum', above=0.0, maximum=1000.0)
    drive_torque_limit: float = quantity(
        'N m', 'largest torque at the pendulum, as scaled by the drive, that the limits of the '
        'drive may permit: torque_limit can then be lowered in the file alone; '
        'torque_limit if that is larger', minimum=0.0, maximum=1000.0, default=0.0)
    torque_rate_limit: float = quantity(
        'N m/s', 'fastest change of the torque; zero torque is always immediate', above=0.0,
        default=400.0)
    angle_limit: float = quantity(
        'rad', 'absolute pendulum angle beyond which only torque towards 0 is permitted',
        above=0.0, maximum=6.3, default=1.6)
    speed_limit: float = quantity(
        'rad/s', 'rate of the joint beyond which only torque against it is permitted; at '
        f'{RUNAWAY:g} times this rate the e-stop engages', above=0.0, default=12.0)
    command_timeout: float = quantity(
        's', 'longest time from the last fresh command to zero torque',
        minimum=0.01, maximum=10.0, default=0.1)
    on_timeout: str = text(
        'action of the motor after a command timeout', default='coast', choices=ON_TIMEOUT)
    damping: float = quantity(
        'N m s/rad', 'torque per rate of brake and settle', minimum=0.0, maximum=100.0,
        default=0.3)
    damping_time: float = quantity(
        's', 'duration of brake and settle; zero torque afterwards', minimum=0.0, maximum=60.0,
        default=2.0)
    rearm: bool = flag(
        'whether to continue after a lost link, a restart of the drive, a drive that disarmed by '
        'itself, a delay of the loop beyond the watchdog or an IMU timeout; if not, the e-stop '
        'engages and a person must release it',
        default=False)


@dataclass(frozen=True)
class Connection(Checked):
    """Port and loop rate of the drive."""

    protocol: str = text('protocol of the drive', choices=tuple(DRIVES))
    port: str = text('serial device, preferably by its name in /dev/serial/by-id, or pyserial '
                     'URL; a CAN interface, or INTERFACE:CHANNEL of python-can')
    baud: int = count('bits per second', default=115200, minimum=300, maximum=20_000_000)
    loop_rate: float = quantity(
        'Hz', 'rate of measurements and torques, and in direct control of joint_states',
        minimum=1.0, maximum=5000.0, default=200.0)
    watchdog: float = quantity(
        's', 'time without a command after which the drive disarms by itself', minimum=0.01,
        maximum=1.0, default=0.1)
    imu_required: bool = flag(
        'no torque while no IMU reading arrives: without one the pendulum angle is unreliable '
        'except on a level floor', default=True)


# Driver options that are set in another section.
SET_ELSEWHERE = {
    'torque_limit': 'limits: torque_limit', 'drive_torque_limit': 'limits: drive_torque_limit',
    'speed_limit': 'limits: speed_limit', 'watchdog': 'connection: watchdog'}
SECTIONS = {'connection': Connection, 'joint': Joint, 'limits': Limits, 'imu': ImuMounting,
            'imu_port': ImuPort, 'estimate': FilterTuning, 'odometry': OdometryTuning,
            'battery': Battery, 'thermal': Thermal}


@dataclass(frozen=True)
class Hardware:
    """Motor, joint and sensors of one robot."""

    name: str
    robot: str  # name or file of its robot
    connection: Connection
    joint: Joint
    limits: Limits
    imu: ImuMounting = ImuMounting()
    # An IMU on a port of the bridge; without a `port` the bridge uses the topic `imu`.
    imu_port: ImuPort = ImuPort()
    estimate: FilterTuning = FilterTuning()
    odometry: OdometryTuning = OdometryTuning()
    battery: Battery = Battery()
    thermal: Thermal = Thermal()
    steering: Optional[SteeringAxis] = None  # None for a robot that drives straight
    # Options of the protocol; see the `Options` of its driver.
    drive: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    # Source of each value, by section and field.
    provenance: Mapping[str, Provenance] = field(
        default_factory=lambda: MappingProxyType({}), compare=False, repr=False)

    def at(self, port: str = '', baud: int = 0) -> 'Hardware':
        """Return a copy with another port or baud rate, if given."""
        return replace(self, connection=replace(
            self.connection, port=port or self.connection.port,
            baud=baud or self.connection.baud))

    def lateral(self, robot: Robot) -> 'Hardware':
        """
        Return the hardware of the lateral axis, with the limits of the robot.

        Raises `ConfigurationError` if this hardware or the robot has no section ``steering``, or
        if the replies to the two axes cannot be distinguished.
        """
        axis, limits = self.steering, required_steering(robot)
        if axis is None:
            raise ConfigurationError(
                f'{self.name}: there is no section steering', 'missing', 'steering')
        drive = {**self.drive, **(axis.drive or {})}
        protocol = self.connection.protocol
        name = driver_class(protocol).shares_line
        if axis.port in ('', self.connection.port):
            if not name:
                raise ConfigurationError(
                    f'{self.name}: steering: replies of {protocol} do not name the axis, so its '
                    'drive needs a separate port; set steering: port, or use a CAN bus',
                    'missing', 'port')
            options = driver_class(protocol).Options
            mine, other = (mapping.get(name, getattr(options, name)) for mapping in (
                drive, self.drive))
            if mine == other:
                raise ConfigurationError(
                    f'{self.name}: steering: drive: {name} must differ from that of the section '
                    f'drive, got {mine} for both', 'inconsistent', name)
        return replace(
            self, name=f'{self.name}: steering', joint=axis, steering=None,
            drive=MappingProxyType(drive), battery=Battery(), thermal=Thermal(),
            connection=replace(self.connection, port=axis.port or self.connection.port,
                               imu_required=False),
            limits=replace(
                self.limits, torque_limit=limits.largest_torque, on_timeout='coast',
                drive_torque_limit=axis.drive_torque_limit, angle_limit=limits.largest_lean,
                speed_limit=limits.largest_lean_rate))

    def options(self) -> DriveOptions:
        """
        Return the options of the driver.

        Raises `ConfigurationError` if the section `drive` does not match the protocol.
        """
        limits, joint = self.limits, self.joint
        _refuse_set_elsewhere(self.drive, f'{self.name}: drive')
        return read_options(self.connection.protocol, {
            'torque_limit': abs(joint.motor_torque(limits.torque_limit)),
            # The drive does not apply torque_factor, which is calibrated after its setup.
            'drive_torque_limit':
                max(limits.torque_limit, limits.drive_torque_limit) / joint.torque_ratio,
            'speed_limit': joint.gear_ratio * limits.speed_limit,
            'watchdog': self.connection.watchdog, **self.drive}, f'{self.name}: drive')


def read_hardware(content: Mapping[str, Any], where: str) -> Hardware:
    """
    Return the hardware of a mapping; see `load_hardware`.

    Raises `ConfigurationError` naming section, field, value and allowed range.
    """
    refuse_unknown(content, ('name', 'robot', 'drive', 'steering', *SECTIONS), where)
    given = {name: expect_mapping(content.get(name, {}), f'{where}: {name}') for name in SECTIONS}
    names = {name: content[name] for name in ('name', 'robot') if name in content}
    refuse_missing([(HardwareNames, names, where)] + [
        (cls, given[name], f'{where}: {name}') for name, cls in SECTIONS.items()])
    HardwareNames.from_mapping(names, where)
    parts: dict[str, Any] = {}
    provenance: dict[str, Provenance] = {}
    for name, cls in SECTIONS.items():
        place = f'{where}: {name}'
        values, sources = read_values(cls, given[name], place)
        parts[name] = build(cls, values, place)
        provenance.update({f'{name}.{key}': item for key, item in sources.items()})
    protocol = parts['connection'].protocol
    parts['drive'], of_drive = _read_drive(protocol, content, where)
    provenance.update({f'drive.{key}': item for key, item in of_drive.items()})
    if 'steering' in content:
        place = f'{where}: steering'
        mapping = dict(expect_mapping(content['steering'], place))
        drive, of_drive = _read_drive(protocol, mapping, place)
        mapping.pop('drive', None)
        values, more = read_values(SteeringAxis, mapping, place)
        parts['steering'] = build(SteeringAxis, {**values, 'drive': drive}, place)
        provenance.update({f'steering.{key}': item for key, item in more.items()})
        provenance.update({f'steering.drive.{key}': item for key, item in of_drive.items()})
    return Hardware(content['name'], content['robot'],
                    provenance=MappingProxyType(provenance), **parts)


def _read_drive(protocol: str, content: Mapping[str, Any], where: str
                ) -> Tuple[Mapping[str, Any], Mapping[str, Provenance]]:
    """Return the driver options in a section `drive`, and their provenance."""
    place = f'{where}: drive'
    given = expect_mapping(content.get('drive', {}), place)
    _refuse_set_elsewhere(given, place)
    drive, sources = read_values(
        driver_class(protocol).Options, {'torque_limit': 1.0, **given}, place)
    del drive['torque_limit']  # derived from the limit of the pendulum
    return MappingProxyType(drive), sources


def _refuse_set_elsewhere(drive: Mapping[str, Any], where: str) -> None:
    for name, place in SET_ELSEWHERE.items():
        if name in drive:
            raise ConfigurationError(
                f'{where}: {name} follows from {place}, its only definition: remove '
                'it here', 'inconsistent', name)


def load_hardware(name_or_path: str) -> Hardware:
    """
    Read a hardware file of the package by name, or a custom file by path.

    Values have a source, like those of robots (`physics.robot.load_robot`).

    Raises `ConfigurationError` naming file, section, field, value and allowed range.
    """
    path, content = read_config('hardware', name_or_path)
    return read_hardware(content, str(path))
