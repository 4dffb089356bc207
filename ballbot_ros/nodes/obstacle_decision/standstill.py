# SPDX-License-Identifier: Apache-2.0
"""What a node that gives set-points does about the e-stop: it stands until it is told to go on."""
from typing import Callable

from rclpy.node import Node

from ballbot_ros.errors import RefusedError
from ballbot_ros.ros.endpoints import create_trigger, subscribe_e_stop


class Standstill:
    """
    Hears the e-stop, and offers the service ``~/resume``.

    A released e-stop permits motion and starts none: who releases it may stand beside the ball.

    Parameters
    ----------
    node : Node
    stand : callable
        Called when the e-stop engages.

    Attributes
    ----------
    engaged : bool
        The e-stop, as heard last.
    standing : bool
        It is engaged, or nobody has asked to go on since.
    go_on : callable
        Called by the service, too; returns whether that changed anything.

    """

    def __init__(self, node: Node, stand: Callable[[], None]):
        """Subscribe; as long as nobody publishes an e-stop there is none."""
        self._stand, self._logger = stand, node.get_logger()
        self.go_on: Callable[[], bool] = lambda: False
        self._service = f'{node.get_fully_qualified_name()}/resume'
        self.engaged = self.standing = False
        subscribe_e_stop(node, self._on_e_stop)
        create_trigger(node, '~/resume', self._resume)

    @property
    def reason(self) -> str:
        """Return why it stands, in words."""
        return 'standing: the e-stop is engaged' if self.engaged else (
            f'standing: the e-stop was engaged; to go on call {self._service}')

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
            raise RefusedError('the e-stop is engaged: release it first')
        went_on = self.go_on()
        was, self.standing = self.standing or went_on, False
        return 'going on' if was else 'nothing has stopped it'
