# SPDX-License-Identifier: Apache-2.0
"""
Publishers and subscriptions without the cost of rclpy's default event handlers, and services.

Each default handler is one more thing that the executor prepares at every wait; at 500 Hz
they take most of its time.  What they report, that two endpoints do not match, is looked up
now and then instead, and logged with the name of the other node.
"""
from typing import Any, Callable, List

from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import qos_check_compatible, QoSCompatibility, QoSProfile
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.task import Future
from std_srvs.srv import Trigger

from ballbot_ros.errors import BallbotError

# How long the last message of a publisher may take to be received [s]; it takes 5 ms, unless
# a subscriber has died.
RECEIVED_TIMEOUT = 0.5


def create_publisher(node: Node, kind: Any, topic: str, profile: QoSProfile) -> Publisher:
    """Return a publisher; see `qos` for profiles."""
    return node.create_publisher(
        kind, topic, profile,
        event_callbacks=PublisherEventCallbacks(use_default_callbacks=False))


def create_subscription(node: Node, kind: Any, topic: str, callback: Callable[[Any], None],
                        profile: QoSProfile, raw: bool = False) -> Subscription:
    """Return a subscription; see `qos` for profiles."""
    return node.create_subscription(
        kind, topic, callback, profile, raw=raw,
        event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False))


def create_service(node: Node, kind: Any, name: str,
                   callback: Callable[[Any, Any], Any]) -> Service:
    """Return a service whose callback may return a future of the response, to answer later."""
    server = node.create_service(kind, name, callback)
    send = server.send_response

    def send_response(response: Any, header: Any) -> None:
        if isinstance(response, Future):
            response.add_done_callback(lambda done: send(done.result(), header))
        else:
            send(response, header)

    # A coroutine would do for one executor of rclpy, and not for the other.
    server.send_response = send_response
    return server


def create_trigger(node: Node, name: str, act: Callable[[], str]) -> Service:
    """
    Return a service of type std_srvs/Trigger.

    Parameters
    ----------
    node : Node
    name : str
    act : callable
        Returns the message of a success; the message of a `BallbotError` that it raises says
        why it did not succeed.

    """
    def callback(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            response.message, response.success = act(), True
        except BallbotError as error:
            response.message = str(error)
        return response
    return node.create_service(Trigger, name, callback)


def wait_until_received(publisher: Publisher) -> None:
    """Wait until all have what was published last; destroyed at once, it might get lost."""
    publisher.wait_for_all_acked(Duration(seconds=RECEIVED_TIMEOUT))


def publisher_names(node: Node, topic: str) -> str:
    """Return the names of the nodes that publish on a topic, in one line."""
    found = node.get_publishers_info_by_topic(node.resolve_topic_name(topic))
    return ', '.join(sorted({
        f'{one.node_namespace.rstrip("/")}/{one.node_name}' for one in found}))


def mismatches(node: Node) -> List[str]:
    """Return a sentence for each pair of this node and another whose profiles do not match."""
    own = node.get_name()
    found = []
    topics = {endpoint.topic_name for endpoint in (*node.publishers, *node.subscriptions)}
    for topic in sorted(topics):
        for source in node.get_publishers_info_by_topic(topic):
            for sink in node.get_subscriptions_info_by_topic(topic):
                verdict, reason = qos_check_compatible(source.qos_profile, sink.qos_profile)
                if own in (source.node_name, sink.node_name) \
                        and verdict == QoSCompatibility.ERROR:
                    found.append(f'{sink.node_name} cannot receive {topic} from '
                                 f'{source.node_name}: {reason}')
    return found
