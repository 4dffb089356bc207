# SPDX-License-Identifier: Apache-2.0
"""The black box of the node: the events of its session, its log, and a file after each fault."""
import atexit
import logging
import os
from pathlib import Path

from ballbot_ros import __version__
from ballbot_ros.black_box.dump import BlackBoxFiles
from ballbot_ros.black_box.ring import BlackBox
from ballbot_ros.bridge.hardware_file import Hardware
from ballbot_ros.bridge.observer import Level, SessionObserver

LOGGER = 'ballbot_ros.bridge'
ROS_HOME = '~/.ros'  # the default of the environment variable


def resolve_folder(folder: str) -> Path:
    """Return the path of a folder; the default is relative to ROS_HOME if that is set."""
    path, home = Path(folder), os.environ.get('ROS_HOME')
    if home and path.is_relative_to(ROS_HOME):
        return Path(home) / path.relative_to(ROS_HOME)
    return path.expanduser()


class LogRecorder(logging.Handler):
    """Records the lines of a log in a black box, with the time of each."""

    def __init__(self, box: BlackBox):
        super().__init__(logging.INFO)
        self._box = box

    def emit(self, record: logging.LogRecord) -> None:
        """Record a line."""
        self._box.event(record.getMessage(), Level.LOG)


def black_box(folder: str, hardware: Hardware) -> SessionObserver:
    """
    Return the observer of a session.

    Files go to a folder; without one nothing is recorded.  Pending files are written when the
    process ends.
    """
    if not folder:
        return SessionObserver()
    connection = hardware.connection
    box = BlackBox(period=1.0 / connection.loop_rate)
    files = BlackBoxFiles(box, resolve_folder(folder), {
        'hardware': hardware.name, 'robot': hardware.robot, 'protocol': connection.protocol,
        'port': connection.port, 'loop_rate': f'{connection.loop_rate:g}',
        'torque_limit': f'{hardware.limits.torque_limit:g}', 'version': __version__})
    atexit.register(files.close)
    logging.getLogger(LOGGER).addHandler(LogRecorder(box))
    return box
