# SPDX-License-Identifier: Apache-2.0
"""
Ctrl-C and SIGTERM end a node immediately, with exit code 0 and without a traceback.

In each state of the nodes one of the two: their handler does not depend on the signal.
"""
import signal
import subprocess
import sys
import time

import pytest
from sensor_msgs.msg import JointState

NODES = ('simulator', 'controller', 'obstacle_decision')


def end_all(graph, number):
    """Send a signal to all nodes, and wait until they have ended."""
    for name in NODES:
        graph.processes.signal(name, number)
    for name in NODES:
        assert graph.processes.wait(name, 30.0) == 0, graph.log(name)
        assert 'Traceback' not in graph.log(name)
        assert 'rror' not in graph.log(name)


def test_ctrl_c_ends_nodes_that_wait_for_others(graph):
    graph.start('simulator', lockstep=True, start_paused=True)
    graph.start('controller')
    graph.start('obstacle_decision')
    for name in NODES:
        graph.wait_for_log(name, 'running with')
    end_all(graph, signal.SIGINT)


def test_sigterm_ends_a_simulator_that_waits_for_a_command(graph):
    states = graph.subscribe('joint_states', JointState)
    graph.start('simulator', lockstep=True)
    graph.wait(lambda: states, 'the simulator publishes')
    assert graph.end('simulator', signal.SIGTERM) == 0
    assert 'Traceback' not in graph.log('simulator')


def test_ctrl_c_ends_a_simulator_during_a_step(graph):
    graph.start('simulator', lockstep=True, start_paused=True)
    graph.trigger('reset')
    unfinished = graph.call_async('step', periods=5)
    graph.wait(lambda: 'not paused' in graph.request('step', periods=1).message, 'it has started')
    assert graph.end('simulator') == 0 and not unfinished.done()
    assert 'Traceback' not in graph.log('simulator') and 'never' not in graph.log('simulator')


def test_sigterm_ends_busy_nodes(graph):
    states = graph.subscribe('joint_states', JointState)
    graph.start('simulator', lockstep=True, real_time_factor=0.0)
    graph.start('controller')
    graph.start('obstacle_decision')
    graph.wait_for_time(states, 0.1)
    graph.wait_for_log('obstacle_decision', 'running with')  # it may still be importing
    graph.add_load(4)
    end_all(graph, signal.SIGTERM)


@pytest.mark.parametrize('program', [
    'from ballbot_ros.nodes.start import start; sys.exit(start("controller"))',
    'from ballbot_ros.cli import main; sys.exit(main(["run", "controller"]))'])
def test_repeated_signals_do_not_change_the_exit_code(program):
    with subprocess.Popen([sys.executable, '-c', f'import sys; {program}'], text=True,
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as process:
        assert any('ready after' in line for line in process.stdout)
        while process.poll() is None:
            process.send_signal(signal.SIGINT)
            time.sleep(0.005)
        assert process.returncode == 0 and 'Traceback' not in process.stdout.read()
