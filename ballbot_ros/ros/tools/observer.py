# SPDX-License-Identifier: Apache-2.0
"""A temporary node for a command."""
import os
import time
from typing import Any, Callable, List, Optional

import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from ballbot_ros.config.fields import suggestion
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.ros import discovery
from ballbot_ros.ros.rclpy_compat import new_executor

# Discovery is complete when the graph has not changed for the first time, at the latest after the
# second one [s].  It takes less than half a second on an idle machine.
SETTLED, LONGEST = 0.5, 4.0
POLL = 0.05  # [s]


class Observer:
    """
    Node and executor of a command; use as a context manager.

    Parameters
    ----------
    name : str
        Of the command; the node is named after it and the process.
    context : Context, optional
        An existing context; by default a new one, configured by `ros.discovery`.

    """

    def __init__(self, name: str, context: Optional[Context] = None):
        """Join the graph."""
        self._own = context is None
        if context is None:
            discovery.apply(os.environ)
            context = Context()
            rclpy.init(context=context, args=[], signal_handler_options=SignalHandlerOptions.NO)
        self._context = context
        self.node = Node(f'ballbot_{name}_{os.getpid()}', context=context,
                         use_global_arguments=False, enable_rosout=False,
                         start_parameter_services=False)
        self._executor = new_executor(context)
        self._executor.add_node(self.node)

    def __enter__(self) -> 'Observer':
        """Return itself."""
        return self

    def __exit__(self, *_: Any) -> None:
        """Leave the graph."""
        self._executor.remove_node(self.node)
        self.node.destroy_node()
        self._executor.shutdown()
        if self._own:
            rclpy.try_shutdown(context=self._context)

    def spin(self, seconds: float = POLL) -> None:
        """Process callbacks for at most a time [s]."""
        self._executor.spin_once(timeout_sec=seconds)

    def wait(self, condition: Callable[[], Any], seconds: float) -> Any:
        """Return the result of a condition once it is true, or after a timeout [s]."""
        deadline = time.monotonic() + seconds
        while not (found := condition()) and time.monotonic() < deadline:
            self.spin()
        return found

    def settle(self) -> None:
        """Wait until the graph has not changed for a while, so discovery is complete."""
        self.wait(self._others, LONGEST)
        start = changed = time.monotonic()
        known = None
        while time.monotonic() < min(changed + SETTLED, start + LONGEST):
            now = self._graph()
            if now != known:
                known, changed = now, time.monotonic()
            self.spin()

    def _others(self) -> bool:
        return any(name != self.node.get_name() for name in self.node.get_node_names())

    def _graph(self) -> List[Any]:
        return [sorted(self.node.get_node_names_and_namespaces()),
                sorted(self.node.get_topic_names_and_types())]

    def resolve(self, topic: str) -> str:
        """Return the full name of a topic in the namespace of the command."""
        try:
            return self.node.resolve_topic_name(topic)
        except Exception as error:
            raise ConfigurationError(
                f'{topic!r} is no name of a topic: {error}', 'wrong_type', 'topic') from error

    def type_of(self, topic: str, seconds: float, waiting: Callable[[], None]) -> str:
        """
        Return the type of a topic; calls `waiting` once if it does not exist yet.

        Raises
        ------
        ConfigurationError
            If it has several types, or does not appear; names the most similar topic.

        """
        name = self.resolve(topic)
        found = self.wait(lambda: self._types(name), min(SETTLED, seconds))
        if not found and seconds > SETTLED:
            waiting()
            found = self.wait(lambda: self._types(name), seconds - SETTLED)
        if not found:
            known = [one for one, _ in self.node.get_topic_names_and_types()]
            raise ConfigurationError(
                f'no node publishes or subscribes to {name}{suggestion(name, known)}; '
                f'"ballbot topics" lists what there is', 'unknown_name', 'topic')
        if len(found) > 1:
            raise ConfigurationError(f'{name} has several types, {" and ".join(found)}: '
                                     'end those nodes that mean the other one',
                                     'ambiguous', 'topic')
        return str(found[0])

    def _types(self, name: str) -> List[str]:
        return dict(self.node.get_topic_names_and_types()).get(name, [])

    def profile(self, topic: str, depth: int = 1000) -> QoSProfile:
        """Return a profile that is compatible with all publishers."""
        offered = [one.qos_profile for one in self.node.get_publishers_info_by_topic(topic)]
        reliable = all(one.reliability == ReliabilityPolicy.RELIABLE for one in offered)
        latched = all(one.durability == DurabilityPolicy.TRANSIENT_LOCAL for one in offered)
        return QoSProfile(
            history=HistoryPolicy.KEEP_LAST, depth=depth,
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if offered and latched
            else DurabilityPolicy.VOLATILE)
