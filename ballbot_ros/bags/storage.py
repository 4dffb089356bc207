# SPDX-License-Identifier: Apache-2.0
"""What writes a bag: the Python package rosbags, or the rosbag2_py of a ROS installation."""
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Dict, Mapping, Protocol, Sequence

from ballbot_ros.bags.opener import MISSING
from ballbot_ros.config.files import PACKAGE, shipped_folder
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.ros.topics import Qos


class BagWriter(Protocol):
    """Writes serialized messages to an MCAP bag."""

    def open(self) -> None:
        """Begin."""

    def add_topic(self, name: str, kind: str, offered: Sequence[Qos] = ()) -> Any:
        """Return what `write` takes for a topic; `offered` is the QoS of its publishers."""

    def write(self, topic: Any, stamp: int, data: bytes) -> None:
        """Write a message of a topic at a time [ns]."""

    def close(self) -> None:
        """Complete the bag."""


def bag_writer(folder: Path, metadata: Mapping[str, str]) -> BagWriter:
    """
    Return a writer for a new bag.

    Parameters
    ----------
    folder : Path
        That does not exist yet.
    metadata : mapping of str to str
        Kept in the bag.

    Raises
    ------
    ConfigurationError
        If there is nothing to write bags with.

    """
    if find_spec('rosbags') is not None:
        return RosbagsWriter(folder, metadata)
    if find_spec('rosbag2_py') is not None:
        return Rosbag2Writer(folder, metadata)
    raise ConfigurationError(MISSING, 'not_installed', 'rosbag2_py')


class RosbagsWriter:
    """Writes with the Python package rosbags; see `bag_writer`."""

    def __init__(self, folder: Path, metadata: Mapping[str, str]):
        """Learn the message types."""
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import get_types_from_msg, get_typestore, Stores
        self._store = get_typestore(Stores.ROS2_JAZZY)
        own: Dict[str, Any] = {}
        for file in sorted(shipped_folder('msg').glob('*.msg')):
            own.update(get_types_from_msg(file.read_text(), f'{PACKAGE}/msg/{file.stem}'))
        self._store.register(own)
        self._writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
        for key, value in metadata.items():
            self._writer.set_custom_data(key, value)

    def open(self) -> None:
        """Begin."""
        self._writer.open()

    def add_topic(self, name: str, kind: str, offered: Sequence[Qos] = ()) -> Any:
        """Return the connection."""
        return self._writer.add_connection(name, kind, typestore=self._store,
                                           offered_qos_profiles=[_rosbags_qos(one)
                                                                 for one in offered])

    def write(self, topic: Any, stamp: int, data: bytes) -> None:
        """Write a message."""
        self._writer.write(topic, stamp, data)

    def close(self) -> None:
        """Complete the bag."""
        self._writer.close()


def _rosbags_qos(offered: Qos) -> Any:
    from rosbags import interfaces as one
    unlimited = one.QosTime(9223372036, 854775807)  # the infinite duration of rmw
    return one.Qos(
        one.QosHistory.KEEP_LAST, offered.depth,
        one.QosReliability.RELIABLE if offered.reliable else one.QosReliability.BEST_EFFORT,
        one.QosDurability.TRANSIENT_LOCAL if offered.latched else one.QosDurability.VOLATILE,
        unlimited, unlimited, one.QosLiveliness.AUTOMATIC, unlimited, False)


class Rosbag2Writer:
    """Writes with rosbag2_py, which finds message types by itself; see `bag_writer`."""

    def __init__(self, folder: Path, metadata: Mapping[str, str]):
        """Keep the folder for `open`."""
        import rosbag2_py
        self._rosbag2: Any = rosbag2_py
        self._storage = rosbag2_py.StorageOptions(uri=str(folder), storage_id='mcap',
                                                  custom_data=dict(metadata))
        self._writer: Any = rosbag2_py.SequentialWriter()
        self._topics = 0

    def open(self) -> None:
        """Begin; `ConfigurationError` where there is no storage plugin for MCAP."""
        try:
            self._writer.open(self._storage, self._rosbag2.ConverterOptions('cdr', 'cdr'))
        except RuntimeError as error:
            raise ConfigurationError(f'{self._storage.uri}: rosbag2_py cannot write: {error}; '
                                     'is ros-...-rosbag2-storage-mcap installed?',
                                     'not_writable', str(self._storage.uri)) from error

    def add_topic(self, name: str, kind: str, offered: Sequence[Qos] = ()) -> str:
        """Return the name."""
        self._topics += 1
        self._writer.create_topic(self._rosbag2.TopicMetadata(
            id=self._topics, name=name, type=kind, serialization_format='cdr',
            offered_qos_profiles=[self._qos(one) for one in offered]))
        return name

    def _qos(self, offered: Qos) -> Any:
        found = self._rosbag2._storage.QoS(offered.depth)
        found = found.reliable() if offered.reliable else found.best_effort()
        return found.transient_local() if offered.latched else found

    def write(self, topic: str, stamp: int, data: bytes) -> None:
        """Write a message."""
        self._writer.write(topic, data, stamp)

    def close(self) -> None:
        """Complete the bag."""
        self._writer = None  # its destructor completes the bag, in every distribution
