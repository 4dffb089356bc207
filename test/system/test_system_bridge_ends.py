# SPDX-License-Identifier: Apache-2.0
"""Every way in which the bridge can end, and the torque of the emulated motor afterwards."""
from contextlib import contextmanager
import signal

from driving import Driving, TORQUE
import numpy as np
import pytest
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger
from waiting import wait_until

from ballbot_ros.black_box.read import find_black_box, read_black_box
from ballbot_ros.emulator.control import execute
from ballbot_ros.msg import MotorStatus
from ballbot_ros.nodes.bridge.node import Bridge
from ballbot_ros.ros import diagnostics


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_bridge_with_a_stop(driving, motor, number):
    run = driving()
    assert run.graph.end('bridge', number) == 0
    assert motor.torque == 0.0 and not motor.device.armed
    run.wait_until_reported(MotorStatus.STATE_ENDED)
    last = run.status[-1]
    assert last.state == MotorStatus.STATE_ENDED and last.torque == 0.0


def test_torque_ends_after_a_kill_and_another_bridge_drives_again(driving, motor):
    run = driving()
    run.graph.kill('bridge')
    # The drive's watchdog disarms; on a busy machine a command timeout may zero the torque first.
    run.graph.wait(lambda: not motor.device.armed, 'the drive disarms')
    run.wait_for_nothing()
    driving()


def test_a_frozen_process_and_a_full_disk_do_no_harm(driving, motor):
    run = driving(capture='/dev/full')  # the motor pulls although nothing can be written
    run.graph.processes.signal('bridge', signal.SIGSTOP)
    try:
        run.wait_for_nothing()
    finally:
        run.graph.processes.signal('bridge', signal.SIGCONT)
    run.graph.wait(run.held_up, 'the bridge reports the delay')


def test_the_motor_stops_with_its_commands_and_follows_new_ones(driving, motor):
    run = driving()
    run.wait_for_nothing()
    run.wait_until_reported(MotorStatus.STATE_TIMED_OUT)
    run.pull()


def test_unplugging_stops_the_motor_and_the_services_recover(driving, motor):
    run = driving()
    # The torque rises by `torque_rate_limit`.
    run.graph.publish_until(lambda: abs(motor.pendulum_torque) > 0.99 * TORQUE,
                            'the motor applies the full torque', 'joint_commands', run.command)
    execute(motor, 'unplug')
    run.wait_for_nothing()
    run.wait_until_reported(MotorStatus.STATE_LOST)
    run.graph.wait_for_health('bridge', diagnostics.ERROR, 'looking for the drive')
    run.graph.wait(lambda: 'looking for the drive' in run.graph.log('bridge'), 'an attempt')
    execute(motor, 'plug')
    run.graph.wait(lambda: run.status[-1].state == MotorStatus.STATE_E_STOP, 'the drive is back')
    assert run.status[-1].e_stop_reason == 'links_lost'
    refusal = run.graph.call('bridge/release_e_stop', Trigger)
    run.release() if not refusal.success else None
    run.pull()
    assert run.graph.log('bridge').count('looking for the drive') < 5
    assert run.graph.end('bridge') == 0  # the bridge writes its remaining files
    file = find_black_box(run.graph.processes.log('bridge').parent / 'ballbot')
    found = read_black_box(file)
    assert not found.damage and 'drive lost: the line was lost' in found.reason
    texts = '\n'.join(event.text for event in found.events)
    assert 'looking for the drive' in texts  # a line of the log
    assert {record.direction for record in found.traffic} == {'<', '>'}
    assert any(record.data.startswith(b'c ') for record in found.traffic)  # a torque
    assert len(found.tables['command']['time']) > 0
    assert np.abs(found.tables['period']['torque']).max() == pytest.approx(TORQUE)


def test_impossible_settings_are_refused_at_start(graph, hardware):
    graph.start('bridge', hardware=hardware(), baud=19200)
    assert graph.processes.wait('bridge', 30.0) == 2
    assert 'set baud to' in graph.log('bridge')


@contextmanager
def bridge_here(graph, hardware, motor):
    """Yield a bridge in this process, on the executor of the graph, with a motor under torque."""
    node = Bridge(context=graph.context, parameter_overrides=[
        Parameter('hardware', value=hardware), Parameter('port', value=motor.path),
        Parameter('control', value='direct')])
    graph.executor.add_node(node)
    try:
        run = Driving(graph, motor)
        run.release()
        run.pull()
        yield node
    finally:
        node.make_safe()
        graph.executor.remove_node(node)
        node.destroy_node()


def test_a_stalled_executor_keeps_no_torque(graph, hardware, motor):
    with bridge_here(graph, hardware(), motor):
        wait_until(lambda: motor.torque == 0.0)  # without a spinning executor
        assert motor.device.armed  # stopped by the loop, not by the watchdog of the drive


def test_an_error_in_the_loop_stops_the_motor_and_is_reported(graph, hardware, motor):
    with bridge_here(graph, hardware(), motor) as node:
        def fail(report):
            raise ZeroDivisionError('planted')
        node._loop._publish = (fail,)
        wait_until(lambda: not node._loop.running)
        assert motor.torque == 0.0 and not motor.device.armed
        graph.wait(lambda: node.failure is not None, 'the failure is reported')
        assert 'planted' in str(node.failure)
