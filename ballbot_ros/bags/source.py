# SPDX-License-Identifier: Apache-2.0
"""Read a bag with the rosbag2_py of a ROS installation, as `studies.bag_reader` does without."""
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Collection, Iterator, Mapping, Tuple

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.ros.topics import message_class


class Rosbag2Bag:
    """
    A bag that rosbag2_py has opened.

    Parameters
    ----------
    path : Path
    reader : rosbag2_py.SequentialReader
        Open.

    """

    def __init__(self, path: Path, reader: Any):
        """Ask for topics and metadata."""
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
            raise ConfigurationError(
                f'{self._path}: is no bag that can be read: {error}', 'unreadable') from error


@contextmanager
def open_bag(path: Path) -> Iterator[Rosbag2Bag]:
    """
    Open a bag, a folder or its one file.

    Raises
    ------
    ConfigurationError
        If it cannot be read.

    """
    import rosbag2_py
    reader = rosbag2_py.SequentialReader()
    try:
        reader.open(rosbag2_py.StorageOptions(uri=str(path), storage_id=''),
                    rosbag2_py.ConverterOptions('cdr', 'cdr'))
        bag = Rosbag2Bag(path, reader)
    except RuntimeError as error:
        raise ConfigurationError(
            f'{path}: is no bag that can be read: {error}', 'unreadable') from error
    yield bag
