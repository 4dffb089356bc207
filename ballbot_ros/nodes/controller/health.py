# SPDX-License-Identifier: Apache-2.0
"""What the node ``controller`` says of itself on /diagnostics."""
from collections import Counter
import time

from ballbot_ros.control import SupervisedController, Watchdog
from ballbot_ros.ros import diagnostics


def health(controller: SupervisedController, watchdog: Watchdog, torque: float,
           refused: Counter) -> diagnostics.Health:
    """
    Return level, message and numbers.

    Parameters
    ----------
    controller : SupervisedController
    watchdog : Watchdog
        That joint states feed.
    torque : float
        Commanded last [N m].
    refused : Counter
        Messages, by reason.

    """
    now = controller.set_point
    values = {
        'mode': now.mode.value, 'set_value': f'{now.value:.4f}',
        'torque': f'{torque:.4f}', 'state_rate': f'{controller.rate or 0.0:.1f}',
        **diagnostics.refusals('messages', refused)}
    if not watchdog.fed:
        return diagnostics.WARN, 'waiting for joint_states', values
    if watchdog.expired(time.monotonic()):
        return diagnostics.WARN, 'no joint_states any more, torque is 0', values
    if controller.e_stop:
        return diagnostics.WARN, 'the e-stop is engaged, torque is 0', values
    if controller.too_slow:
        return diagnostics.ERROR, 'joint_states come too rarely, torque is 0', values
    if controller.overcome:
        return diagnostics.WARN, 'running; more resists the set speed than can be held', values
    if refused:
        return diagnostics.WARN, 'running; messages were refused', values
    return diagnostics.OK, 'running', values

