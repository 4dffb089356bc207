# SPDX-License-Identifier: Apache-2.0
"""Let simulated time begin when every subscriber receives every publisher."""
import time
from typing import Iterable

from rclpy.node import Node
from std_srvs.srv import Trigger

from ballbot_ros.bags.writer import BagRecorder

# Wall time after which a paused simulator is reset again, to publish its state [s].
AGAIN = 0.2


class SynchronizedStart:
    """
    Resumes a paused simulator as soon as a recorder has received every topic.

    Each reset makes the simulator publish its first state, and whoever receives it answers.
    That a topic has a publisher would not do: it may not have discovered the recorder yet.

    Parameters
    ----------
    node : Node
    bag : BagRecorder
    topics : iterable of str
        That it must have recorded.

    """

    def __init__(self, node: Node, bag: BagRecorder, topics: Iterable[str]):
        """Create the clients of the simulator."""
        self._reset = node.create_client(Trigger, 'simulator/reset')
        self._resume = node.create_client(Trigger, 'simulator/resume')
        self._bag = bag
        self._topics = set(topics)
        self._next = 0.0
        self._done = False

    def poll(self) -> None:
        """Do what can be done now; to be called often."""
        now = time.monotonic()
        if self._done or now < self._next or not (
                self._reset.service_is_ready() and self._resume.service_is_ready()):
            return
        self._done = self._topics <= self._bag.recorded.keys()
        (self._resume if self._done else self._reset).call_async(Trigger.Request())
        self._next = now + AGAIN
