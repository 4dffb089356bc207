# SPDX-License-Identifier: Apache-2.0
"""
Open a bag, MCAP or SQLite, with the library that is installed.

The Python package rosbags needs no ROS installation; without it the rosbag2_py of ROS is used.
"""
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
import sqlite3
import struct
from typing import Any, Collection, Iterator, Mapping, Tuple, Union

import yaml

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.ros.topics import message_class

MISSING = ('bags need the Python package rosbags (pip install rosbags), or the ROS package '
           'rosbag2_py with its MCAP storage; neither is installed')
BAG_SUFFIXES = ('.mcap', '.db3')
MCAP_MAGIC = b'\x89MCAP0\r\n'  # an MCAP file begins with it
# Errors of a reader for bytes that are not a bag, or a damaged one.
READER_ERRORS = (ArithmeticError, AssertionError, AttributeError, EOFError, LookupError, OSError,
                 RuntimeError, TypeError, ValueError, sqlite3.Error, struct.error)


def is_bag(path: Path) -> bool:
    """Return whether a path looks like a bag: its one file, or a folder with one or its index."""
    if path.is_dir():
        return (path / 'metadata.yaml').exists() or any(
            file.suffix in BAG_SUFFIXES for file in path.iterdir())
    return path.suffix in BAG_SUFFIXES


def unreadable(path: Path, error: BaseException) -> ConfigurationError:
    """Return the error for a bag that cannot be read."""
    if path.is_dir() and not is_bag(path):
        return ConfigurationError(
            f'{path}: contains neither metadata.yaml nor a file ending in '
            f'{" or ".join(BAG_SUFFIXES)}, so it is not a bag', 'unreadable', str(path))
    file = path.suffix == '.mcap' and path.is_file() and not isinstance(error, OSError)
    if file:
        with path.open('rb') as stream:
            if stream.read(len(MCAP_MAGIC)) != MCAP_MAGIC:
                return ConfigurationError(
                    f'{path}: is not an MCAP bag; "ballbot record" and "ros2 bag record" write '
                    'bags', 'wrong_kind', str(path))
    hint = '; "mcap recover" recovers the messages of a truncated bag' \
        if file or 'magic' in str(error) else ''
    return ConfigurationError(
        f'{path}: is not a readable bag: {str(error) or repr(error)}{hint}',
        'unreadable', str(path))


def custom_data(path: Path) -> Mapping[str, str]:
    """Return the texts in the ``metadata.yaml`` of a bag; none where there is no such file."""
    file = path / 'metadata.yaml'
    if not file.is_file():
        return {}
    try:
        content = yaml.safe_load(file.read_text(encoding='utf-8'))
        texts = content['rosbag2_bagfile_information'].get('custom_data') or {}
        return {str(key): str(text) for key, text in texts.items()}
    except (*READER_ERRORS, yaml.YAMLError) as error:
        raise unreadable(path, error) from error


class RosbagsBag:
    """
    A bag that the Python package rosbags has opened.

    Attributes
    ----------
    topics : mapping of str to str
        Types of the messages, such as ``'sensor_msgs/msg/JointState'``, by topic.
    metadata : mapping of str to str
        Written by the recorder.

    """

    def __init__(self, path: Path, reader: Any, metadata: Mapping[str, str]):
        self._path, self._reader, self.metadata = path, reader, metadata
        self.topics: Mapping[str, str] = {
            connection.topic: connection.msgtype for connection in reader.connections}

    def messages(self, topics: Collection[str]) -> Iterator[Tuple[str, Any]]:
        """Give topic and message in the order of the bag; `ConfigurationError` where damaged."""
        from rosbags.highlevel import AnyReaderError
        wanted = [connection for connection in self._reader.connections
                  if connection.topic in topics]
        try:
            for connection, _, data in self._reader.messages(wanted) if wanted else ():
                yield connection.topic, self._reader.deserialize(data, connection.msgtype)
        except (AnyReaderError, *READER_ERRORS) as error:
            raise unreadable(self._path, error) from error


@contextmanager
def _open_with_rosbags(path: Path) -> Iterator[RosbagsBag]:
    from rosbags.highlevel import AnyReader, AnyReaderError
    from rosbags.typesys import get_typestore, Stores
    metadata = custom_data(path)
    reader: Any = None
    try:
        reader = AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY))
        reader.open()
    except (AnyReaderError, *READER_ERRORS) as error:
        raise unreadable(path, error) from error
    try:
        yield RosbagsBag(path, reader, metadata)
    finally:
        reader.close()


class Rosbag2Bag:
    """
    A bag that rosbag2_py has opened.

    Parameters
    ----------
    reader : rosbag2_py.SequentialReader
        Open.

    """

    def __init__(self, path: Path, reader: Any):
        self._path, self._reader = path, reader
        self.topics: Mapping[str, str] = {
            topic.name: topic.type for topic in reader.get_all_topics_and_types()}
        self.metadata: Mapping[str, str] = dict(
            getattr(reader.get_metadata(), 'custom_data', None) or {})

    def messages(self, topics: Collection[str]) -> Iterator[Tuple[str, Any]]:
        """Give topic and message in the order of the bag; `ConfigurationError` where damaged."""
        from rclpy.serialization import deserialize_message
        kinds = {topic: message_class(self.topics[topic]) for topic in topics
                 if topic in self.topics}
        try:
            while self._reader.has_next():
                topic, data, _ = self._reader.read_next()
                if topic in kinds:
                    yield topic, deserialize_message(data, kinds[topic])
        except RuntimeError as error:
            raise unreadable(self._path, error) from error


def _open_with_rosbag2(path: Path) -> Rosbag2Bag:
    import rosbag2_py
    reader = rosbag2_py.SequentialReader()
    try:
        reader.open(rosbag2_py.StorageOptions(uri=str(path), storage_id=''),
                    rosbag2_py.ConverterOptions('cdr', 'cdr'))
        return Rosbag2Bag(path, reader)
    except RuntimeError as error:
        raise unreadable(path, error) from error


Bag = Union[RosbagsBag, Rosbag2Bag]


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """
    Open a ROS 2 bag, a folder or its one file.

    Raises `ConfigurationError` if it cannot be read, or if nothing is installed that reads bags.
    """
    if find_spec('rosbags') is not None:
        with _open_with_rosbags(path) as bag:
            yield bag
    elif find_spec('rosbag2_py') is not None:
        yield _open_with_rosbag2(path)
    else:
        raise ConfigurationError(MISSING, 'not_installed', 'rosbags')
