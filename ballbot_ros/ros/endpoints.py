# SPDX-License-Identifier: Apache-2.0
"""
Publishers and subscriptions without the cost of rclpy's default event handlers, and services.

Each default handler is another waitable of the executor; at 500 Hz they take most of its time.
Mismatches of endpoints, which they report, are polled instead, and logged with the name of the
other node.
"""
from typing import Any, Callable, List, Optional

from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import qos_check_compatible, QoSCompatibility, QoSProfile
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from rclpy.topic_endpoint_info import TopicEndpointInfo
from std_srvs.srv import Trigger

from ballbot_ros.errors import BallbotError
from ballbot_ros.ros import qos
from ballbot_ros.ros.rclpy_compat import answer_later
from ballbot_ros.ros.topics import message_class, TOPICS

CLOCK = '/clock'
# Timeout of odometry during a goal [s of wall time].
ODOMETRY_TIMEOUT = 10
# Timeout for the reception of the last message of a publisher [s]; it takes up to 0.1 s with the
# settings in config/fastdds, unless a subscriber has died.
RECEIVED_TIMEOUT = 0.5


def create_publisher(node: Node, topic: str, kind: Any = None,
                     profile: Optional[QoSProfile] = None) -> Publisher:
    """Return a publisher; type and profile are those of the table of topics, unless given."""
    return node.create_publisher(
        kind or message_class(TOPICS[topic].type), topic,
        profile or qos.profile(TOPICS[topic].offered),
        event_callbacks=PublisherEventCallbacks(use_default_callbacks=False))


def create_subscription(node: Node, topic: str, callback: Callable[[Any], None],
                        kind: Any = None, profile: Optional[QoSProfile] = None,
                        raw: bool = False) -> Subscription:
    """Return a subscription; type and profile are those of the table of topics, unless given."""
    return node.create_subscription(
        kind or message_class(TOPICS[topic].type), topic, callback,
        profile or qos.profile(TOPICS[topic].requested), raw=raw,
        event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False))


def create_wall_timer(node: Node, period: float, callback: Callable[[], None]) -> Timer:
    """Return a timer of wall time [s], which also runs while simulated time is stopped."""
    return node.create_timer(period, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))


def change_period(timer: Timer, period: float) -> None:
    """Set the period of a timer [s]; if it differs, the timer restarts now."""
    nanoseconds = round(1e9 * period)
    if timer.timer_period_ns != nanoseconds:
        timer.timer_period_ns = nanoseconds
        timer.reset()


class OdometryTimeout:
    """
    Calls `end` with the reason after `ODOMETRY_TIMEOUT` of wall time without odometry.

    The time of a pause does not count: a paused simulator publishes neither messages nor the time.
    """

    def __init__(self, node: Node, end: Callable[[str], None]):
        self._node, self._topic, self._end = node, node.resolve_topic_name('odom'), end
        self._seconds, self._time = 0, node.get_clock().now()
        create_wall_timer(node, 1.0, self._count)

    def restart(self) -> None:
        """Start again, because of a message."""
        self._seconds = 0

    def _count(self) -> None:
        last, self._time = self._time, self._node.get_clock().now()
        self._seconds += self._time != last or not self._node.count_publishers(self._topic)
        if self._seconds > ODOMETRY_TIMEOUT:
            self._end(f'no odometry received for {ODOMETRY_TIMEOUT} s')


def subscribe_e_stop(node: Node, callback: Callable[[bool], None]) -> None:
    """
    Subscribe to the e-stop of each publisher, of either durability.

    A latched subscription receives the state from before its start, but matches no volatile
    publisher (``ros2 topic pub`` is one); hence a second, volatile one.  A message of a latched
    publisher arrives at both.
    """
    for durability in (qos.LATCHED, qos.LATEST):
        create_subscription(node, 'e_stop', lambda message: callback(message.data),
                            profile=durability)


def create_service(node: Node, kind: Any, name: str,
                   callback: Callable[[Any, Any], Any]) -> Service:
    """Return a service whose callback may return a future of the response, to answer later."""
    server = node.create_service(kind, name, callback)
    answer_later(server)
    return server


def create_trigger(node: Node, name: str, act: Callable[[], str]) -> Service:
    """
    Return a service of type std_srvs/Trigger, which answers with the message that `act` returns.

    If `act` raises a `BallbotError`, the service reports failure with the message of the error.
    """
    def callback(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            response.message, response.success = act(), True
        except BallbotError as error:
            response.message = str(error)
        return response
    return node.create_service(Trigger, name, callback)


def has_subscribers(publisher: Publisher) -> bool:
    """Return whether a message has a subscriber; otherwise it need not be created."""
    return bool(publisher.get_subscription_count())


def wait_until_received(publisher: Publisher) -> None:
    """Wait until the last message is acknowledged; destroying the publisher might lose it."""
    publisher.wait_for_all_acked(Duration(seconds=RECEIVED_TIMEOUT))


def publisher_names(node: Node, topic: str) -> str:
    """Return the names of the nodes that publish on a topic, in one line."""
    found = node.get_publishers_info_by_topic(node.resolve_topic_name(topic))
    return ', '.join(sorted(set(map(endpoint_name, found))))


def mismatches(node: Node) -> List[str]:
    """
    Return a message for each other node with an endpoint incompatible with this node.

    Endpoints are incompatible if their types or QoS profiles do not match.  A second publisher of
    ``/clock`` is also reported: with two of them, time jumps back and forth.
    """
    own = _full_name(node.get_namespace(), node.get_name())
    found = []
    topics = {endpoint.topic_name for endpoint in (*node.publishers, *node.subscriptions)}
    for topic in sorted(topics):
        sources = node.get_publishers_info_by_topic(topic)
        sinks = node.get_subscriptions_info_by_topic(topic)
        for source in sources:
            reasons = [(endpoint_name(sink), _mismatch(source, sink)) for sink in sinks]
            received = {name for name, reason in reasons if not reason}
            found += [f'{name} cannot receive {topic} from {endpoint_name(source)}: {reason}'
                      for name, reason in reasons
                      if own in (name, endpoint_name(source)) and name not in received]
        names = sorted({endpoint_name(source) for source in sources})
        if topic == CLOCK and own in names and len(names) > 1:
            others = ' and '.join(name for name in names if name != own)
            found.append(f'{others} also publishes {CLOCK}, but a graph has one clock: start '
                         'all other simulators with publish_clock:=false')
    return found


def _full_name(namespace: str, name: str) -> str:
    return f'{namespace.rstrip("/")}/{name}'


def endpoint_name(endpoint: TopicEndpointInfo) -> str:
    """Return the full name of the node of an endpoint."""
    return _full_name(endpoint.node_namespace, endpoint.node_name)


def _mismatch(source: TopicEndpointInfo, sink: TopicEndpointInfo) -> str:
    """Return the reason why messages do not pass between two endpoints, empty if they do."""
    if source.topic_type != sink.topic_type:
        return f'it is published as {source.topic_type} and subscribed to as {sink.topic_type}'
    verdict, reason = qos_check_compatible(source.qos_profile, sink.qos_profile)
    return str(reason).replace('ERROR: ', '').strip('; ') \
        if verdict == QoSCompatibility.ERROR else ''
