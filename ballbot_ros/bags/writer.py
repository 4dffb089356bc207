# SPDX-License-Identifier: Apache-2.0
"""Record topics into an MCAP bag that `ros2 bag`, Foxglove and PlotJuggler open."""
from pathlib import Path
import shutil
import threading
import time
from typing import Any, Callable, Dict, List, Mapping, Optional, Tuple

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from ballbot_ros.bags.message_stamps import stamp_of, stamp_reader, StampOf
from ballbot_ros.bags.storage import bag_writer
from ballbot_ros.ros import qos
from ballbot_ros.ros.endpoints import create_subscription
from ballbot_ros.ros.rclpy_compat import take_all
from ballbot_ros.ros.topics import message_class, Qos, TOPICS


def offered_qos(node: Node, topic: str) -> List[Qos]:
    """
    Return the quality of service that a topic is published with, for its replay.

    It is that of the publishers in the graph or, before there are any, of the table of topics.
    """
    offered = {Qos(max(one.qos_profile.depth, 1),
                   one.qos_profile.reliability == ReliabilityPolicy.RELIABLE,
                   one.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL)
               for one in node.get_publishers_info_by_topic(topic)}
    known = TOPICS.get(topic) or TOPICS.get(topic.rpartition('/')[2])
    return sorted(offered) or ([known.offered] if known is not None else [])


# So often a recorder with a thread of its own looks whether something has come [s].
LOOK_AGAIN = 0.002


class BagRecorder:
    """
    Writes serialized messages on arrival, with the stamp of their header.

    Messages without a stamp, or with a wall time, take the last stamp before them; see
    `message_stamps`.  Messages are neither decoded nor encoded, which keeps recording cheap.
    Use as a context manager: the bag is complete when it is closed, also after an error.

    Parameters
    ----------
    folder : Path
        Folder of the bag; replaces an older bag there.
    metadata : mapping of str to str, optional
        Stored in the bag.

    Attributes
    ----------
    folder : Path
    recorded : mapping of str to list of int
        Stamps of the recorded messages by topic [ns].
    failure : Exception or None
        The error that ended the thread of `record_in_thread`.

    """

    def __init__(self, folder: Path, metadata: Optional[Mapping[str, str]] = None):
        """Open the bag."""
        shutil.rmtree(folder, ignore_errors=True)
        folder.parent.mkdir(parents=True, exist_ok=True)
        self.folder = folder
        self._writer = bag_writer(folder, metadata or {})
        self._subscriptions: List[Tuple[Subscription, Callable[[bytes], None]]] = []
        self.recorded: Dict[str, List[int]] = {}
        self._latest: Dict[str, int] = {}  # largest stamp by topic [ns]
        self.failure: Optional[Exception] = None
        self._newest: Optional[int] = None  # stamp [ns]
        self._early: List[Callable[[], None]] = []  # without a stamp, and before any other
        self._taking, self._ending = threading.Lock(), threading.Event()
        self._thread: Optional[threading.Thread] = None

    def __enter__(self) -> 'BagRecorder':
        """Start writing."""
        self._writer.open()
        return self

    def __exit__(self, *_: Any) -> None:
        """Record what has come, and complete the bag."""
        self._ending.set()
        if self._thread is not None:
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

        Parameters
        ----------
        node : Node
        topic : str
        callback : callable, optional
            Called with the serialized message, too, in the thread that takes it.
        kind : type, optional
            Message class, by default that in the table of topics.
        profile : QoSProfile, optional
            By default one that misses no message of a topic in the table.

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
        must not end before: what is not delivered then is lost.
        """
        return all(self._latest.get(topic, -1) >= stamp for topic, stamp in stamps.items())

    def take_all(self) -> None:
        """
        Record all that has come.

        An executor takes one message per topic each time that it wakes up, and looks at all
        topics again before the next one; on a busy machine that is too slow.
        """
        with self._taking:
            for subscription, write in self._subscriptions:
                for data in take_all(subscription):
                    write(data)

    def record_in_thread(self) -> None:
        """
        Take all that comes in a thread of its own, until the bag is closed.

        The node that subscribes needs no executor then.
        """
        self._thread = threading.Thread(target=self._take_on, name='bag recorder', daemon=True)
        self._thread.start()

    def _take_on(self) -> None:
        try:
            while not self._ending.wait(LOOK_AGAIN):
                self.take_all()
        except Exception as error:  # noqa: BLE001 the owner reports any failure
            self.failure = error

    def _writing(self, topic: str, connection: Any, stamp_in: StampOf,
                 callback: Optional[Callable[[bytes], None]]) -> Callable[[bytes], None]:
        timed = stamp_in is stamp_of  # be it 0, where simulated time begins

        def write(data: bytes) -> None:
            if timed:
                self._newest = stamp_in(data)
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
