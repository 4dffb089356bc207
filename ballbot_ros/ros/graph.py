# SPDX-License-Identifier: Apache-2.0
"""Access of commands to the running graph: topics, rates, messages and Trigger services."""
from collections import deque
import csv
import io
import os
from statistics import fmean, pstdev
import time
from typing import Any, Callable, Deque, Iterator, List, NamedTuple, Optional, Tuple

import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import Trigger
import yaml

from ballbot_ros.config.fields import suggestion
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.ros import discovery, qos
from ballbot_ros.ros.endpoints import create_subscription
from ballbot_ros.ros.rclpy_compat import new_executor, reason_of
from ballbot_ros.ros.topics import message_class, plain, Qos

# Discovery is complete when the graph has not changed for the quiet time, at the latest after the
# timeout [s].  It takes less than half a second on an idle machine.
DISCOVERY_QUIET_TIME, DISCOVERY_TIMEOUT = 0.5, 4.0
SPIN_TIMEOUT = 0.05  # [s]
# Number of messages over which a rate is computed.
RATE_WINDOW = 10000


class Observer:
    """
    Node, context and executor of a command; use as a context manager.

    The node is named after the command and the process.  Raises `ConfigurationError` if the
    namespace is not valid.
    """

    def __init__(self, name: str, namespace: str = ''):
        discovery.apply(os.environ)
        context = Context()
        rclpy.init(context=context, args=[], signal_handler_options=SignalHandlerOptions.NO)
        try:
            self.node = Node(f'ballbot_{name}_{os.getpid()}', namespace=namespace,
                             context=context, use_global_arguments=False, enable_rosout=False,
                             start_parameter_services=False)
        except Exception as error:  # rclpy has a type for each part of a name
            rclpy.try_shutdown(context=context)
            raise ConfigurationError(
                f'--namespace {namespace}: {reason_of(error)}', 'wrong_type',
                '--namespace') from error
        self._executor = new_executor(context)
        self._executor.add_node(self.node)

    def __enter__(self) -> 'Observer':
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()

    def close(self) -> None:
        """Leave the graph."""
        self._executor.remove_node(self.node)
        self.node.destroy_node()
        self._executor.shutdown()
        rclpy.try_shutdown(context=self.node.context)

    def spin(self, seconds: float = SPIN_TIMEOUT) -> None:
        """Process callbacks for at most `seconds`."""
        self._executor.spin_once(timeout_sec=seconds)

    def wait(self, condition: Callable[[], Any], seconds: float) -> Any:
        """Return the result of a condition once it is true, or after a timeout [s]."""
        deadline = time.monotonic() + seconds
        while not (found := condition()) and time.monotonic() < deadline:
            self.spin()
        return found

    def settle(self) -> None:
        """Wait until discovery is complete: the graph has not changed for a while."""
        self.wait(lambda: set(self.node.get_node_names()) - {self.node.get_name()},
                  DISCOVERY_TIMEOUT)
        start = changed = time.monotonic()
        known = None
        while time.monotonic() < min(changed + DISCOVERY_QUIET_TIME, start + DISCOVERY_TIMEOUT):
            now = self._graph()
            if now != known:
                known, changed = now, time.monotonic()
            self.spin()

    def _graph(self) -> List[Any]:
        return [sorted(self.node.get_node_names_and_namespaces()),
                sorted(self.node.get_topic_names_and_types())]

    def resolve(self, topic: str) -> str:
        """Return the full name of a topic in the namespace of the command."""
        try:
            return self.node.resolve_topic_name(topic)
        except Exception as error:
            raise ConfigurationError(f'{topic!r} is not a valid topic name: {reason_of(error)}',
                                     'wrong_type', 'topic') from error

    def type_of(self, topic: str, seconds: float, waiting: Callable[[], None]) -> str:
        """
        Return the type of a topic; call `waiting` once if it does not exist yet.

        Raises `ConfigurationError` if it has several types, or does not appear; the message then
        names the most similar topic.
        """
        name = self.resolve(topic)
        found = self.wait(lambda: self._types(name), min(DISCOVERY_QUIET_TIME, seconds))
        if not found and seconds > DISCOVERY_QUIET_TIME:
            waiting()
            found = self.wait(lambda: self._types(name), seconds - DISCOVERY_QUIET_TIME)
        if not found:
            known = [one for one, _ in self.node.get_topic_names_and_types()]
            raise ConfigurationError(
                f'no node publishes or subscribes to {name}{suggestion(name, known)}; '
                f'"ballbot topics" lists the topics', 'unknown_name', 'topic')
        if len(found) > 1:
            raise ConfigurationError(f'{name} has several types, {" and ".join(found)}: '
                                     'end the nodes with the other type',
                                     'ambiguous', 'topic')
        return str(found[0])

    def _types(self, name: str) -> List[str]:
        return dict(self.node.get_topic_names_and_types()).get(name, [])

    def profile(self, topic: str, depth: int = 1000) -> QoSProfile:
        """Return a profile that is compatible with all publishers."""
        offered = [qos.of(one.qos_profile, depth)
                   for one in self.node.get_publishers_info_by_topic(topic)]
        return qos.profile(Qos(depth, all(one.reliable for one in offered),
                               bool(offered) and all(one.latched for one in offered)))

    def subscribe(self, topic: str, take: Callable[[Any], None], seconds: float,
                  waiting: Callable[[], None], raw: bool = False) -> None:
        """Subscribe to a topic, in the type and with the profile of its publishers."""
        kind = message_class(self.type_of(topic, seconds, waiting))
        name = self.resolve(topic)
        # Discovery of the publisher may follow that of the topic.
        self.wait(lambda: self.node.count_publishers(name), 0.2)
        # rclpy inspects the signature of a callback, and a builtin has none.
        create_subscription(self.node, name, lambda message: take(message), kind,
                            self.profile(name), raw=raw)


