# SPDX-License-Identifier: Apache-2.0
"""Every way in which the bridge can end, and the torque of the emulated motor afterwards."""
from contextlib import contextmanager
import os
import signal
import time

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
import yaml

from ballbot_ros.config.files import config_folder
from ballbot_ros.emulator.ball import settings_for
from ballbot_ros.emulator.control import obey
from ballbot_ros.emulator.emulator import Emulator
from ballbot_ros.msg import MotorStatus
from ballbot_ros.nodes.bridge import Bridge
from ballbot_ros.physics import load_scene
from ballbot_ros.ros import diagnostics
from ballbot_ros.ros.conversions import command_message, to_time
from ballbot_ros.ros.executor import new_executor

TORQUE = 0.6  # at the pendulum [N m]
WATCHDOG = 0.5  # of the drive: a busy machine may hold the bridge up for as long [s]


@pytest.fixture
def motor(tmp_path):
    """Return an emulated ODrive with a ball behind it, ended after the test."""
    # Under a name of its own: a bridge that has lost /dev/pts/3 would take the next owner's.
    scene = load_scene('flat')
    with Emulator('odrive', scene, baud=921600, link=tmp_path / 'motor',
                  settings=settings_for(scene.model.robot, watchdog=WATCHDOG)) as emulator:
        yield emulator


@pytest.fixture
def hardware(tmp_path):
    """Return a function that writes a hardware file; no IMU is needed, floors here are level."""
    def write(**limits):
        content = yaml.safe_load((config_folder() / 'hardware/gimball_odrive.yaml').read_text())
        content['connection']['imu_required'] = False
        content['connection']['loop_rate'] = 200.0
        content['connection']['watchdog'] = WATCHDOG
        content['limits'].update(limits)
        path = tmp_path / 'hardware.yaml'
        path.write_text(yaml.safe_dump(content))
        return str(path)
    return write


class Driving:
    """A graph with a bridge that is made to pull."""

    def __init__(self, graph, motor):
        self.graph, self.motor = graph, motor
        self.states = graph.subscribe('joint_states', JointState)
        self.status = graph.subscribe('motor_status', MotorStatus)

    def command(self, torque=TORQUE):
        """Return a command for the newest state."""
        return command_message(self.states[-1].header.stamp, torque)

    def release(self):
        """Release the e-stop."""
        self.graph.wait(lambda: self.states, 'joint states flow')
        while not (answer := self.graph.call('bridge/release_e_stop', Trigger)).success:
            assert 'stays engaged' in answer.message
        self.graph.wait(lambda: self.status and self.status[-1].state in ('waiting', 'following'),
                        'the motor has power')

    def pull(self):
        """Command a torque until the motor makes it, and forget what was told before."""
        for _ in range(5):
            self.status.clear()
            found = self.graph.publish_until(
                lambda: 'torque' if self.motor.torque != 0.0 else self.held_up(),
                'the motor pulls', 'joint_commands', self.command)
            if found == 'torque':
                return
            self.release()
        pytest.fail(f'the drive disarms each time: {found}')

    def held_up(self):
        """Return the reason of an e-stop that a machine busy for longer than WATCHDOG explains."""
        reason = self.status[-1].e_stop if self.status else ''
        return reason if any(word in reason for word in ('disarmed', 'line', 'silent')) else ''

    def wait_until_told(self, state):
        """Wait until the bridge has told a state since the motor pulled."""
        self.graph.wait(lambda: state in [status.state for status in self.status], 'it says so')

    def wait_for_nothing(self):
        """Wait until the motor makes no torque, and see that it stays so."""
        self.graph.wait(lambda: self.motor.torque == 0.0, 'the motor is at zero')
        self.graph.spin(0.3)
        assert self.motor.torque == 0.0


@pytest.fixture
def driving(graph, motor, hardware):
    """Return a driving bridge in a process of its own."""
    def start(**more):
        graph.start('bridge', hardware=hardware(), port=motor.path, **more)
        result = Driving(graph, motor)
        result.release()
        result.pull()
        return result
    return start


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_bridge_with_a_stop(driving, motor, number):
    run = driving()
    assert run.graph.end('bridge', number) == 0
    assert motor.torque == 0.0 and not motor.device.armed


def test_a_kill_is_outlived_by_no_torque_for_the_drive_watches(driving, motor):
    run = driving()
    run.graph.kill('bridge')
    run.wait_for_nothing()
    assert not motor.device.armed


def test_a_process_that_is_frozen_and_a_full_disk_do_no_harm(driving, motor):
    run = driving(capture='/dev/full')  # the motor pulls although nothing can be written
    process = run.graph.processes.process_id('bridge')
    os.kill(process, signal.SIGSTOP)
    try:
        run.wait_for_nothing()
    finally:
        os.kill(process, signal.SIGCONT)
    run.graph.wait(run.held_up, 'the bridge notices')


