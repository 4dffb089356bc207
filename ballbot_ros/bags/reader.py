# SPDX-License-Identifier: Apache-2.0
"""Read joint states and odometry from a bag."""
from pathlib import Path
from typing import Any, Dict, List, Optional, Tuple

import numpy as np

from ballbot_ros.bags.opener import open_bag
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.studies.recording import Recording


def read_bag(path: Path) -> Recording:
    """
    Return the recording in a ROS 2 bag, MCAP or SQLite.

    Joints ``shell`` and ``pendulum`` of a topic ``joint_states`` give angles, rates and torque,
    a topic ``odom`` gives the position and speed of the centre.  Times count from the first stamp.

    Raises
    ------
    ConfigurationError
        If the bag cannot be read, or has neither.

    """
    found: Dict[str, Tuple[List[float], List[float]]] = {}
    with open_bag(path) as bag:
        wanted = [topic for topic in bag.topics
                  if topic.rsplit('/', 1)[-1] in ('joint_states', 'odom')]
        for topic, message in bag.messages(wanted):
            stamp = message.header.stamp
            time = stamp.sec + 1e-9 * stamp.nanosec
            values = joint_values(message) if topic.endswith('joint_states') \
                else odometry_values(message)
            for name, value in values.items():
                if name not in ('ball_angle', 'ball_rate', 'joint_angle', 'joint_rate', 'x',
                                'velocity_x', 'pendulum_torque'):
                    continue
                times, numbers = found.setdefault(name, ([], []))
                if not times or time > times[-1]:  # a repeated message counts once
                    times.append(time)
                    numbers.append(value)
    if not found:
        raise ConfigurationError(
            f'{path}: has neither joint_states nor odom', 'missing', 'joint_states')
    begin = min(times[0] for times, _ in found.values())
    series = {name: (np.array(times) - begin, np.array(values))
              for name, (times, values) in found.items()}
    torque: Optional[Any] = series.pop('pendulum_torque', None)
    return Recording(series, torque)


# Names of angle and rate of each joint.
JOINT_VALUES = {
    'shell': ('ball_angle', 'ball_rate'), 'pendulum': ('joint_angle', 'joint_rate'),
    'lean': ('lean', 'lean_rate'), 'tilt': ('tilt', 'tilt_rate'), 'yaw': ('heading', 'yaw_rate')}


def joint_values(message: Any) -> Dict[str, float]:
    """Return angles, rates and torque of a sensor_msgs/JointState."""
    values = {}
    for place, joint in enumerate(message.name):
        names = JOINT_VALUES.get(joint)
        if names is None:
            continue
        for name, numbers in zip(names, (message.position, message.velocity)):
            if place < len(numbers):
                values[name] = float(numbers[place])
        if joint == 'pendulum' and place < len(message.effort):
            values['pendulum_torque'] = float(message.effort[place])
    return values


def odometry_values(message: Any) -> Dict[str, float]:
    """Return position and speed of a nav_msgs/Odometry, in the plane of the model."""
    place, speed = message.pose.pose.position, message.twist.twist.linear
    return {'x': float(place.x), 'y': float(place.z),
            'velocity_x': float(speed.x), 'velocity_y': float(speed.z)}
