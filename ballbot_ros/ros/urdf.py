# SPDX-License-Identifier: Apache-2.0
"""
A robot file as a robot description (URDF), with simple shapes only; importable without ROS.

Joints turn about -y: seen with +x to the right and z up, that is counter-clockwise, as all
angles of this package are (docs/model.md).
"""
import math
from typing import Any, Sequence
from xml.etree import ElementTree as Xml

from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.ros.frames import FRAMES, Frames, LEAN, PENDULUM, SHELL, TILT

AXIS = (0.0, -1.0, 0.0)
# Lean is positive to the left, tilt with the left end of the axle down.
LEAN_AXIS, TILT_AXIS = (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)
# Drawn band on which the ball rolls, in two alternating colours, to show the rotation.
BAND_SEGMENTS = 16
BAND_WIDTH, BAND_THICKNESS = 0.16, 0.02  # fractions of the radius
ROD_RADIUS = 0.03  # fraction of the radius
DENSITY = 7850.0  # of the drawn pendulum weight: steel [kg/m3]
COLOURS = {'shell': (0.75, 0.82, 0.9, 0.35), 'dark': (0.1, 0.25, 0.4, 1.0),
           'light': (0.95, 0.95, 0.9, 1.0), 'mark': (0.85, 0.2, 0.1, 1.0),
           'rod': (0.5, 0.5, 0.5, 1.0), 'weight': (0.85, 0.45, 0.05, 1.0)}


def robot_description(robot: Robot, frames: Frames = FRAMES, steers: bool = False) -> str:
    """
    Return a robot as URDF; robot_state_publisher should add a prefix of the links.

    A robot that steers has the joints ``tilt`` of the axle and ``lean`` of the pendulum.  Masses,
    inertia and limits of the motor are those of the robot file.  The moments of inertia about the
    two other axes, which do not matter for planar motion, are set to the same value.
    """
    tree = Xml.Element('robot', name=robot.name)
    for name, colour in COLOURS.items():
        Xml.SubElement(Xml.SubElement(tree, 'material', name=name), 'color', rgba=_row(colour))
    Xml.SubElement(tree, 'link', name=frames.base)
    Xml.SubElement(tree, 'link', name=frames.footprint)
    _joint(tree, 'footprint', 'fixed', frames.base, frames.footprint,
           (0.0, 0.0, -robot.ball_radius))
    tree.append(_ball(robot, frames.ball))
    base = frames.base
    if steers:
        base = frames.axle
        Xml.SubElement(tree, 'link', name=base)
        _joint(tree, TILT, 'continuous', frames.base, base, axis=TILT_AXIS)
    shell = _joint(tree, SHELL, 'continuous', base, frames.ball)
    Xml.SubElement(shell, 'dynamics', damping=_number(robot.rolling_friction))
    Xml.SubElement(tree, 'link', name=frames.imu)
    _joint(tree, 'imu', 'fixed', frames.ball, frames.imu)
    if robot.has_pendulum:
        tree.append(_pendulum(robot, frames.pendulum))
        below = frames.pendulum
        if steers and robot.steering is not None:
            below, limits = frames.carrier, robot.steering
            Xml.SubElement(tree, 'link', name=below)
            lean = _joint(tree, LEAN, 'revolute', below, frames.pendulum, axis=LEAN_AXIS)
            Xml.SubElement(lean, 'limit', lower=_number(-limits.largest_lean),
                           upper=_number(limits.largest_lean),
                           effort=_number(limits.largest_torque),
                           velocity=_number(limits.largest_lean_rate))
        pendulum = _joint(tree, PENDULUM, 'continuous', frames.ball, below)
        if robot.motor is not None:
            # URDF has no infinity; 1e3 rad/s is faster than any motor.
            highest = robot.motor.no_load_rate
            Xml.SubElement(pendulum, 'limit', effort=_number(robot.motor.maximum_torque),
                           velocity=_number(highest if math.isfinite(highest) else 1e3))
        Xml.SubElement(pendulum, 'dynamics', damping=_number(robot.joint_friction))
    Xml.indent(tree)
    return '<?xml version="1.0"?>\n' + Xml.tostring(tree, encoding='unicode') + '\n'


