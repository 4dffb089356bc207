# SPDX-License-Identifier: Apache-2.0
"""Record topics into an MCAP bag for `ros2 bag`, Foxglove and PlotJuggler."""
from importlib.util import find_spec
from pathlib import Path
import shutil
import struct
import threading
import time
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Tuple

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from ballbot_ros.bags.opener import MISSING
from ballbot_ros.config.files import PACKAGE, shipped_folder
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.ros import qos
from ballbot_ros.ros.endpoints import create_subscription
from ballbot_ros.ros.rclpy_compat import take_all
from ballbot_ros.ros.topics import message_class, Qos, TOPICS

# CDR: four bytes of encapsulation, then the first field.
CDR_HEADER_SIZE, CDR_COUNT_SIZE = 4, 4
_STAMP, _COUNT = struct.Struct('<iI'), struct.Struct('<I')
STAMPED = ('std_msgs/Header', 'builtin_interfaces/Time')
SEQUENCES = ('sequence<geometry_msgs/TransformStamped>', 'sequence<visualization_msgs/Marker>')
# Messages of these types carry wall time, even if the robot uses another clock.
WALL_TIME_MESSAGES = ('DiagnosticArray', 'Log')

StampOf = Callable[[bytes], int]
# Period at which a recorder with a separate thread takes messages [s].
POLL_PERIOD = 0.002


def offered_qos(node: Node, topic: str) -> List[Qos]:
    """
    Return the quality of service with which a topic is published, for its replay.

    It is that of the publishers in the graph or, before there are any, of the table of topics.
    Discovery does not transmit the depth, which is therefore taken from the table.
    """
    known = TOPICS.get(topic) or TOPICS.get(topic.rpartition('/')[2])
    offered = {qos.of(one.qos_profile, known.offered.depth if known is not None
                      else max(one.qos_profile.depth, 1))
               for one in node.get_publishers_info_by_topic(topic)}
    return sorted(offered) or ([known.offered] if known is not None else [])


class BagRecorder:
    """
    Writes serialized messages on arrival into a new bag, with the stamp of their header.

    Messages without a stamp, or with a wall time, get the last stamp before them; see
    `stamp_reader`.  Messages are neither decoded nor encoded, which keeps recording cheap.  Use as
    a context manager: the bag is complete when it is closed, also after an error; an older bag in
    the folder is replaced.
    """

    def __init__(self, folder: Path, metadata: Optional[Mapping[str, str]] = None):
        shutil.rmtree(folder, ignore_errors=True)
        folder.parent.mkdir(parents=True, exist_ok=True)
        self.folder = folder
        self._writer = bag_writer(folder, metadata or {})
        self._subscriptions: List[Tuple[Subscription, Callable[[bytes], None]]] = []
        self.recorded: Dict[str, List[int]] = {}  # stamps by topic [ns]
        self._latest: Dict[str, int] = {}  # largest stamp by topic [ns]
        self.failure: Optional[Exception] = None  # error that ended the thread
        self._newest: Optional[int] = None  # latest stamp [ns]
        self._early: List[Callable[[], None]] = []  # writes before the first stamp
        self._taking, self._ending = threading.Lock(), threading.Event()
        self._thread: Optional[threading.Thread] = None

    def __enter__(self) -> 'BagRecorder':
        self._writer.open()
        return self

    def __exit__(self, *_: Any) -> None:
        self._ending.set()
        if self._thread is not None and self._thread.is_alive():  # a signal may end the start
            self._thread.join()
        if self._newest is None:
            self._newest = time.time_ns()
        self._write_early()
        self._writer.close()

    def subscribe(self, node: Node, topic: str,
                  callback: Optional[Callable[[bytes], None]] = None, kind: Any = None,
                  profile: Optional[QoSProfile] = None) -> None:
        """
        Record a topic to which a node subscribes.

        The callback also gets each serialized message, in the thread that takes it.  By default,
        type and profile are those of the table of topics, and no message is missed.
        """
        kind = kind or message_class(TOPICS[topic].type)
        type_name = f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}'
        full_name = node.resolve_topic_name(topic)
        connection = self._writer.add_topic(full_name, type_name, offered_qos(node, full_name))
        write = self._writing(topic, connection, stamp_reader(kind), callback)
        subscription = create_subscription(
            node, topic, write, kind, profile or qos.recording(topic), raw=True)
        self._subscriptions.append((subscription, write))

    def reached(self, stamps: Mapping[str, int]) -> bool:
        """
        Return whether each of these topics is recorded up to a stamp [ns].

        Delivery is reliable and in order, so all messages before it are recorded, too.  Publishers
        must run until then: undelivered messages are lost.
        """
        return all(self._latest.get(topic, -1) >= stamp for topic, stamp in stamps.items())

    def take_all(self) -> None:
        """
        Record all messages that have arrived.

        An executor takes one message per topic at each wake-up, and polls all
        topics again before the next one; on a busy machine that is too slow.
        """
        with self._taking:
            for subscription, write in self._subscriptions:
                for data in take_all(subscription):
                    write(data)

    def record_in_thread(self) -> None:
        """
        Take messages in a separate thread, until the bag is closed.

        The subscribing node then needs no executor.
        """
        self._thread = threading.Thread(target=self._take_on, name='bag recorder', daemon=True)
        self._thread.start()

    def _take_on(self) -> None:
        try:
            while not self._ending.wait(POLL_PERIOD):
                self.take_all()
        except Exception as error:  # noqa: BLE001 the owner reports any failure
            self.failure = error

    def _writing(self, topic: str, connection: Any, stamp_in: StampOf,
                 callback: Optional[Callable[[bytes], None]]) -> Callable[[bytes], None]:
        timed = stamp_in is stamp_of

        def write(data: bytes) -> None:
            if timed:
                # A zero stamp means no stamp, except at the start of simulated time.
                self._newest = stamp_in(data) or self._newest or 0
                self._write_early()
            elif self._newest is None:
                return self._early.append(lambda: write(data))
            self._writer.write(connection, stamp := (
                self._newest if timed else stamp_in(data) or self._newest), data)
            self.recorded.setdefault(topic, []).append(stamp)
            self._latest[topic] = max(stamp, self._latest.get(topic, stamp))
            if callback is not None:
                callback(data)
        return write

    def _write_early(self) -> None:
        early, self._early = self._early, []
        for write in early:
            write()


