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
from typing import Any, Callable, Collection, Iterator, Mapping, NamedTuple, Tuple

import yaml

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.ros.topics import message_class

MISSING = ('bags need the Python package rosbags (pip install rosbags), or the ROS package '
           'rosbag2_py with its MCAP storage; neither is installed')
BAG_SUFFIXES = ('.mcap', '.db3')
MCAP_MAGIC = b'\x89MCAP0\r\n'  # an MCAP file begins with it
# Errors that readers raise for data that are not a bag, or for a damaged bag.
READER_ERRORS = (ArithmeticError, AssertionError, AttributeError, EOFError, LookupError,
                 MemoryError, OSError, RuntimeError, TypeError, ValueError, sqlite3.Error,
                 struct.error)


def is_bag(path: Path) -> bool:
    """Return whether a path looks like a bag: a file, or a folder with one or with an index."""
    if path.is_dir():
        return (path / 'metadata.yaml').exists() or any(
            file.suffix in BAG_SUFFIXES for file in path.iterdir())
    return path.suffix in BAG_SUFFIXES


def unreadable(path: Path, error: BaseException) -> ConfigurationError:
    """Return the error for a bag that cannot be read."""
    if not path.exists():
        return ConfigurationError(f'{path}: does not exist', 'unreadable', str(path))
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
    """Return the texts in the ``metadata.yaml`` of a bag; none without such a file."""
    file = path / 'metadata.yaml'
    if not file.is_file():
        return {}
    try:
        content = yaml.safe_load(file.read_text(encoding='utf-8'))
        texts = content['rosbag2_bagfile_information'].get('custom_data') or {}
        return {str(key): str(text) for key, text in texts.items()}
    except (*READER_ERRORS, yaml.YAMLError) as error:
        raise unreadable(path, error) from error


class Bag(NamedTuple):
    topics: Mapping[str, str]  # types of the messages, such as ``sensor_msgs/msg/JointState``
    metadata: Mapping[str, str]  # written by the recorder
    # Yields name and message of the given topics in the order of the bag; raises
    # `ConfigurationError` if the bag is damaged.
    messages: Callable[[Collection[str]], Iterator[Tuple[str, Any]]]


@contextmanager
def _open_with_rosbags(path: Path) -> Iterator[Bag]:
    from rosbags.highlevel import AnyReader, AnyReaderError
    from rosbags.typesys import get_typestore, Stores
    errors = (AnyReaderError, *READER_ERRORS)
    metadata = custom_data(path)
    try:
        reader = AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY))
        reader.open()
    except errors as error:
        raise unreadable(path, error) from error

    def messages(topics: Collection[str]) -> Iterator[Tuple[str, Any]]:
        wanted = [connection for connection in reader.connections if connection.topic in topics]
        try:
            for connection, _, data in reader.messages(wanted) if wanted else ():
                yield connection.topic, reader.deserialize(data, connection.msgtype)
        except errors as error:
            raise unreadable(path, error) from error
    try:
        yield Bag({connection.topic: connection.msgtype for connection in reader.connections},
                  metadata, messages)
    finally:
        reader.close()


def _open_with_rosbag2(path: Path) -> Bag:
    from rclpy.serialization import deserialize_message
    import rosbag2_py
    reader = rosbag2_py.SequentialReader()
    try:
        reader.open(rosbag2_py.StorageOptions(uri=str(path), storage_id=''),
                    rosbag2_py.ConverterOptions('cdr', 'cdr'))
        types = {topic.name: topic.type for topic in reader.get_all_topics_and_types()}
        metadata = dict(getattr(reader.get_metadata(), 'custom_data', None) or {})
    except RuntimeError as error:
        raise unreadable(path, error) from error

    def messages(topics: Collection[str]) -> Iterator[Tuple[str, Any]]:
        kinds = {topic: message_class(types[topic]) for topic in topics if topic in types}
        try:
            while reader.has_next():
                topic, data, _ = reader.read_next()
                if topic in kinds:
                    yield topic, deserialize_message(data, kinds[topic])
        except RuntimeError as error:
            raise unreadable(path, error) from error
    return Bag(types, metadata, messages)


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """Open a bag by its folder or file; raise `ConfigurationError` if it cannot be read."""
    if find_spec('rosbags') is not None:
        with _open_with_rosbags(path) as bag:
            yield bag
    elif find_spec('rosbag2_py') is not None:
        yield _open_with_rosbag2(path)
    else:
        raise ConfigurationError(MISSING, 'not_installed', 'rosbags')