def _ball(robot: Robot, name: str) -> Xml.Element:
    """Return the shell: a transparent sphere with a band around it."""
    link = _link(name, robot.ball_mass, robot.ball_inertia)
    radius = robot.ball_radius
    for kind in ('visual', 'collision'):
        shape = _shape(link, kind, 'sphere', radius=radius)
        if kind == 'visual':
            Xml.SubElement(shape, 'material', name='shell')
    length = 2.0 * radius * math.tan(math.pi / BAND_SEGMENTS)
    for number in range(BAND_SEGMENTS):
        angle = 2.0 * math.pi * number / BAND_SEGMENTS  # counter-clockwise from straight down
        patch = _shape(link, 'visual', 'box', _below(radius, angle), (0.0, -angle, 0.0),
                       size=(length, BAND_WIDTH * radius, BAND_THICKNESS * radius))
        # The patch that is lowest at angle 0 is marked, so that angles can be read.
        colour = ('dark' if number % 2 else 'light') if number else 'mark'
        Xml.SubElement(patch, 'material', name=colour)
    return link


def _below(distance: float, angle: float = 0.0) -> tuple[float, float, float]:
    """Return the point at a distance from the centre in the direction of a pendulum angle."""
    return distance * math.sin(angle), 0.0, -distance * math.cos(angle)


def _pendulum(robot: Robot, name: str) -> Xml.Element:
    """Return the pendulum: a rod, and at its centre of mass a steel ball of the same mass."""
    length, radius = robot.pendulum_length, robot.ball_radius
    link = _link(name, robot.pendulum_mass, robot.pendulum_inertia, _below(length))
    if length > 0.0:
        rod = _shape(link, 'visual', 'cylinder', _below(0.5 * length),
                     radius=ROD_RADIUS * radius, length=length)
        Xml.SubElement(rod, 'material', name='rod')
    drawn = (3.0 * robot.pendulum_mass / (4.0 * math.pi * DENSITY)) ** (1.0 / 3.0)
    weight = _shape(link, 'visual', 'sphere', _below(length),
                    radius=min(drawn, max(radius - length, 0.1 * radius)))
    Xml.SubElement(weight, 'material', name='weight')
    return link


def _link(name: str, mass: float, inertia: float,
          centre: Sequence[float] = (0.0, 0.0, 0.0)) -> Xml.Element:
    """Return a link with the same moment of inertia about all axes."""
    link = Xml.Element('link', name=name)
    inertial = Xml.SubElement(link, 'inertial')
    Xml.SubElement(inertial, 'origin', xyz=_row(centre), rpy='0 0 0')
    Xml.SubElement(inertial, 'mass', value=_number(mass))
    about = _number(inertia)
    Xml.SubElement(inertial, 'inertia', ixx=about, iyy=about, izz=about, ixy='0', ixz='0',
                   iyz='0')
    return link


def _shape(link: Xml.Element, kind: str, shape: str, xyz: Sequence[float] = (0.0, 0.0, 0.0),
           rpy: Sequence[float] = (0.0, 0.0, 0.0), **size: Any) -> Xml.Element:
    element = Xml.SubElement(link, kind)
    Xml.SubElement(element, 'origin', xyz=_row(xyz), rpy=_row(rpy))
    Xml.SubElement(Xml.SubElement(element, 'geometry'), shape, {
        name: _row(value) if isinstance(value, tuple) else _number(value)
        for name, value in size.items()})
    return element


def _joint(tree: Xml.Element, name: str, kind: str, parent: str, child: str,
           xyz: Sequence[float] = (0.0, 0.0, 0.0), axis: Sequence[float] = AXIS) -> Xml.Element:
    joint = Xml.SubElement(tree, 'joint', name=name, type=kind)
    Xml.SubElement(joint, 'parent', link=parent)
    Xml.SubElement(joint, 'child', link=child)
    Xml.SubElement(joint, 'origin', xyz=_row(xyz), rpy='0 0 0')
    if kind != 'fixed':
        Xml.SubElement(joint, 'axis', xyz=_row(axis))
    return joint


def _row(values: Sequence[float]) -> str:
    return ' '.join(_number(value) for value in values)


def _number(value: float) -> str:
    # Adding 0 removes the sign of a negative zero.
    return f'{round(value, 12) + 0.0:.9g}'
