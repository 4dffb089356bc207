# SPDX-License-Identifier: Apache-2.0
"""Record topics into an MCAP bag that `ros2 bag`, Foxglove and PlotJuggler open."""
from pathlib import Path
import shutil
import struct
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Set, Tuple

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from ballbot_ros.ros.bag_storage import bag_writer
from ballbot_ros.ros.endpoints import create_subscription

# CDR: four bytes of encapsulation, then the stamp that all recorded messages begin with.
_STAMP = struct.Struct('<iI')
_STAMP_OFFSET = 4


def stamp_of(data: bytes) -> int:
    """Return the stamp that a serialized message begins with [ns]."""
    seconds, nanoseconds = _STAMP.unpack_from(data, _STAMP_OFFSET)
    return int(seconds) * 10**9 + int(nanoseconds)


class BagRecorder:
    """
    Writes serialized messages as they come, stamped with their own time.

    Messages are neither decoded nor encoded, so that recording costs little.  Use as a
    context manager: the bag is complete when it is closed, also after an error.

    Parameters
    ----------
    folder : Path
        Of the bag; an older bag there is replaced.
    metadata : mapping of str to str, optional
        Kept in the bag, for whoever reads it.

    Attributes
    ----------
    recorded : set of str
        Topics of which something was recorded.

    """

    def __init__(self, folder: Path, metadata: Optional[Mapping[str, str]] = None):
        """Open the bag."""
        shutil.rmtree(folder, ignore_errors=True)
        folder.parent.mkdir(parents=True, exist_ok=True)
        self._writer = bag_writer(folder, metadata or {})
        self._subscriptions: List[Tuple[Subscription, Callable[[bytes], None]]] = []
        self.recorded: Set[str] = set()

    def __enter__(self) -> 'BagRecorder':
        """Start writing."""
        self._writer.open()
        return self

    def __exit__(self, *_: Any) -> None:
        """Complete the bag."""
        self._writer.close()

    def subscribe(self, node: Node, topics: Sequence[Tuple[str, Any, QoSProfile]],
                  callbacks: Optional[Dict[str, Callable[[bytes], None]]] = None) -> None:
        """
        Record topics to which a node subscribes.

        Parameters
        ----------
        node : Node
        topics : sequence of (name, message class, QoSProfile)
            The first field of each must be a stamp or a header.
        callbacks : mapping of topic to callable, optional
            Called with the serialized message, too.

        """
        for topic, kind, profile in topics:
            name = f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}'
            connection = self._writer.add_topic(node.resolve_topic_name(topic), name)
            write = self._writing(topic, connection, (callbacks or {}).get(topic))
            subscription = create_subscription(node, kind, topic, write, profile, raw=True)
            self._subscriptions.append((subscription, write))

    def take_all(self) -> None:
        """
        Record all that has come.

        An executor takes one message per topic each time that it wakes up, and looks at all
        topics again before the next one; on a busy machine that is too slow.
        """
        for subscription, write in self._subscriptions:
            handle, kind = subscription.handle, subscription.msg_type
            with handle:
                while (taken := handle.take_message(kind, True)) is not None:
                    write(taken[0])

    def _writing(self, topic: str, connection: Any,
                 callback: Optional[Callable[[bytes], None]]) -> Callable[[bytes], None]:
        def write(data: bytes) -> None:
            self._writer.write(connection, stamp_of(data), data)
            self.recorded.add(topic)
            if callback is not None:
                callback(data)
        return write
