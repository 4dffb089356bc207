# SPDX-License-Identifier: Apache-2.0
"""The bridge keeps running for any request from any number of clients, and reports its state."""
import re
import signal

from driving import Driving
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
import pytest
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from ballbot_ros.emulator.control import execute
from ballbot_ros.msg import MotorStatus


@pytest.fixture
def empty_cache(monkeypatch, tmp_path):
    """Return the folder of an empty kernel cache for the nodes that the test starts."""
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path / 'cache'))
    return tmp_path / 'cache'


def test_from_an_empty_kernel_cache_impossible_transitions_are_refused_without_effect(
        empty_cache, graph, motor, hardware):
    graph.client('bridge/change_state', ChangeState)
    # In a new interpreter, which reads the folder of the cache from its environment.
    graph.processes.start('bridge', {
        'hardware': hardware(), 'port': motor.path, 'autostart': False})
    for transition in (Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_CLEANUP, 99):
        assert not graph.change_state('bridge', transition)
    assert 'activate is not possible: the node is unconfigured' in graph.log('bridge')
    # A drive whose emulator gets no processor time for half a second does not answer.
    graph.wait(lambda: graph.change_state('bridge', Transition.TRANSITION_CONFIGURE),
               'the bridge is configured')
    assert not graph.change_state('bridge', Transition.TRANSITION_CONFIGURE)
    assert graph.change_state('bridge', Transition.TRANSITION_ACTIVATE)
    assert graph.change_state('bridge', Transition.TRANSITION_ACTIVE_SHUTDOWN)
    assert not graph.change_state('bridge', Transition.TRANSITION_CONFIGURE)
    assert graph.end('bridge', signal.SIGINT) == 0
    assert list(empty_cache.rglob('*.nbi'))


def test_a_requested_transition_ends_the_autostart(graph, motor, hardware):
    graph.client('bridge/change_state', ChangeState)
    execute(motor, 'unplug')
    graph.start('bridge', hardware=hardware(), port=motor.path)
    status = graph.subscribe('motor_status', MotorStatus)
    while not graph.change_state('bridge', Transition.TRANSITION_CONFIGURE):
        execute(motor, 'plug')  # from here on, autostart could activate the bridge
    graph.wait(lambda: status, 'the loop runs')
    graph.wait_for_log('bridge', 'autostart leaves the node inactive, as requested')
    assert status[-1].state == MotorStatus.STATE_E_STOP
    assert 'active;' not in graph.log('bridge')
    assert graph.change_state('bridge', Transition.TRANSITION_ACTIVATE)


def test_two_publishers_of_commands_are_both_refused_and_named(graph, motor, hardware):
    graph.start('bridge', hardware=hardware(), port=motor.path, control='direct')
    run = Driving(graph, motor)
    run.release()
    run.pull()
    other = Node('other', context=graph.context)
    try:
        other.create_publisher(JointState, 'joint_commands', 1)
        graph.publish_until(lambda: motor.torque == 0.0 and '/other' in graph.log('bridge'),
                            'both are refused', 'joint_commands', run.command)
        assert re.search(r'/other\b.*/test\b|/test\b.*/other\b', graph.log('bridge'))
    finally:
        other.destroy_node()


def test_the_services_of_a_lifecycle_node_switch_the_power(graph, motor, hardware):
    graph.client('bridge/change_state', ChangeState)
    graph.start('bridge', hardware=hardware(), port=motor.path, autostart=False,
                control='direct')
    run = Driving(graph, motor)
    answer = graph.call('bridge/release_e_stop', Trigger)
    assert not answer.success and 'the line to the drive is down' in answer.message
    assert graph.change_state('bridge', Transition.TRANSITION_CONFIGURE)
    graph.wait(lambda: run.states, 'joint states flow before there is power')
    motor.call(motor.device.over_current)
    answer = graph.call('bridge/clear_faults', Trigger)
    assert answer.success and answer.message == 'the drive reports no faults'
    answer = graph.call('bridge/release_e_stop', Trigger)
    assert not answer.success and 'not active' in answer.message
    assert graph.change_state('bridge', Transition.TRANSITION_ACTIVATE)
    run.release()
    run.pull()
    answer = graph.call('bridge/clear_faults', Trigger)
    assert not answer.success and 'the e-stop is released' in answer.message
    assert graph.change_state('bridge', Transition.TRANSITION_DEACTIVATE)
    assert motor.torque == 0.0 and not motor.device.armed
    assert graph.change_state('bridge', Transition.TRANSITION_CLEANUP)
    execute(motor, 'unplug')
    assert not graph.change_state('bridge', Transition.TRANSITION_CONFIGURE)
    assert 'there is no port' in graph.log('bridge')
