# SPDX-License-Identifier: Apache-2.0
"""Record topics of a running graph, also those that appear later, and their source."""
from collections import Counter
from functools import partial
from pathlib import Path
import time
from typing import Any, Callable, Dict, List, Set

from rclpy.parameter import parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import QoSProfile

from ballbot_ros.bags.metadata import bag_metadata, BRIDGE, SIMULATOR
from ballbot_ros.bags.writer import BagRecorder
from ballbot_ros.errors import BallbotError, ConfigurationError
from ballbot_ros.ros.graph import Observer
from ballbot_ros.ros.topics import message_class

# Of a subscription: deep enough for a recorder that is delayed by some seconds.
QUEUE_DEPTH = 5000
GRAPH_PERIOD = 0.2  # of the search for new topics [s]
# Topics of the graph itself; `ros2 bag record -a` leaves out hidden names only.
GRAPH_TOPICS = ('/rosout', '/parameter_events')
PARAMETERS_TIMEOUT = 2.0  # of the node that is the source, for its parameters [s]
# Declared by rclpy in each node.
RCLPY_PARAMETERS = ('use_sim_time', 'start_type_description_service')


class GraphRecording:
    """
    Subscribes to topics as they appear, and counts written messages.

    Parameters
    ----------
    observer : Observer
    bag : BagRecorder
    topics : list of str
        Their names; empty for all.
    say : callable
        Receives messages about recorded topics, and about those that cannot be recorded.

    Attributes
    ----------
    counts : Counter
        Messages by topic.

    """

    def __init__(self, observer: Observer, bag: BagRecorder, topics: List[str],
                 say: Callable[[str], None]):
        self._observer, self._bag, self._say = observer, bag, say
        self._wanted = {observer.resolve(topic) for topic in topics}
        self._known: Set[str] = set()
        self._look_at = 0.0
        self.counts: Counter = Counter()

    @property
    def missing(self) -> List[str]:
        """Return the requested topics that do not exist."""
        return sorted(self._wanted - self._known)

    def poll(self) -> None:
        """Record received messages, and search for new topics; to be called often."""
        self._bag.take_all()
        if time.monotonic() >= self._look_at:
            self._look_at = time.monotonic() + GRAPH_PERIOD
            self._look()

    def _look(self) -> None:
        published: Dict[str, List[str]] = {
            name: kinds for name, kinds in self._observer.node.get_topic_names_and_types()
            if self._observer.node.count_publishers(name)}
        for name, kinds in sorted(published.items()):
            hidden = any(part.startswith('_') for part in name.split('/'))
            if name in self._known or (name not in self._wanted if self._wanted else
                                       hidden or name in GRAPH_TOPICS):
                continue
            self._known.add(name)
            try:
                self._subscribe(name, kinds)
            except BallbotError as error:
                self._say(f'not recorded: {name}: {error}')

    def _subscribe(self, name: str, kinds: List[str]) -> None:
        if len(kinds) > 1:
            raise ConfigurationError(
                f'it has several types, {" and ".join(kinds)}', 'ambiguous', 'topic')
        profile: QoSProfile = self._observer.profile(name, QUEUE_DEPTH)
        self._bag.subscribe(self._observer.node, name, partial(self._count, name),
                            message_class(kinds[0]), profile)
        self._say(f'recording {name} [{kinds[0]}]')

    def _count(self, name: str, _: bytes) -> None:
        self.counts[name] += 1


def source_metadata(observer: Observer) -> Dict[str, str]:
    """
    Return the metadata of a bag of the running simulator or bridge, for `ballbot replay`.

    Empty if there is none or more than one of them, or without an answer.
    """
    observer.settle()
    found = [names for names in observer.node.get_node_names_and_namespaces()
             if names[0] in (SIMULATOR, BRIDGE)]
    if len(found) != 1:
        return {}
    name, namespace = found[0]
    client = AsyncParameterClient(observer.node, namespace.rstrip('/') + f'/{name}')
    if not observer.wait(client.services_are_ready, PARAMETERS_TIMEOUT):
        return {}

    def answer(future: Any) -> Any:
        observer.wait(future.done, PARAMETERS_TIMEOUT)
        return future.result() if future.done() else None
    listed = answer(client.list_parameters())
    names = [one for one in listed.result.names if one not in RCLPY_PARAMETERS
             and not one.startswith('qos_overrides.')] if listed else []
    values = answer(client.get_parameters(names)) if names else None
    if values is None:
        return {}
    return bag_metadata(name, {
        one: parameter_value_to_python(value) for one, value in zip(names, values.values)})


def record(observer: Observer, folder: Path, topics: List[str], duration: float,
           say: Callable[[str], None]) -> Counter:
    """
    Record until Ctrl-C, or for a duration [s]; return the number of messages by topic.

    Raises
    ------
    ConfigurationError
        If the folder exists.

    """
    check_new(folder)
    metadata = source_metadata(observer)
    end = time.monotonic() + duration
    with BagRecorder(folder, metadata) as bag:
        recording = GraphRecording(observer, bag, topics, say)

        def complete() -> bool:
            recording.poll()
            return not recording.missing
        observer.wait(complete, 1.0)
        if recording.missing:
            say(f'not published yet: {", ".join(recording.missing)}; recorded as soon as a node '
                'publishes')
        try:
            while time.monotonic() < end:
                observer.spin()
                recording.poll()
        except KeyboardInterrupt:
            pass
        bag.take_all()
    return recording.counts


def check_new(folder: Path) -> None:
    """Refuse an existing folder, which a bag would replace."""
    if folder.exists():
        raise ConfigurationError(
            f'{folder} exists already; name another folder with -o, or remove it', 'exists', '-o')
