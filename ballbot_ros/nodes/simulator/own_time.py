# SPDX-License-Identifier: Apache-2.0
"""A node that makes the simulated time must not wait for it."""
from typing import List

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

USELESS = 'use_sim_time is of no use to the simulator, which makes the simulated time'


def keep_own_time(node: Node) -> None:
    """Warn if a node was told to go by /clock, and refuse it from now on."""
    if node.get_parameter('use_sim_time').value:
        node.get_logger().warning(USELESS)

    def check(parameters: List[Parameter]) -> SetParametersResult:
        asked = any(one.name == 'use_sim_time' and one.value for one in parameters)
        return SetParametersResult(successful=not asked, reason=USELESS if asked else '')
    node.add_on_set_parameters_callback(check)
