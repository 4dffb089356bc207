# SPDX-License-Identifier: Apache-2.0
"""The black box of a node: the folder of its files, and the log records that it stores."""
import logging
from pathlib import Path

import pytest

from ballbot_ros.black_box.ring import BlackBox
from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.nodes.bridge.session_setup import black_box, LOGGER, resolve_folder
from ballbot_ros.ros.logs import DeferredLogs


@pytest.mark.parametrize('folder, home, found', [
    ('~/.ros/ballbot', None, Path.home() / '.ros/ballbot'),
    ('~/.ros/ballbot', '/var/ros', Path('/var/ros/ballbot')),
    ('~/here', '/var/ros', Path.home() / 'here'), ('/a/b', '/var/ros', Path('/a/b'))])
def test_the_default_folder_is_that_of_ros(folder, home, found, monkeypatch):
    monkeypatch.delenv('ROS_HOME', raising=False)
    if home:
        monkeypatch.setenv('ROS_HOME', home)
    assert resolve_folder(folder) == found


def test_log_records_of_the_bridge_are_recorded_when_logged_not_when_printed(
        tmp_path, monkeypatch):
    monkeypatch.setattr('atexit.register', lambda act: act)
    logger = logging.getLogger(LOGGER)
    monkeypatch.setattr(logger, 'handlers', [])
    monkeypatch.setattr(logger, 'level', logging.INFO)
    DeferredLogs(LOGGER)
    box = black_box(str(tmp_path), load_hardware('gimball_odrive'))
    logging.getLogger(f'{LOGGER}.session').warning('the %s is on fire', 'motor')
    block, = box.snapshot()
    assert bytes(block).endswith(b'the motor is on fire\0')


def test_without_a_folder_nothing_is_recorded():
    assert not isinstance(black_box('', load_hardware('gimball_odrive')), BlackBox)
