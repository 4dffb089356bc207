# SPDX-License-Identifier: Apache-2.0
"""Check that a command topic has one publisher; the messages of several are refused."""
import time
from typing import List

from rclpy.node import Node

from ballbot_ros.errors import MessageError
from ballbot_ros.ros.endpoints import endpoint_name

# Periods of two queries of the graph: the number of publishers, and their names [s].
COUNT_PERIOD, NAME_PERIOD = 0.02, 1.0
# A node that was killed stays in the graph for as long as its lease in DDS, 5 s with the settings
# of this package and 20 s with those of Fast DDS: for this time a second publisher of the same
# name counts as its restart [s].  A publisher that started after the end of a node does not
# discover it.
RESTART_TIME = 25.0


class SinglePublisher:
    """Finds the node that publishes a topic, as rclpy does not give the sender of a message."""

    def __init__(self, node: Node, topic: str):
        self._node, self._topic = node, node.resolve_topic_name(topic)  # queries do not remap
        self._own = node.get_fully_qualified_name()
        self._names: List[str] = []  # of the publishers
        self._several_since = 0.0
        self._count_at = self._name_at = 0.0

    def name(self) -> str:
        """
        Return the name of the publishing node; empty before it is known.

        Raises `MessageError` with reason ``several_publishers``, while there are several; several
        of one name are accepted for `RESTART_TIME`, except for that of the node itself.
        """
        now = time.monotonic()
        self._query(now)
        names = sorted(set(self._known()))
        if len(names) > 1 or (len(self._names) > 1 and (
                self._own in names or now - self._several_since > RESTART_TIME)):
            several = ' and '.join(names if len(names) > 1 else self._names)
            raise MessageError(
                f'{several} publish {self._topic}, and none of them is '
                'followed: end all but one, or select one with a multiplexer such as twist_mux',
                'several_publishers', self._topic)
        return names[0] if names else ''

    def _query(self, now: float) -> None:
        if now < self._count_at:
            return
        self._count_at = now + COUNT_PERIOD
        if now >= self._name_at or len(self._known()) < len(self._names) \
                or self._node.count_publishers(self._topic) != len(self._names):
            self._name_at = now + NAME_PERIOD
            found = sorted(map(endpoint_name,
                               self._node.get_publishers_info_by_topic(self._topic)))
            if len(found) < 2 or len(self._names) < 2:
                self._several_since = now
            self._names = found

    def _known(self) -> List[str]:
        """Return the names without those of nodes that are not discovered yet, or have ended."""
        return [name for name in self._names if '_UNKNOWN_' not in name]
