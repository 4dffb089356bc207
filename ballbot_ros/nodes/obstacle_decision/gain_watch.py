# SPDX-License-Identifier: Apache-2.0
"""Warn when the follower of the set-points uses other gains than the planner assumes."""
from rcl_interfaces.msg import ParameterEvent
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import qos_profile_parameter_events

from ballbot_ros.ros.endpoints import create_subscription, endpoint_name

EVENTS = '/parameter_events'


class GainWatch:
    """
    Monitors parameter changes of the nodes that follow the set-points of a node.

    Plans depend on gains (``control_tuning``): with others the pendulum takes another path to its
    set angle.  New gains are not adopted automatically: the driving node is not known, and
    the learned parameters depend on the gains.

    Parameters
    ----------
    node : Node
        With a parameter ``control_tuning``, that publishes ``set_point``.

    """

    def __init__(self, node: Node):
        self._node, self._topic = node, node.resolve_topic_name('set_point')
        create_subscription(
            node, EVENTS, self.on_event, ParameterEvent, qos_profile_parameter_events)

    def on_event(self, event: ParameterEvent) -> None:
        """Warn when a node that follows the set-points changes its gains."""
        changed = {one.name: parameter_value_to_python(one.value)
                   for one in event.changed_parameters
                   if one.name == 'tuning' or one.name.startswith('gains.')}
        followers = map(endpoint_name, self._node.get_subscriptions_info_by_topic(self._topic))
        if not changed or event.node not in followers:
            return
        planned = self._node.get_parameter('control_tuning').value
        if 'tuning' in changed:
            if changed['tuning'] == planned:
                return
            changed = {'tuning': changed['tuning']}
        said = ', '.join(f'{name} {value}' for name, value in changed.items())
        self._node.get_logger().warning(
            f'{event.node} now uses other gains ({said}), but plans are still computed for '
            f'control_tuning {planned!r}: to keep them, set control_tuning to a file with '
            'these gains')
