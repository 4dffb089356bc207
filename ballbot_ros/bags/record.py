# SPDX-License-Identifier: Apache-2.0
"""Record topics of a running graph, also topics that appear later, and their source node."""
from collections import Counter
from functools import partial
from pathlib import Path
import time
from typing import Any, Callable, Dict, List

from rclpy.parameter import parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from ballbot_ros.bags.metadata import bag_metadata, BRIDGE, SIMULATOR
from ballbot_ros.bags.writer import BagRecorder
from ballbot_ros.errors import BallbotError, ConfigurationError
from ballbot_ros.ros import qos
from ballbot_ros.ros.graph import Observer
from ballbot_ros.ros.parameters import BUILT_IN
from ballbot_ros.ros.topics import message_class

GRAPH_PERIOD = 0.2  # period of the search for new topics [s]
# Topics of the graph itself; `ros2 bag record -a` leaves out hidden names only.
GRAPH_TOPICS = ('/rosout', '/parameter_events')
PARAMETERS_TIMEOUT = 2.0  # timeout for the parameters of the source node [s]


def source_metadata(observer: Observer) -> Dict[str, str]:
    """
    Return the metadata of a bag of the running simulator or bridge, for `ballbot replay`.

    Empty if not exactly one of them is running, or it does not reply.
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
    names = [one for one in listed.result.names if one not in BUILT_IN
             and not one.startswith('qos_overrides.')] if listed else []
    values = answer(client.get_parameters(names)) if names else None
    if values is None:
        return {}
    return bag_metadata(name, {
        one: parameter_value_to_python(value) for one, value in zip(names, values.values)})


def record(observer: Observer, folder: Path, topics: List[str], duration: float,
           say: Callable[[str], None]) -> Counter:
    """
    Record topics (all if none are named) as they appear, for a time [s] or until Ctrl-C.

    Returns the number of messages by topic; `say` receives a sentence for each recorded topic and
    for each that cannot be recorded.  An older bag in the folder is replaced.
    """
    metadata = source_metadata(observer)
    node, counts, known = observer.node, Counter[str](), set()
    wanted = {observer.resolve(topic) for topic in topics}

    def count(name: str, _: bytes) -> None:
        counts[name] += 1

    def search() -> None:
        for name, kinds in sorted(node.get_topic_names_and_types()):
            hidden = any(part.startswith('_') for part in name.split('/'))
            if name in known or not node.count_publishers(name) or (
                    name not in wanted if wanted else hidden or name in GRAPH_TOPICS):
                continue
            known.add(name)
            try:
                if len(kinds) > 1:
                    raise ConfigurationError(
                        f'it has several types, {" and ".join(kinds)}', 'ambiguous', 'topic')
                bag.subscribe(node, name, partial(count, name), message_class(kinds[0]),
                              observer.profile(name, qos.RECORDING_DEPTH))
                say(f'recording {name} [{kinds[0]}]')
            except BallbotError as error:
                say(f'not recorded: {name}: {error}')

    with BagRecorder(folder, metadata) as bag:
        end = time.monotonic() + duration
        search()
        if wanted - known:
            say(f'not published yet: {", ".join(sorted(wanted - known))}; recorded as soon as a '
                'node publishes')
        search_at = time.monotonic()
        try:
            while (now := time.monotonic()) < end:
                observer.spin()
                bag.take_all()
                if now >= search_at + GRAPH_PERIOD:
                    search_at = now
                    search()
        except KeyboardInterrupt:
            pass
        bag.take_all()
    return counts
