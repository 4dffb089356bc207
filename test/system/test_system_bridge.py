# SPDX-License-Identifier: Apache-2.0
"""Every way in which the bridge can end, and the torque of the emulated motor afterwards."""
from contextlib import contextmanager
import signal
import time

from driving import Driving, TORQUE
from graph import TIMEOUT
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
import numpy as np
import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from ballbot_ros.black_box.read import find_black_box, read_black_box
from ballbot_ros.emulator.control import obey
from ballbot_ros.msg import MotorStatus
from ballbot_ros.nodes.bridge.node import Bridge
from ballbot_ros.ros import diagnostics
from ballbot_ros.ros.conversions import to_time
from ballbot_ros.ros.joint_state_bytes import command_bytes
from ballbot_ros.ros.rclpy_compat import new_executor


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_bridge_with_a_stop(driving, motor, number):
    run = driving()
    assert run.graph.end('bridge', number) == 0
    assert motor.torque == 0.0 and not motor.device.armed
    run.wait_until_reported(MotorStatus.STATE_ENDED)
    last = run.status[-1]
    assert last.state == MotorStatus.STATE_ENDED and last.torque == 0.0


def test_a_kill_is_outlived_by_no_torque_for_the_drive_watches(driving, motor):
    run = driving()
    run.graph.kill('bridge')
    run.wait_for_nothing()
    assert not motor.device.armed


def test_a_process_that_is_frozen_and_a_full_disk_do_no_harm(driving, motor):
    run = driving(capture='/dev/full')  # the motor pulls although nothing can be written
    run.graph.processes.signal('bridge', signal.SIGSTOP)
    try:
        run.wait_for_nothing()
    finally:
        run.graph.processes.signal('bridge', signal.SIGCONT)
    run.graph.wait(run.held_up, 'the bridge notices')


def test_commands_that_stop_stop_the_motor_and_are_followed_again(driving, motor):
    run = driving()
    run.wait_for_nothing()
    run.wait_until_reported(MotorStatus.STATE_TIMED_OUT)
    run.pull()


def test_unplugging_ends_in_a_stop_and_service_comes_back(driving, motor):
    run = driving()
    obey(motor, 'unplug')
    run.wait_for_nothing()
    run.wait_until_reported(MotorStatus.STATE_LOST)
    run.graph.wait_for_health('bridge', diagnostics.ERROR, 'looking for the drive')
    obey(motor, 'plug')
    run.graph.wait(lambda: run.status[-1].state == MotorStatus.STATE_E_STOP, 'the drive is back')
    assert run.status[-1].e_stop_reason == 'links_lost'
    refusal = run.graph.call('bridge/release_e_stop', Trigger)
    run.release() if not refusal.success else None
    run.pull()
    assert run.graph.log('bridge').count('looking for the drive') < 5
    assert run.graph.end('bridge') == 0  # writes what has not been written yet
    file = find_black_box(run.graph.processes.log('bridge').parent / 'ballbot')
    found = read_black_box(file)
    assert not found.damage and 'drive lost: the line was lost' in found.reason
    texts = '\n'.join(event.text for event in found.events)
    assert 'looking for the drive' in texts  # a line of the log
    assert len(found.traffic) > 100 and len(found.tables['command']['time']) > 0
    assert np.abs(found.tables['period']['torque']).max() == pytest.approx(TORQUE)


def test_the_services_of_a_lifecycle_node_take_and_give_the_power(graph, motor, hardware):
    graph.client('bridge/change_state', ChangeState)
    graph.start('bridge', hardware=hardware(), port=motor.path, autostart=False,
                control='direct')
    run = Driving(graph, motor)

    def change(transition):
        return graph.call('bridge/change_state', ChangeState, again=False,
                          transition=Transition(id=transition)).success
    answer = graph.call('bridge/release_e_stop', Trigger)
    assert not answer.success and 'the line to the drive is down' in answer.message
    assert change(Transition.TRANSITION_CONFIGURE)
    graph.wait(lambda: run.states, 'joint states flow before there is power')
    motor.call(motor.device.over_current)
    answer = graph.call('bridge/clear_faults', Trigger)
    assert answer.success and answer.message == 'the drive reports no faults'
    answer = graph.call('bridge/release_e_stop', Trigger)
    assert not answer.success and 'not active' in answer.message
    assert change(Transition.TRANSITION_ACTIVATE)
    run.release()
    run.pull()
    answer = graph.call('bridge/clear_faults', Trigger)
    assert not answer.success and 'the e-stop is released' in answer.message
    assert change(Transition.TRANSITION_DEACTIVATE)
    assert motor.torque == 0.0 and not motor.device.armed
    assert change(Transition.TRANSITION_CLEANUP)
    obey(motor, 'unplug')
    assert not change(Transition.TRANSITION_CONFIGURE)
    assert 'there is no port' in graph.log('bridge')


def test_impossible_settings_are_refused_at_start(graph, hardware):
    graph.start('bridge', hardware=hardware(), baud=19200)
    assert graph.processes.wait('bridge', 30.0) == 2
    assert 'set baud to' in graph.log('bridge')


@contextmanager
def bridge_here(domain, hardware, port):
    """Give a bridge in this process, active, and the executor that it hangs on."""
    context = Context()
    rclpy.init(context=context, domain_id=domain)
    node = Bridge(context=context, parameter_overrides=[
        Parameter('hardware', value=hardware), Parameter('port', value=port),
        Parameter('control', value='direct')])
    executor = new_executor(context)
    executor.add_node(node)
    try:
        yield node, executor
    finally:
        node.make_safe()
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown(context=context)


def wait_for(condition, idle=lambda: time.sleep(0.01)):
    """Wait until a condition holds; TIMEOUT bounds each wait alone."""
    deadline = time.monotonic() + TIMEOUT
    while not condition():
        assert time.monotonic() < deadline
        idle()


def pull_here(node, executor, motor):
    """Let a bridge in this process pull, by what another node publishes and asks for."""
    peer = Node('peer', context=node.context)
    executor.add_node(peer)
    commands = peer.create_publisher(JointState, 'joint_commands', 1)
    release = peer.create_client(Trigger, 'bridge/release_e_stop')
    deadline, answer = time.monotonic() + TIMEOUT, None
    while motor.torque == 0.0:
        assert time.monotonic() < deadline
        executor.spin_once(timeout_sec=0.005)
        if answer is None or answer.done() and not answer.result().success:
            if release.service_is_ready():
                answer = release.call_async(Trigger.Request())
        elif answer.done():
            commands.publish(command_bytes(
                to_time(1e-9 * node.get_clock().now().nanoseconds), TORQUE))


def test_an_executor_that_stands_still_keeps_no_torque_on(domain, hardware, motor):
    with bridge_here(domain, hardware(), motor.path) as (node, executor):
        pull_here(node, executor, motor)
        wait_for(lambda: motor.torque == 0.0)  # without a spinning executor
        assert motor.device.armed  # it was the loop that did it, not the watchdog of the drive


def test_an_error_in_the_loop_ends_in_a_stop_and_is_reported(domain, hardware, motor):
    with bridge_here(domain, hardware(), motor.path) as (node, executor):
        pull_here(node, executor, motor)

        def fail(report):
            raise ZeroDivisionError('planted')
        node._loop._publish = (fail,)
        wait_for(lambda: not node._loop.running)
        assert motor.torque == 0.0 and not motor.device.armed
        wait_for(lambda: node.failure is not None, lambda: executor.spin_once(timeout_sec=0.01))
        assert 'planted' in str(node.failure)
