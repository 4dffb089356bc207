# SPDX-License-Identifier: Apache-2.0
"""The parameters of the nodes are available without ROS, as `ballbot replay` requires."""
import subprocess
import sys

import pytest

WITHOUT_ROS = """
import sys
class NoRos:
    def find_spec(self, name, path=None, target=None):
        top = name.partition('.')[0]
        if top == 'rclpy' or top.endswith(('_msgs', '_interfaces', '_srvs')):
            raise ModuleNotFoundError(f'planted: no {name}', name=name)
sys.meta_path.insert(0, NoRos())
from ballbot_ros.nodes.simulator.settings import SimulatorSettings
print(SimulatorSettings().control)
"""


@pytest.mark.slow
def test_the_settings_of_the_nodes_are_available_without_ros():
    done = subprocess.run([sys.executable, '-c', WITHOUT_ROS], capture_output=True, text=True)
    assert done.stdout.strip() == 'direct', done.stderr
