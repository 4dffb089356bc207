# SPDX-License-Identifier: Apache-2.0
"""
Names of the coordinate frames of a robot; importable without ROS.

In the tree, each frame is a child of the frame before it::

    odom ── base_link ── ball_link ── pendulum_link
                │            └─────── imu_link
                └─────── base_footprint

``odom`` is fixed, ``base_link`` and ``base_footprint`` are level.  The joint ``shell`` turns
``ball_link``, in which the joint ``pendulum`` turns ``pendulum_link``.

A robot that turns on a floor has ``axle_link`` between base and ball, which the joint ``tilt``
turns, and ``carrier_link`` between ball and pendulum, in which the joint ``lean`` turns the
pendulum sideways.
"""
from dataclasses import dataclass
from typing import Any

from ballbot_ros.config.fields import fixed, flag, text

SHELL, PENDULUM = JOINTS = 'shell', 'pendulum'
# Additional joints of a robot that turns: lean of the pendulum, tilt of the axle, and yaw of the
# base; yaw is in joint_states for the controller, but is not a joint of the description.
LEAN, TILT, YAW = LATERAL = 'lean', 'tilt', 'yaw'


@dataclass(frozen=True)
class Frames:
    """Names of the frames, each with the prefix."""

    odom: str = 'odom'  # fixed: x forward, y left, z up, with the origin at the start of the robot
    footprint: str = 'base_footprint'  # level, at the lowest point of the ball
    base: str = 'base_link'  # level, at the centre of the ball; does not roll
    # The sensor in the shell; its readings are already rotated to the axes of `ball`.
    imu: str = 'imu_link'
    ball: str = 'ball_link'  # the shell, which rolls; parallel to `base` at angle 0
    pendulum: str = 'pendulum_link'  # from the centre of the ball; hangs along its -z
    axle: str = 'axle_link'  # level except for the tilt of the axle
    carrier: str = 'carrier_link'  # turns with the pendulum, but does not lean with it
    map: str = 'map'  # of the floor; without the prefix

    @classmethod
    def of(cls, settings: Any, prefixed: bool = True) -> 'Frames':
        """Return the frames that the parameters of a node name, with the prefix or without."""
        prefix = settings.frame_prefix if prefixed else ''
        names = {kind: prefix + getattr(settings, f'{kind}_frame', default)
                 for kind, default in vars(FRAMES).items()}
        # Robots share a map.
        return cls(**{**names, 'map': getattr(settings, 'map_frame', FRAMES.map)})


FRAMES = Frames()

FIXED_REASON = 'other nodes may already use it'
_DOCS = {
    'odom': 'fixed frame of the odometry',
    'map': 'frame of the floor, a parent of odom_frame; empty to publish none',
    'footprint': 'level frame at the lowest point of the ball',
    'base': 'level frame at the centre of the ball, which does not roll; a child of odom_frame',
    'imu': 'frame of the inertial sensor, which rolls with the shell'}


def described() -> Any:
    """Declare the parameter that selects the publisher of the link transforms."""
    return fixed('the topics are created at the start', flag(
        'publish robot_description, and the links on /tf and /tf_static; false if '
        'robot_state_publisher does', default=True))


def marked(content: str) -> Any:
    """Declare the parameter that enables markers."""
    return fixed('the topic is created at the start', flag(
        f'publish {content} on markers, 10 times a second while there is a subscription',
        default=True))


def frame(kind: str) -> Any:
    """Declare the parameter for the name of a frame."""
    return fixed(FIXED_REASON, text(_DOCS[kind], default=getattr(FRAMES, kind)))


def frame_prefix() -> Any:
    """Declare the parameter for the prefix of all frames."""
    return fixed(FIXED_REASON, text(
        'prefix of the name of each frame, such as `left/` with several robots', default=''))
