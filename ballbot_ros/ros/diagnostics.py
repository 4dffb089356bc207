# SPDX-License-Identifier: Apache-2.0
"""Health of a node on /diagnostics, once a second and immediately on a change."""
from typing import Callable, Dict, Mapping, Optional, Tuple

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from std_msgs.msg import Header

from ballbot_ros.ros.endpoints import create_publisher, create_wall_timer, mismatches

OK = DiagnosticStatus.OK
WARN = DiagnosticStatus.WARN
ERROR = DiagnosticStatus.ERROR

# Period in wall time, because health is also published while simulated time is stopped [s].
PERIOD = 1.0
# Publications between two searches for endpoints with incompatible profiles.
MATCH_CHECK_INTERVAL = 10

Health = Tuple[bytes, str, Mapping[str, object]]


def refusals(kind: str, counts: Mapping[str, int]) -> Dict[str, int]:
    """Return the number of refused messages, in total and by reason, as named values."""
    return {f'{kind}_refused': sum(counts.values()),
            **{f'refused_{reason}': number for reason, number in counts.items()}}


class Diagnostics:
    """
    Publishes level, message and named values that `report` returns, under the name of the node.

    The hardware id consists of the namespace of the node and `hardware`, such as the name of a
    robot.  `stamp` returns the time of a node whose time is not that of its clock.
    """

    def __init__(self, node: Node, name: str, report: Callable[[], Health], hardware: str,
                 stamp: Optional[Callable[[], Time]] = None):
        self._node = node
        self._name = f'{node.get_fully_qualified_name().lstrip("/")}: {name}'
        self._hardware = '/'.join(filter(None, (node.get_namespace().strip('/'), hardware)))
        self._report = report
        self._stamp = stamp or (lambda: node.get_clock().now().to_msg())
        self._count = 0
        self._publisher = create_publisher(node, '/diagnostics')
        create_wall_timer(node, PERIOD, self.publish)

    def publish(self) -> None:
        level, message, values = self._report()
        status = DiagnosticStatus(
            level=level, name=self._name, message=message, hardware_id=self._hardware,
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()])
        self._publisher.publish(DiagnosticArray(
            header=Header(stamp=self._stamp()), status=[status]))
        self._count += 1
        if self._count % MATCH_CHECK_INTERVAL == 2:
            for sentence in mismatches(self._node):
                self._node.get_logger().warning(sentence)
