# SPDX-License-Identifier: Apache-2.0
"""
A lifecycle node that rejects invalid requests, and can start automatically.

If a transition is not possible in the current state, the callback of the service
``change_state`` raises an error in rclpy of Jazzy, which ends the process; in rclpy of Kilted, it
refuses the request and logs the error of the C library.
"""
from typing import Any, Callable

from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn

from ballbot_ros.ros.endpoints import create_wall_timer
from ballbot_ros.ros.rclpy_compat import (
    available_transitions, change_state_service, state_label, transition_label)

SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE
# Period of the attempts to start [s].
START_RETRY_PERIOD = 1.0
UNCONFIGURED, INACTIVE = 'unconfigured', 'inactive'

Serve = Callable[[ChangeState.Request, ChangeState.Response], ChangeState.Response]


class ManagedNode(LifecycleNode):
    """A lifecycle node that rejects an invalid transition and logs the reason."""

    def __init__(self, name: str, **kwargs: Any):
        super().__init__(name, **kwargs)
        self.managed = False  # whether a service call has requested a transition
        service = change_state_service(self)
        serve: Serve = service.callback

        def served(request: ChangeState.Request, response: ChangeState.Response
                   ) -> ChangeState.Response:
            wanted, possible = request.transition, available_transitions(self)
            if any(wanted.label == label if wanted.label else wanted.id == number
                   for number, label in possible):
                response = serve(request, response)
            else:
                response.success = False
                self.get_logger().error(
                    f'{wanted.label or transition_label(self, wanted.id)}'
                    f' is not possible: the node is {self.state_label}, with the transitions '
                    + (', '.join(label for _, label in possible) or 'none'))
            self.managed = self.managed or response.success
            return response
        service.callback = served

    @property
    def state_label(self) -> str:
        return state_label(self)

    def start(self) -> bool:
        """Configure if necessary, and activate; return whether the node is active."""
        if self.state_label == UNCONFIGURED and self.trigger_configure() is not SUCCESS:
            return False
        return self.state_label == INACTIVE and self.trigger_activate() is SUCCESS

    def autostart(self) -> None:
        """Start with retries, until this succeeds or an external manager takes over."""
        self._retries = create_wall_timer(self, START_RETRY_PERIOD, self._try_start)
        self._try_start()

    def _try_start(self) -> None:
        if self.managed or self.state_label not in (UNCONFIGURED, INACTIVE):
            self.get_logger().info(f'autostart leaves the node {self.state_label}, as requested')
            self._retries.cancel()
        elif self.start():
            self._retries.cancel()
