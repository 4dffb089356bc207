# SPDX-License-Identifier: Apache-2.0
"""
Publishers and subscribers without the cost of rclpy's default event handlers.

Each default handler is one more thing that the executor prepares at every wait; at 500 Hz
they take most of its time.  What they tell, that two endpoints cannot talk to each other, is
looked up now and then instead, and told with the name of the other node.
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

# How long the last message of a publisher may take to be received [s]; it takes 5 ms, unless
# a subscriber has died.
LAST_WORD = 0.5


def advertise(node: Node, kind: Any, topic: str, profile: QoSProfile) -> Publisher:
    """Return a publisher; see `qos` for profiles."""
    return node.create_publisher(
        kind, topic, profile,
        event_callbacks=PublisherEventCallbacks(use_default_callbacks=False))


def listen(node: Node, kind: Any, topic: str, callback: Callable[[Any], None],
           profile: QoSProfile, raw: bool = False) -> Subscription:
    """Return a subscription; see `qos` for profiles."""
    return node.create_subscription(
        kind, topic, callback, profile, raw=raw,
        event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False))


def serve(node: Node, kind: Any, name: str, callback: Callable[[Any, Any], Any]) -> Service:
    """Return a service whose callback may return a future of the response, to answer later."""
    service = node.create_service(kind, name, callback)
    send = service.send_response

    def send_response(response: Any, header: Any) -> None:
        if isinstance(response, Future):
            response.add_done_callback(lambda done: send(done.result(), header))
        else:
            send(response, header)

    # A coroutine would do for one executor of rclpy, and not for the other.
    service.send_response = send_response
    return service


def deliver(publisher: Publisher) -> None:
    """Wait until all have what was published last; destroyed at once, it might get lost."""
    publisher.wait_for_all_acked(Duration(seconds=LAST_WORD))


def mismatches(node: Node) -> List[str]:
    """Return a sentence for each pair of this node and another that cannot talk."""
    own = node.get_name()
    found = []
    topics = {endpoint.topic_name for endpoint in (*node.publishers, *node.subscriptions)}
    for topic in sorted(topics):
        for source in node.get_publishers_info_by_topic(topic):
            for sink in node.get_subscriptions_info_by_topic(topic):
                verdict, reason = qos_check_compatible(source.qos_profile, sink.qos_profile)
                if own in (source.node_name, sink.node_name) \
                        and verdict == QoSCompatibility.ERROR:
                    found.append(f'{sink.node_name} cannot hear {topic} of '
                                 f'{source.node_name}: {reason}')
    return found
