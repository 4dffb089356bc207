# SPDX-License-Identifier: Apache-2.0
"""
The executor that all nodes here run on.

rclpy's older executors prepare every service, timer and subscription of the node again before
each wait; at 500 Hz that takes more of the processor than all callbacks.  The one that is driven
by events does not.  It came to Jazzy with rclpy 7.1.5; before that, an older one does as well,
only slower.
"""
from typing import Optional

from rclpy.context import Context
from rclpy.executors import Executor, SingleThreadedExecutor

try:
    from rclpy.experimental import EventsExecutor
except ImportError:
    EventsExecutor = SingleThreadedExecutor


def new_executor(context: Optional[Context] = None) -> Executor:
    """Return an executor of one thread, the fastest that this rclpy has."""
    return EventsExecutor(context=context)
