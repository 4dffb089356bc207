# SPDX-License-Identifier: Apache-2.0
"""The black box of a node: what its session tells and its layers log, with files after a fault."""
import atexit
import logging
import os
from pathlib import Path

from ballbot_ros import __version__
from ballbot_ros.black_box.file import BlackBoxFiles
from ballbot_ros.black_box.ring import BlackBox, NOTE, Witness
from ballbot_ros.bridge.hardware_file import Hardware

LOGGER = 'ballbot_ros.bridge'
ROS_HOME = '~/.ros'  # where the environment names no other


def place(folder: str) -> Path:
    """Return the path of a folder, in ROS_HOME where it is said to be in its default."""
    path, home = Path(folder), os.environ.get('ROS_HOME')
    if home and path.is_relative_to(ROS_HOME):
        return Path(home) / path.relative_to(ROS_HOME)
    return path.expanduser()


class NoteHandler(logging.Handler):
    """Puts the lines of a log into a black box, each when it was logged."""

    def __init__(self, box: BlackBox):
        """Take records from INFO on."""
        super().__init__(logging.INFO)
        self._box = box

    def emit(self, record: logging.LogRecord) -> None:
        """Take a line."""
        self._box.tell(record.getMessage(), NOTE)


def black_box(folder: str, hardware: Hardware) -> Witness:
    """
    Return who is to be told what happens to the hardware.

    Files go to a folder; without one nothing is kept.  What is due when the process ends is
    written then.
    """
    if not folder:
        return Witness()
    connection = hardware.connection
    box = BlackBox(period=1.0 / connection.loop_rate)
    files = BlackBoxFiles(box, place(folder), {
        'hardware': hardware.name, 'robot': hardware.robot, 'protocol': connection.protocol,
        'port': connection.port, 'loop_rate': f'{connection.loop_rate:g}',
        'torque_limit': f'{hardware.limits.torque_limit:g}', 'version': __version__})
    atexit.register(files.close)
    logging.getLogger(LOGGER).addHandler(NoteHandler(box))
    return box
