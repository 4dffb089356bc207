# SPDX-License-Identifier: Apache-2.0
"""
Who sent a message: rclpy does not say, so senders put a name into ``header.frame_id``.

Such a name has a ``#`` in it, or it would be a frame.  Of a message without one it is known who
sent it only where one node alone publishes the topic: rclpy's executor that is driven by events
cannot hand on what DDS knows of a message (7.1.6), its number for instance.
"""
import secrets
import time
from typing import Dict, List

from rclpy.node import Node

from ballbot_ros.errors import MessageError

MARK = '#'  # in every name of a sender
# So often publishers are counted, and looked at [s].
COUNT_AGAIN, LOOK_AGAIN = 0.02, 1.0
# A name counts as present for so long after its last message [s].
PRESENT = 1.0


def own_name(node: Node) -> str:
    """Return a name for the messages of a node that no other has, not even one of its name."""
    return f'{node.get_fully_qualified_name()}{MARK}{secrets.token_hex(3)}'


class Senders:
    """
    Names the senders of a topic.

    Parameters
    ----------
    node : Node
    topic : str
        That it subscribes to.

    """

    def __init__(self, node: Node, topic: str):
        """Know nobody yet."""
        self._node, self._topic = node, topic
        self._named: Dict[str, float] = {}  # when each was last there
        self._nodes: List[str] = []  # that publish the topic
        self._count_at = self._look_at = 0.0

    def name(self, given: str) -> str:
        """
        Return who sent a message; empty while that is not known yet.

        Parameters
        ----------
        given : str
            What the message has for a name.

        Raises
        ------
        MessageError
            With reason ``no_name`` if there is none, and several could have sent it.

        """
        now = time.monotonic()
        if MARK in given:
            self._named[given] = now
            return given
        self._look(now)
        if len(self._nodes) - len(self._named) > 1:
            raise MessageError(
                'no_name', f'{" and ".join(self._nodes)} publish {self._topic} and cannot be '
                f'told apart, so none of them is followed: end all but one, or let each put a '
                f'name of its own with a {MARK} into header.frame_id')
        return self._nodes[0] if len(self._nodes) == 1 and '_UNKNOWN_' not in self._nodes[0] \
            else f'the other publisher of {self._topic}' if self._named else ''

    def _look(self, now: float) -> None:
        """Look who publishes the topic; how many they are is looked up more often."""
        if now < self._count_at:
            return
        self._count_at = now + COUNT_AGAIN
        if now >= self._look_at or self._node.count_publishers(self._topic) != len(self._nodes):
            self._look_at = now + LOOK_AGAIN
            self._nodes = sorted(
                f'{info.node_namespace.rstrip("/")}/{info.node_name}'
                for info in self._node.get_publishers_info_by_topic(self._topic))
        self._named = {name: last for name, last in self._named.items() if now - last <= PRESENT}
