# SPDX-License-Identifier: Apache-2.0
"""Topics of the graph, their rates and their messages."""
import array
from collections import deque
import csv
import io
import time
from typing import Any, Callable, Deque, Iterator, List, NamedTuple, Optional

import yaml

from ballbot_ros.ros.endpoints import create_subscription
from ballbot_ros.ros.tools.observer import Observer
from ballbot_ros.ros.topics import message_class

# Number of messages in the window of a rate.
WINDOW = 10000


class GraphTopic(NamedTuple):
    """A topic, its types, and the numbers of publishers and subscribers."""

    name: str
    types: List[str]
    publishers: int
    subscribers: int


def topics(observer: Observer) -> List[GraphTopic]:
    """Return the topics of the graph by name, without those of the observer alone."""
    observer.settle()
    node = observer.node

    def count(endpoints: List[Any]) -> int:
        return sum(one.node_name != node.get_name() for one in endpoints)

    found = [GraphTopic(name, types, count(node.get_publishers_info_by_topic(name)),
                   count(node.get_subscriptions_info_by_topic(name)))
             for name, types in sorted(node.get_topic_names_and_types())]
    return [topic for topic in found if topic.publishers + topic.subscribers]


def echo(observer: Observer, topic: str, show: Callable[[Any], None], once: bool = False,
         timeout: float = float('inf'), waiting: Callable[[], None] = lambda: None) -> int:
    """
    Pass on the messages of a topic until interrupted, and return their number.

    Parameters
    ----------
    observer : Observer
    topic : str
    show : callable
        Takes a message.
    once : bool
        End after the first.
    timeout : float
        End after this long [s].
    waiting : callable
        Called once if the topic does not exist, or no message arrives at first.

    Raises
    ------
    ConfigurationError
        See `Observer.type_of`.

    """
    start = time.monotonic()
    kind = message_class(observer.type_of(topic, timeout, waiting))
    name = observer.resolve(topic)
    # Discovery of the publisher may follow that of the topic.
    observer.wait(lambda: observer.node.count_publishers(name), 0.2)
    came: Deque[Any] = deque()
    # rclpy inspects the signature of a callback, and a builtin has none.
    create_subscription(observer.node, name, lambda message: came.append(message), kind,
                        observer.profile(name))
    if not observer.wait(lambda: came, 1.0):
        waiting()
    shown = 0
    while time.monotonic() < start + timeout or came:
        while came:
            show(came.popleft())
            shown += 1
            if once:
                return shown
        observer.spin()
    return shown


def rates(observer: Observer, topic: str, timeout: float,
          waiting: Callable[[], None]) -> Iterator[Optional[str]]:
    """Yield the rate of a topic as text each second, None without messages."""
    kind = message_class(observer.type_of(topic, timeout, waiting))
    name = observer.resolve(topic)
    observer.wait(lambda: observer.node.count_publishers(name), 0.2)
    times: Deque[float] = deque(maxlen=WINDOW)
    create_subscription(observer.node, name, lambda _: times.append(time.monotonic()), kind,
                        observer.profile(name), raw=True)
    end = time.monotonic() + timeout
    while (now := time.monotonic()) < end:
        observer.wait(lambda until=now + 1.0: time.monotonic() >= until, min(1.0, end - now))
        yield rate_in_words(list(times))


def rate_in_words(times: List[float]) -> Optional[str]:
    """Return rate and spread of the times of messages [s], None for less than two."""
    gaps = [after - before for before, after in zip(times, times[1:])]
    if not gaps:
        return None
    mean = sum(gaps) / len(gaps)
    spread = (sum((gap - mean) ** 2 for gap in gaps) / len(gaps)) ** 0.5
    return (f'average rate: {1.0 / mean:.3f}\n\tmin: {min(gaps):.3f}s max: {max(gaps):.3f}s '
            f'std dev: {spread:.5f}s window: {len(gaps) + 1}')


def plain(value: Any) -> Any:
    """Return a message, or a value in one, as dicts, lists and numbers."""
    if hasattr(value, 'get_fields_and_field_types'):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, (bytes, bytearray)):
        return list(value) if len(value) != 1 else value[0]
    if hasattr(value, 'tolist'):  # an array, of numpy or of Python
        return value.tolist()
    if isinstance(value, (list, tuple, array.array)):
        return [plain(one) for one in value]
    return value


def as_yaml(message: Any) -> str:
    """Return a message as ``ros2 topic echo`` prints it, with the line that ends it."""
    text = yaml.safe_dump(plain(message), sort_keys=False, default_flow_style=False,
                          allow_unicode=True, width=float('inf'))
    return f'{text}---'


def as_csv(message: Any) -> str:
    """Return the numbers and texts of a message in one line."""
    line = io.StringIO()
    csv.writer(line, lineterminator='').writerow(list(_leaves(plain(message))))
    return line.getvalue()


def _leaves(value: Any) -> Iterator[Any]:
    """Yield the leaves of nested dicts and lists in order."""
    if isinstance(value, (dict, list)):
        for one in value.values() if isinstance(value, dict) else value:
            yield from _leaves(one)
    else:
        yield value