class GraphTopic(NamedTuple):
    """A topic, its types, and the numbers of publishers and subscribers."""

    name: str
    types: List[str]
    publishers: int
    subscribers: int


def topics(observer: Observer) -> List[GraphTopic]:
    """Return the topics of the graph by name, without those that only the observer has."""
    observer.settle()
    node = observer.node

    def count(endpoints: List[Any]) -> int:
        return sum(one.node_name != node.get_name() for one in endpoints)

    found = [GraphTopic(name, types, count(node.get_publishers_info_by_topic(name)),
                        count(node.get_subscriptions_info_by_topic(name)))
             for name, types in sorted(node.get_topic_names_and_types())]
    return [topic for topic in found if topic.publishers + topic.subscribers]


def echo(observer: Observer, topic: str, show: Callable[[Any], None], once: bool, timeout: float,
         waiting: Callable[[], None]) -> int:
    """
    Pass the messages of a topic to `show` until interrupted, and return their number.

    Ends after the first message with `once`, or after the timeout [s].  `waiting` is called once
    if the topic does not exist, or no message arrives in 1 s.  Raises as `Observer.type_of`.
    """
    start = time.monotonic()
    received: Deque[Any] = deque()
    observer.subscribe(topic, received.append, timeout, waiting)
    if not observer.wait(lambda: received, 1.0):
        waiting()
    shown = 0
    while time.monotonic() < start + timeout or received:
        while received:
            show(received.popleft())
            shown += 1
            if once:
                return shown
        observer.spin()
    return shown


def rates(observer: Observer, topic: str, timeout: float,
          waiting: Callable[[], None]) -> Iterator[Optional[str]]:
    """Yield the rate of a topic as text each second, None without messages."""
    times: Deque[float] = deque(maxlen=RATE_WINDOW)
    observer.subscribe(topic, lambda _: times.append(time.monotonic()), timeout, waiting, raw=True)
    end = time.monotonic() + timeout
    while (now := time.monotonic()) < end:
        observer.wait(lambda: False, min(1.0, end - now))
        yield rate_in_words(list(times))


def rate_in_words(times: List[float]) -> Optional[str]:
    """Return rate and spread of the times of messages [s], None for fewer than two."""
    gaps = [after - before for before, after in zip(times, times[1:])]
    if not gaps:
        return None
    return (f'average rate: {1.0 / fmean(gaps):.3f}\n\tmin: {min(gaps):.3f}s '
            f'max: {max(gaps):.3f}s std dev: {pstdev(gaps):.5f}s window: {len(gaps) + 1}')


def as_yaml(message: Any) -> str:
    """Return a message as ``ros2 topic echo`` prints it, with its separator line."""
    text = yaml.safe_dump(plain(message), sort_keys=False, default_flow_style=False,
                          allow_unicode=True, width=float('inf'))
    return f'{text}---'


def as_csv(message: Any) -> str:
    """Return the numbers and texts of a message in one line."""
    line = io.StringIO()
    csv.writer(line, lineterminator='').writerow(list(_leaves(plain(message))))
    return line.getvalue()


def _leaves(value: Any) -> Iterator[Any]:
    if isinstance(value, (dict, list)):
        for one in value.values() if isinstance(value, dict) else value:
            yield from _leaves(one)
    else:
        yield value


def trigger(observer: Observer, node: str, verb: str, timeout: float) -> Tuple[bool, str]:
    """
    Call a service of a node, with its namespace if it has one; return success and message.

    The timeout applies to the discovery of the service, and to its response [s].  Raises
    `ConfigurationError` if there is no such service, with the names of the nodes that have one, or
    if it does not respond.
    """
    # Look up the servers first: a client would be listed like a server.
    def servers() -> List[str]:
        return sorted(name[:-len(verb) - 1] for name, _ in
                      observer.node.get_service_names_and_types() if name.endswith(f'/{verb}'))

    wanted = observer.resolve(f'{node.rstrip("/")}/{verb}')[:-len(verb) - 1]
    observer.wait(lambda: wanted in servers(), timeout)
    known = servers()
    client = observer.node.create_client(Trigger, f'{node.rstrip("/")}/{verb}')
    if wanted not in known or not observer.wait(client.service_is_ready, timeout):
        there = f'; {", ".join(known)} {"has" if len(known) == 1 else "have"} one (--node)' \
            if known else '; is the node running, in this ROS_DOMAIN_ID?'
        raise ConfigurationError(
            f'no node {node!r} with a service {verb}{suggestion(wanted, known, listing=False)}'
            f'{there}', 'unknown_name', '--node')
    answer = client.call_async(Trigger.Request())
    if not observer.wait(answer.done, timeout):
        raise ConfigurationError(f'{node}/{verb} has not answered within {timeout:g} s; check '
                                 'whether it was executed', 'unavailable', '--node')
    result = answer.result()
    return result.success, result.message