def test_commands_that_stop_stop_the_motor_and_are_followed_again(driving, motor):
    run = driving()
    run.wait_for_nothing()
    run.wait_until_told(MotorStatus.TIMED_OUT)
    run.pull()


def test_unplugging_ends_in_a_stop_and_service_comes_back(driving, motor):
    run = driving()
    obey(motor, 'unplug')
    run.wait_for_nothing()
    run.wait_until_told(MotorStatus.LOST)
    run.graph.wait_for_health('bridge', diagnostics.ERROR, 'looking for the drive')
    obey(motor, 'plug')
    run.graph.wait(lambda: run.status[-1].state == MotorStatus.E_STOP, 'the drive is back')
    assert 'line was lost' in run.status[-1].e_stop
    refusal = run.graph.call('bridge/release_e_stop', Trigger)
    run.release() if not refusal.success else None
    run.pull()
    assert run.graph.log('bridge').count('looking for the drive') < 5


def test_the_services_of_a_lifecycle_node_take_and_give_the_power(graph, motor, hardware):
    graph.client('bridge/change_state', ChangeState)
    graph.start('bridge', hardware=hardware(), port=motor.path, autostart=False)
    run = Driving(graph, motor)

    def change(transition):
        return graph.call('bridge/change_state', ChangeState, again=False,
                          transition=Transition(id=transition)).success
    answer = graph.call('bridge/release_e_stop', Trigger)
    assert not answer.success and 'the line to the drive is down' in answer.message
    assert change(Transition.TRANSITION_CONFIGURE)
    graph.wait(lambda: run.states, 'joint states flow before there is power')
    answer = graph.call('bridge/release_e_stop', Trigger)
    assert not answer.success and 'not active' in answer.message
    assert change(Transition.TRANSITION_ACTIVATE)
    run.release()
    run.pull()
    assert change(Transition.TRANSITION_DEACTIVATE)
    assert motor.torque == 0.0 and not motor.device.armed
    assert change(Transition.TRANSITION_CLEANUP)
    obey(motor, 'unplug')
    assert not change(Transition.TRANSITION_CONFIGURE)
    assert 'there is no port' in graph.log('bridge')


def test_what_cannot_work_is_refused_at_start(graph, hardware):
    graph.start('bridge', hardware=hardware(), baud=19200)
    assert graph.processes.wait('bridge', 30.0) == 2
    assert 'set baud to' in graph.log('bridge')


@contextmanager
def bridge_here(domain, hardware, port):
    """Give a bridge in this process, active, and the executor that it hangs on."""
    context = Context()
    rclpy.init(context=context, domain_id=domain)
    node = Bridge(context=context, parameter_overrides=[
        Parameter('hardware', value=hardware), Parameter('port', value=port)])
    executor = new_executor(context)
    executor.add_node(node)
    try:
        yield node, executor
    finally:
        node.make_safe()
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown(context=context)


def pull_here(node, executor, motor):
    """Let a bridge in this process pull, by what another node publishes and asks for."""
    peer = Node('peer', context=node.context)
    executor.add_node(peer)
    commands = peer.create_publisher(JointState, 'joint_commands', 1)
    release = peer.create_client(Trigger, 'bridge/release_e_stop')
    deadline, answer = time.monotonic() + 20.0, None
    while motor.torque == 0.0:
        assert time.monotonic() < deadline
        executor.spin_once(timeout_sec=0.005)
        if answer is None or answer.done() and not answer.result().success:
            if release.service_is_ready():
                answer = release.call_async(Trigger.Request())
        elif answer.done():
            commands.publish(command_message(
                to_time(1e-9 * node.get_clock().now().nanoseconds), TORQUE))


def test_an_executor_that_stands_still_keeps_no_torque_on(domain, hardware, motor):
    with bridge_here(domain, hardware(), motor.path) as (node, executor):
        pull_here(node, executor, motor)
        deadline = time.monotonic() + 5.0
        while motor.torque != 0.0:  # nobody spins
            assert time.monotonic() < deadline
            time.sleep(0.01)
        assert motor.device.armed  # it was the loop that did it, not the watchdog of the drive


def test_an_error_in_the_loop_ends_in_a_stop_and_is_told(domain, hardware, motor):
    with bridge_here(domain, hardware(), motor.path) as (node, executor):
        pull_here(node, executor, motor)

        def fail(report):
            raise ZeroDivisionError('planted')
        node._loop._publish = fail
        deadline = time.monotonic() + 5.0
        while node._loop.running:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        assert motor.torque == 0.0 and not motor.device.armed
        while node.failure is None:
            assert time.monotonic() < deadline
            executor.spin_once(timeout_sec=0.01)
        assert 'planted' in str(node.failure)
