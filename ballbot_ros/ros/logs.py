# SPDX-License-Identifier: Apache-2.0
"""Forwarding of the log records of the layers without ROS to the log of ROS."""
import logging
from logging.handlers import QueueHandler
from queue import SimpleQueue

from rclpy.node import Node

from ballbot_ros.ros.rclpy_compat import RcutilsLogger


class RosHandler(logging.Handler):
    """Passes the records of Python's `logging` to the logger of a node."""

    def __init__(self, logger: RcutilsLogger):
        super().__init__(logging.INFO)
        self._logger = logger

    def emit(self, record: logging.LogRecord) -> None:
        """Log a record; the logger of ROS requires a line of code for each severity."""
        if record.levelno >= logging.ERROR:
            self._logger.error(record.getMessage())
        elif record.levelno >= logging.WARNING:
            self._logger.warning(record.getMessage())
        else:
            self._logger.info(record.getMessage())


def forward_logs(node: Node) -> None:
    """Forward the log records of the layers without ROS to the logger of a node."""
    log = logging.getLogger('ballbot_ros')
    log.handlers = [RosHandler(node.get_logger())]
    log.setLevel(logging.INFO)


class DeferredLogs:
    """
    Buffers log records, so that a loop that drives a motor does not wait for a terminal.

    The records are those of the logger `name` and of its children.
    """

    def __init__(self, name: str):
        self._logger = logging.getLogger(name)
        self._queue: SimpleQueue[logging.LogRecord] = SimpleQueue()
        self._logger.handlers, self._logger.propagate = [QueueHandler(self._queue)], False
        # Parent loggers have no handler before the node exists.
        self._logger.setLevel(logging.INFO)

    def forward(self) -> None:
        """Log the buffered records."""
        while not self._queue.empty():
            record = self._queue.get()
            if self._logger.parent is not None:
                self._logger.parent.handle(record)