def stamp_of(data: bytes, offset: int = CDR_HEADER_SIZE) -> int:
    """Return the stamp at the beginning of a serialized message [ns]."""
    seconds, nanoseconds = _STAMP.unpack_from(data, offset)
    return int(seconds) * 10**9 + int(nanoseconds)


def stamp_of_first(data: bytes) -> int:
    """Return the stamp of the first message in a serialized sequence [ns]."""
    count, = _COUNT.unpack_from(data, CDR_HEADER_SIZE)
    return stamp_of(data, CDR_HEADER_SIZE + CDR_COUNT_SIZE) if count else 0


def unstamped(data: bytes) -> int:
    """Return 0, for a message without a stamp."""
    return 0


def stamp_reader(kind: Any) -> StampOf:
    """
    Return the function that reads the stamp of messages of a class [ns]; 0 where they have none.

    A stamp is at the beginning: a time or a header, or a sequence of messages
    that begin with a header, as on /tf.
    """
    first = next(iter(kind.get_fields_and_field_types().values()), '')
    if kind.__name__ in WALL_TIME_MESSAGES:
        return unstamped
    if first in STAMPED:
        return stamp_of
    if first in SEQUENCES:
        return stamp_of_first
    return unstamped


def bag_writer(folder: Path, metadata: Mapping[str, str]) -> Any:
    """
    Return a `RosbagsWriter` or `Rosbag2Writer` for a new bag, in a folder that does not exist yet.

    Raises `ConfigurationError` if no library that writes bags is installed.
    """
    if find_spec('rosbags') is not None:
        return RosbagsWriter(folder, metadata)
    if find_spec('rosbag2_py') is not None:
        return Rosbag2Writer(folder, metadata)
    raise ConfigurationError(MISSING, 'not_installed', 'rosbag2_py')


def message_types() -> Any:
    """Return the message types of ROS and of this package, as a store of rosbags."""
    from rosbags.typesys import get_types_from_msg, get_typestore, Stores
    store, own = get_typestore(Stores.ROS2_JAZZY), {}
    for file in sorted(shipped_folder('msg').glob('*.msg')):
        own.update(get_types_from_msg(file.read_text(), f'{PACKAGE}/msg/{file.stem}'))
    store.register(own)
    return store


class RosbagsWriter:
    """Writes with the Python package rosbags; see `bag_writer`."""

    def __init__(self, folder: Path, metadata: Mapping[str, str]):
        from rosbags.rosbag2 import StoragePlugin, Writer
        self._store = message_types()
        self._writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
        for key, value in metadata.items():
            self._writer.set_custom_data(key, value)

    def open(self) -> None:
        self._writer.open()

    def add_topic(self, name: str, kind: str, offered: Sequence[Qos] = ()) -> Any:
        return self._writer.add_connection(name, kind, typestore=self._store,
                                           offered_qos_profiles=[_rosbags_qos(one)
                                                                 for one in offered])

    def write(self, topic: Any, stamp: int, data: bytes) -> None:
        self._writer.write(topic, stamp, data)

    def close(self) -> None:
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
    """Writes with rosbag2_py, which finds the message definitions itself; see `bag_writer`."""

    def __init__(self, folder: Path, metadata: Mapping[str, str]):
        import rosbag2_py
        self._rosbag2: Any = rosbag2_py
        self._storage = rosbag2_py.StorageOptions(uri=str(folder), storage_id='mcap',
                                                  custom_data=dict(metadata))
        self._writer: Any = rosbag2_py.SequentialWriter()
        self._topics = 0

    def open(self) -> None:
        """Open the bag; raise `ConfigurationError` without a storage plugin for MCAP."""
        try:
            self._writer.open(self._storage, self._rosbag2.ConverterOptions('cdr', 'cdr'))
        except RuntimeError as error:
            raise ConfigurationError(f'{self._storage.uri}: rosbag2_py cannot write: {error}; '
                                     'is ros-...-rosbag2-storage-mcap installed?',
                                     'not_writable', str(self._storage.uri)) from error

    def add_topic(self, name: str, kind: str, offered: Sequence[Qos] = ()) -> str:
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
        self._writer.write(topic, data, stamp)

    def close(self) -> None:
        self._writer = None  # its destructor completes the bag, in every ROS distribution
