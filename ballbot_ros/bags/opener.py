# SPDX-License-Identifier: Apache-2.0
"""What reads bags here: the Python package rosbags, or the rosbag2_py of a ROS installation."""
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ballbot_ros.errors import ConfigurationError

ENDINGS = ('.mcap', '.db3')


def is_bag(path: Path) -> bool:
    """Return whether a path looks like a bag: its one file, or a folder with one or its index."""
    if path.is_dir():
        return (path / 'metadata.yaml').exists() or any(
            file.suffix in ENDINGS for file in path.iterdir())
    return path.suffix in ENDINGS


def bag_opener() -> Any:
    """Return what opens bags; `ConfigurationError` where nothing does."""
    if find_spec('rosbags') is not None:
        from ballbot_ros.bags.reader import open_bag
        return open_bag
    if find_spec('rosbag2_py') is not None:
        from ballbot_ros.bags.source import open_bag as open_with_ros
        return open_with_ros
    from ballbot_ros.bags.storage import MISSING
    raise ConfigurationError(MISSING, 'not_installed')
