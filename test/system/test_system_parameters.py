# SPDX-License-Identifier: Apache-2.0
"""Parameters of nodes as processes; test_ros_refused_start.py tests the kinds of refusals."""
import pytest

from ballbot_ros.ros.run import EXIT_REFUSED


@pytest.mark.parametrize('name, parameters, value', [
    ('simulator', {'clock_rate': 3e4}, '30000'), ('controller', {'rate': 100}, '100 Hz'),
    ('obstacle_decision', {'robot': 'gimbal'}, "'gimbal'")])
def test_a_refusal_is_one_line(graph, name, parameters, value):
    graph.start(name, **parameters)
    assert graph.processes.wait(name, 30.0) == EXIT_REFUSED, graph.log(name)
    line, = [line for line in graph.log(name).splitlines() if '[INFO]' not in line]
    assert '[FATAL]' in line and value in line


def test_a_parameter_file_is_applied(graph, tmp_path):
    path = tmp_path / 'parameters.yaml'
    path.write_text("""
/**:
  ros__parameters:
    robot: gimball
/left/controller:
  ros__parameters:
    rate: 400
    tuning: gentle
""")
    graph.start('controller', '--ros-args', '--params-file', str(path), '-r', '__ns:=/left')
    graph.wait_for_log('controller', "robot 'gimball', rate 400.0, tuning 'gentle'")
