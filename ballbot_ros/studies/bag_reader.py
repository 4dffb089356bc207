# SPDX-License-Identifier: Apache-2.0
"""Read what a run has published from a bag; needs no ROS installation."""
from pathlib import Path
from typing import Any, Dict, List, Optional, Tuple

import numpy as np
from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.typesys import get_typestore, Stores

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
        If the bag cannot be read, or has nothing of that.

    """
    found: Dict[str, Tuple[List[float], List[float]]] = {}
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
            wanted = [connection for connection in reader.connections
                      if connection.topic.rsplit('/', 1)[-1] in ('joint_states', 'odom')]
            for connection, _, data in reader.messages(wanted):
                message: Any = reader.deserialize(data, connection.msgtype)
                stamp = message.header.stamp
                time = stamp.sec + 1e-9 * stamp.nanosec
                values = _joints(message) if connection.msgtype.endswith('JointState') \
                    else _odometry(message)
                for name, value in values.items():
                    times, numbers = found.setdefault(name, ([], []))
                    if not times or time > times[-1]:  # a repeated message counts once
                        times.append(time)
                        numbers.append(value)
    except (AnyReaderError, OSError, KeyError, ValueError) as error:
        raise ConfigurationError(f'{path}: is no bag that can be read: {error}') from error
    if not found:
        raise ConfigurationError(f'{path}: has neither joint_states nor odom')
    begin = min(times[0] for times, _ in found.values())
    series = {name: (np.array(times) - begin, np.array(values))
              for name, (times, values) in found.items()}
    torque: Optional[Any] = series.pop('torque', None)
    return Recording(series, torque)


def _joints(message: Any) -> Dict[str, float]:
    """Return angles, rates and torque of a sensor_msgs/JointState."""
    values = {}
    for place, joint in enumerate(message.name):
        part = {'shell': 'ball', 'pendulum': 'joint'}.get(joint)
        if part is None:
            continue
        for kind, numbers in (('angle', message.position), ('rate', message.velocity)):
            if place < len(numbers):
                values[f'{part}_{kind}'] = float(numbers[place])
        if part == 'joint' and place < len(message.effort):
            values['torque'] = float(message.effort[place])
    return values


def _odometry(message: Any) -> Dict[str, float]:
    """Return position and speed of a nav_msgs/Odometry."""
    return {'x': float(message.pose.pose.position.x),
            'velocity_x': float(message.twist.twist.linear.x)}
