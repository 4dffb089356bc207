# SPDX-License-Identifier: Apache-2.0
"""Floods of refused messages, and a release before the bridge has received its own e-stop."""
import math

import pytest
from rclpy.node import Node
from sensor_msgs.msg import Imu, JointState
from tiers import slow

from ballbot_ros.bridge.supervisor import EStop, StopReason
from ballbot_ros.clock import steady_time
from ballbot_ros.imus.source import StampedReading
from ballbot_ros.nodes.bridge.inputs import REFUSED_PAUSE, RELEASE_DELAY
from ballbot_ros.nodes.bridge.node import Bridge
from ballbot_ros.ros import single_publisher

FLOOD = 100


def command(torque):
    """Return a torque command."""
    return JointState(name=['pendulum'], effort=[torque])


def reading(rate):
    """Return an IMU reading."""
    message = Imu()
    message.angular_velocity.y, message.linear_acceleration.z = rate, 9.81
    return message


@pytest.mark.parametrize('send, message, what', [
    ('command', command(math.nan), 'command'),
    *slow(('command', command(math.inf), 'command'),
          ('_on_imu', reading(math.nan), 'IMU reading'))])
def test_a_flood_of_non_finite_messages_is_refused_at_a_limited_rate(
        make_node, tmp_path, capfd, send, message, what):
    node = make_node(Bridge, autostart=False, black_box='', control='direct',
                     port=str(tmp_path / 'nowhere'))
    start = steady_time()
    for _ in range(FLOOD):
        getattr(node._inputs, send)(message)
    spent = steady_time() - start
    assert spent >= FLOOD * REFUSED_PAUSE
    text = capfd.readouterr().err
    logged = text.count(f'{what} refused')
    assert 1 <= logged <= 1.0 + spent, text
    gate = node._session.supervisor.gate
    assert {'command': gate.refused['not_finite'],
            'IMU reading': node._inputs.imu_refused}[what] == FLOOD
    assert node._session.supervisor.torque == 0.0 and gate.accepted == 0


def test_old_readings_of_the_own_port_are_refused_without_a_pause(
        make_node, tmp_path, monkeypatch):
    node = make_node(Bridge, autostart=False, black_box='', port=str(tmp_path / 'nowhere'))
    pauses, old = [], steady_time() - 1.0
    monkeypatch.setattr('ballbot_ros.nodes.bridge.inputs.sleep', pauses.append)
    for _ in range(FLOOD):
        node._inputs.imu(StampedReading(old, (0.0, 0.0, 0.0), (0.0, 0.0, 9.81), False))
    assert node._inputs.imu_refused == FLOOD and not any(pauses)


def test_imu_readings_of_two_nodes_are_refused(make_node, tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(single_publisher, 'COUNT_PERIOD', 0.0)
    node = make_node(Bridge, autostart=False, black_box='', port=str(tmp_path / 'nowhere'))
    taken = []
    monkeypatch.setattr(node._session, 'imu', taken.append)
    sensors = []
    for name in ('sensor_1', 'sensor_2'):
        sensors.append(make_node(Node, name))
        sensors[-1].create_publisher(Imu, 'imu', 1)
        while node.count_publishers('imu') < len(sensors):
            pass
        node._inputs._on_imu(reading(0.1))
    assert len(taken) == node._inputs.imu_refused == 1
    assert '/sensor_1 and /sensor_2' in capfd.readouterr().err


def test_a_release_is_too_early_before_the_bridge_has_received_its_own_e_stop(
        make_node, spinner, tmp_path, monkeypatch):
    node = make_node(Bridge, autostart=False, black_box='', port=str(tmp_path / 'nowhere'))
    now, reasons = [steady_time()], []
    monkeypatch.setattr(node._session, 'clock', lambda: now[0])
    monkeypatch.setattr(node._session, 'release', reasons.append)
    spinner.add(node)
    node._session.supervisor.reset(now[0])
    node._outputs.publish_e_stop(False)
    node._session.supervisor.trigger(EStop(StopReason.REQUESTED, 'test'))
    node._outputs.publish_e_stop(True)
    now[0] = node._outputs.engaged_at + 1.1 * RELEASE_DELAY
    node._inputs._release()
    assert reasons.pop()
    spinner.until(lambda: reasons and not reasons[-1], node._inputs._release)
