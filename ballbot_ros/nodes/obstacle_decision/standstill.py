# SPDX-License-Identifier: Apache-2.0
"""E-stop latch of a node that publishes set-points: released only by ``~/resume``."""
from typing import Callable

from rclpy.node import Node

from ballbot_ros.errors import RefusedError
from ballbot_ros.ros.endpoints import create_trigger, subscribe_e_stop


class Standstill:
    """
    Latches the e-stop, calls `stand` when it engages, and offers the service ``~/resume``.

    Releasing the e-stop permits motion but does not start it: a person may stand next to the ball.
    `engaged` is the latest state of the e-stop; `standing` lasts until the next resume, which also
    calls `go_on`; this returns whether it changed the mode.
    """

    def __init__(self, node: Node, stand: Callable[[], None], go_on: Callable[[], bool]):
        """Subscribe; without a publisher the e-stop counts as released."""
        self._stand, self._go_on, self._logger = stand, go_on, node.get_logger()
        self._service = f'{node.get_fully_qualified_name()}/resume'
        self.engaged = self.standing = False
        subscribe_e_stop(node, self._on_e_stop)
        create_trigger(node, '~/resume', self._resume)

    @property
    def reason(self) -> str:
        """Return the reason of the standstill as text."""
        return 'standing: the e-stop is engaged' if self.engaged else (
            f'standing: the e-stop was engaged; to continue call {self._service}')

    def _on_e_stop(self, engaged: bool) -> None:
        if engaged == self.engaged:
            return
        self.engaged = engaged
        if self.engaged and not self.standing:
            self.standing = True
            self._stand()
        self._logger.warning(self.reason)

    def _resume(self) -> str:
        if self.engaged:
            raise RefusedError('the e-stop is engaged: release it first', 'standing', 'e_stop')
        went_on = self._go_on()
        was, self.standing = self.standing or went_on, False
        return 'resumed' if was else 'no stop to resume from'
