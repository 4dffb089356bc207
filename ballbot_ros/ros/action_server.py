# SPDX-License-Identifier: Apache-2.0
"""
An action server whose goals are processed by the callbacks of the node, not by a coroutine.

rclpy runs a goal as a coroutine, which its event-driven executor never resumes (7.1.6); a loop in
a callback would block the node.  Therefore the owner receives each accepted goal, and returns it
with its result.
"""
from typing import Any, Callable

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node

from ballbot_ros.errors import BallbotError
from ballbot_ros.ros.rclpy_compat import send_result


class DeferredActionServer(ActionServer):
    """
    Serves an action; cancel requests are accepted, and the handle of the goal shows them.

    `check` is called with each request and raises `BallbotError` to refuse it; `begin` is called
    with the handle of each accepted goal.
    """

    def __init__(self, node: Node, kind: Any, name: str, check: Callable[[Any], None],
                 begin: Callable[[ServerGoalHandle], None]):
        def respond(request: Any) -> GoalResponse:
            try:
                check(request)
            except BallbotError as error:
                node.get_logger().warning(f'{name} refused: {error}')
                return GoalResponse.REJECT
            return GoalResponse.ACCEPT

        def accepted(handle: ServerGoalHandle) -> None:
            handle.execute()
            begin(handle)

        super().__init__(
            node, kind, name, lambda _: None, goal_callback=respond,
            handle_accepted_callback=accepted, cancel_callback=lambda _: CancelResponse.ACCEPT)
        end_node = node.destroy_node

        def destroy_node() -> None:
            # rclpy leaves action servers to the garbage collector.  Until it runs, they keep the
            # node in the graph, and then remove the endpoints of the next node of this name.
            if self in node.waitables:
                self.destroy()
            end_node()
        node.destroy_node = destroy_node

    def notify_execute(self, goal_handle: ServerGoalHandle, execute_callback: Any) -> None:
        """Do nothing: the owner processes the goal."""

    def finish(self, handle: ServerGoalHandle, result: Any) -> None:
        """Send the result of a goal whose handle already has its final status."""
        send_result(self, handle, result)
