# SPDX-License-Identifier: Apache-2.0
"""Read what a run has published from a bag; needs no ROS installation."""
from contextlib import contextmanager
from pathlib import Path
import sqlite3
import struct
from typing import (
    Any, Callable, Collection, ContextManager, Dict, Iterator, List, Mapping, Optional, Protocol,
    Tuple)

import numpy as np
import yaml

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.studies.recording import Recording

# What a reader stumbles over in bytes that are no bag, or none any more.
UNREADABLE = (ArithmeticError, AssertionError, AttributeError, EOFError, LookupError, OSError,
              RuntimeError, TypeError, ValueError, sqlite3.Error, struct.error)


class Bag(Protocol):
    """
    An open bag.

    Attributes
    ----------
    topics : mapping of str to str
        Types of the messages, such as ``'sensor_msgs/msg/JointState'``, by topic.
    metadata : mapping of str to str
        Written by the recorder.

    """

    @property
    def topics(self) -> Mapping[str, str]:
        """Return types by topic."""

    @property
    def metadata(self) -> Mapping[str, str]:
        """Return texts by key."""

    def messages(self, topics: Collection[str]) -> Iterator[Tuple[str, Any]]:
        """Give topic and message in the order of the bag; `ConfigurationError` where damaged."""


BagOpener = Callable[[Path], ContextManager[Bag]]


def unreadable(path: Path, error: BaseException) -> ConfigurationError:
    """Return what to say of a bag that cannot be read."""
    if 'magic' in str(error):
        return ConfigurationError(
            f'{path}: is no bag that can be read, or one that was cut short ({error}); what was '
            'recorded before its end can be had with "mcap recover"', 'unreadable')
    return ConfigurationError(
        f'{path}: is no bag that can be read: {error or repr(error)}', 'unreadable')


def custom_data(path: Path) -> Mapping[str, str]:
    """Return the texts in the ``metadata.yaml`` of a bag; none where there is no such file."""
    file = path / 'metadata.yaml'
    if not file.is_file():
        return {}
    try:
        content = yaml.safe_load(file.read_text(encoding='utf-8'))
        texts = content['rosbag2_bagfile_information'].get('custom_data') or {}
        return {str(key): str(text) for key, text in texts.items()}
    except (*UNREADABLE, yaml.YAMLError) as error:
        raise unreadable(path, error) from error


class _RosbagsBag:
    """A bag that the Python package rosbags has opened."""

    def __init__(self, path: Path, reader: Any, metadata: Mapping[str, str]):
        self._path, self._reader, self.metadata = path, reader, metadata
        self.topics: Mapping[str, str] = {
            connection.topic: connection.msgtype for connection in reader.connections}

    def messages(self, topics: Collection[str]) -> Iterator[Tuple[str, Any]]:
        """Give topic and message."""
        from rosbags.highlevel import AnyReaderError
        wanted = [connection for connection in self._reader.connections
                  if connection.topic in topics]
        try:
            for connection, _, data in self._reader.messages(wanted) if wanted else ():
                yield connection.topic, self._reader.deserialize(data, connection.msgtype)
        except (AnyReaderError, *UNREADABLE) as error:
            raise unreadable(self._path, error) from error


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """
    Open a ROS 2 bag, MCAP or SQLite, a folder or its one file.

    Raises
    ------
    ConfigurationError
        If it cannot be read.

    """
    from rosbags.highlevel import AnyReader, AnyReaderError
    from rosbags.typesys import get_typestore, Stores
    metadata = custom_data(path)
    reader: Any = None
    try:
        reader = AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY))
        reader.open()
    except (AnyReaderError, *UNREADABLE) as error:
        raise unreadable(path, error) from error
    try:
        yield _RosbagsBag(path, reader, metadata)
    finally:
        reader.close()


def read_bag(path: Path, opener: BagOpener = open_bag) -> Recording:
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
    with opener(path) as bag:
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


def joint_values(message: Any) -> Dict[str, float]:
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
            values['pendulum_torque'] = float(message.effort[place])
    return values


def odometry_values(message: Any) -> Dict[str, float]:
    """Return position and speed of a nav_msgs/Odometry, in the plane of the model."""
    place, speed = message.pose.pose.position, message.twist.twist.linear
    return {'x': float(place.x), 'y': float(place.z),
            'velocity_x': float(speed.x), 'velocity_y': float(speed.z)}
