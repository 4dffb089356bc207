# SPDX-License-Identifier: Apache-2.0
"""Unknown names are refused if given to this node, and ignored if given to many nodes."""
from functools import partial
import sys

import pytest
from rclpy.node import Node
from refusals import refused

from ballbot_ros.nodes.controller.settings import ControllerSettings
from ballbot_ros.ros.parameters import declare

FILE = """
/**:
  ros__parameters:
    rate: 400
    {many}: 1
/left/*:
  ros__parameters: {{nested: {{deep: 1}}}}
/left/controller:
  ros__parameters:
    {one}: gentle
/right:
  controller:
    ros__parameters: {{other: 1}}
"""


@pytest.fixture
def started(make_node, tmp_path, monkeypatch):
    """Return a function that starts a node with a parameter file and arguments."""
    def start(*arguments, many='frequency', one='tuning'):
        path = tmp_path / 'parameters.yaml'
        path.write_text(FILE.format(many=many, one=one))
        line = ['--ros-args', '--params-file', str(path), '-r', '__ns:=/left', *arguments]
        monkeypatch.setattr(sys, 'argv', ['controller', *line])
        node = make_node(partial(Node, cli_args=line), 'controller')
        return declare(node, ControllerSettings)
    return start


def test_an_unknown_name_in_a_section_for_many_nodes_is_ignored(started, capfd):
    settings = started()
    assert (settings.rate, settings.tuning) == (400.0, 'gentle')
    warning, = [line for line in capfd.readouterr().err.splitlines() if 'WARN' in line]
    assert "'frequency'" in warning and "'nested.deep'" in warning and "'other'" not in warning


def test_an_unknown_name_similar_to_a_parameter_is_reported_with_it(started, capfd):
    started(many='tunning')
    warning, = [line for line in capfd.readouterr().err.splitlines() if 'WARN' in line]
    assert "'tunning'" in warning and "'tuning'" in warning


def test_an_unknown_name_in_a_section_for_this_node_is_refused(started):
    with refused('unknown_name', 'tunning') as caught:
        started(one='tunning')
    assert "'tuning'" in str(caught.value)


@pytest.mark.parametrize('argument', ['frequency:=1', 'controller:frequency:=1'])
def test_an_unknown_name_on_the_command_line_is_refused_despite_files(started, argument):
    with refused('unknown_name', 'frequency'):
        started('-p', argument)
