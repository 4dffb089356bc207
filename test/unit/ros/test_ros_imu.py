# SPDX-License-Identifier: Apache-2.0
"""The node imu with an emulated sensor on a pseudo-terminal."""
from itertools import count
import time
from types import SimpleNamespace

import pytest
from rclpy.node import Node
from refusals import refused
from waiting import wait_until
import yaml

from ballbot_ros.clock import steady_time
from ballbot_ros.config.files import read_yaml, shipped_folder
from ballbot_ros.emulator.imu_line import ImuLine
from ballbot_ros.errors import LinkError
from ballbot_ros.imus.source import ImuPort, StampedReading
from ballbot_ros.nodes.bridge.motor import Clocks, imu_reading
from ballbot_ros.nodes.bridge.node import Bridge
from ballbot_ros.nodes.emulated_robot.node import EmulatedRobot
from ballbot_ros.nodes.imu import publisher as imu
from ballbot_ros.nodes.imu.node import ImuNode
from ballbot_ros.ros import diagnostics
from ballbot_ros.ros.conversions import to_seconds
from ballbot_ros.steering import LateralState


@pytest.fixture
def sensor():
    """Return a sensor with factory settings, whose readings do not repeat."""
    found = ImuLine()
    tick, number = found.device.tick, count()

    def noisy(now):
        found.device.force = (0.5, 0.0, 9.81 + 0.01 * (next(number) % 5))
        return tick(now)
    found.device.tick = noisy
    yield found
    found.stop()


@pytest.fixture
def published(monkeypatch):
    """Return the published messages."""
    found = []
    monkeypatch.setattr(imu, 'create_publisher', lambda *_: SimpleNamespace(
        publish=found.append, get_subscription_count=lambda: 1))
    return found


@pytest.mark.slow
def test_a_sensor_with_factory_settings_gives_messages_that_the_bridge_accepts(
        make_node, sensor, published):
    sensor.device.turn_rate = (0.0, 0.25, 0.0)
    node = make_node(ImuNode, port=sensor.path)
    try:
        wait_until(lambda: len(published) > 100)
        message = published[-1]
        reading = imu_reading(message, Clocks())
        assert reading.turn_rate == pytest.approx(-0.25, abs=0.002)
        assert reading.forward == pytest.approx(0.5, abs=0.01)
        assert 0.0 <= steady_time() - reading.stamp < 0.5
        assert message.header.frame_id == 'imu_link'
        assert message.orientation_covariance[0] == -1.0
        assert message.angular_velocity_covariance[4] == pytest.approx(0.005**2)
        stamps = [to_seconds(item.header.stamp) for item in published]
        assert stamps == sorted(stamps)
        assert sensor.device.baud == 115200 and sensor.device.period == 0.005
    finally:
        node.make_safe()
    assert node.failure is None


def output_of(make_node, source, monkeypatch):
    """Return an output with a node and the given source."""
    monkeypatch.setattr(imu, 'open_source', lambda port: source)
    return imu.ImuOutput(make_node(Node, 'imu'), ImuPort(port='here'))


class Source:
    """A source whose counts, trouble and error the test sets."""

    def __init__(self):
        self.counts = dict.fromkeys((
            'readings', 'refused', 'skipped', 'unpaired', 'saturated', 'frozen', 'lost',
            'set_up'), 0)
        self.trouble, self.error = '', None

    def read(self, timeout):
        """Return one reading, or raise `error`."""
        time.sleep(0.01)
        if self.error is not None:
            raise self.error
        return [StampedReading(steady_time(), (0.0,) * 3, (0.0,) * 3, False)]

    def close(self):
        """Do nothing."""


def test_health_names_the_failure_and_has_every_value_of_the_table(
        make_node, published, monkeypatch):
    source = Source()
    output = output_of(make_node, source, monkeypatch)
    try:
        time.sleep(0.05)
        level, message, values = output._health()
        assert (level, message) == (
            diagnostics.WARN, '0 readings a second, 200 were requested')
        assert set(values) == set(imu.VALUES)
        source.counts['readings'] += 10**6
        assert output._health()[:2] == (diagnostics.OK, 'running')
        source.trouble = 'no readings at 115200 baud on here'
        assert output._health()[:2] == (diagnostics.ERROR, source.trouble)
    finally:
        output.end()


def test_an_error_in_the_thread_is_the_failure_of_the_node(make_node, published, monkeypatch):
    source = Source()
    output = output_of(make_node, source, monkeypatch)
    source.error = RuntimeError('a bug')
    wait_until(lambda: output.failure is not None)
    node = SimpleNamespace(_output=output)
    failure = ImuNode.failure.fget(node)
    assert isinstance(failure, LinkError) and 'a bug' in str(failure)
    output.end()


@pytest.mark.parametrize('parameters, reason', [
    ({'axes': 'x y -z'}, 'inconsistent'), ({'rate': 150}, 'not_a_choice'),
    ({'baud': 9600}, 'inconsistent'), ({'bandwidth': 99}, 'not_a_choice')])
def test_impossible_settings_are_refused_at_the_start(make_node, parameters, reason):
    with refused(reason, *parameters):
        make_node(ImuNode, port='/dev/null', **parameters)


@pytest.mark.slow
def test_the_bridge_reads_a_sensor_itself_if_its_hardware_file_has_the_port(
        make_node, sensor, tmp_path):
    sensor.device.turn_rate = (0.0, 0.25, 0.0)
    content = read_yaml(shipped_folder('config') / 'hardware/gimball_odrive.yaml')
    content['imu_port'] = {'port': sensor.path, 'axes': '-x -y z'}
    (tmp_path / 'hardware.yaml').write_text(yaml.safe_dump(content))
    node = make_node(Bridge, hardware=str(tmp_path / 'hardware.yaml'), autostart=False,
                     black_box='', port='/dev/none')
    try:
        watch = node._session.sensing.imu_watch
        wait_until(lambda: watch.has(steady_time()))
        last = node._session.fusion._waiting[-1]
        assert last.turn_rate == pytest.approx(0.25, abs=0.01)  # its left axis points right
        assert last.forward == pytest.approx(-0.5, abs=0.02)
        assert not node._inputs.imu_refused
        sensor.stop()
        wait_until(lambda: not watch.has(steady_time()))
    finally:
        node.make_safe()


def test_the_true_state_of_an_emulated_robot_that_steers_contains_its_pose(
        make_node, tmp_path):
    node, found = make_node(
        EmulatedRobot, scene='flat', hardware='gimball_roboclaw_steering',
        link=str(tmp_path / 'motor')), []
    try:
        ball, node._truth = node._emulator.ball, SimpleNamespace(publish=found.append)
        ball.lateral = LateralState(heading=0.5)
        ball.course = ball.course._replace(y=1.5)
        wait_until(lambda: ball.course.lateral.heading == 0.5)

        def published():
            node._publish()
            return found
        state = wait_until(published)[-1]
        assert state.position_y == pytest.approx(1.5, abs=0.1)
        assert state.heading == pytest.approx(0.5)
    finally:
        node.make_safe()


@pytest.mark.parametrize('imu_link', ['', 'imu'])
def test_only_one_node_publishes_the_readings_of_an_emulated_sensor(make_node, tmp_path, imu_link):
    # With a link, the node imu publishes them; a bridge refuses the readings of two publishers.
    node = make_node(EmulatedRobot, scene='flat', link=str(tmp_path / 'motor'),
                     imu_link=imu_link and str(tmp_path / imu_link))
    try:
        topics = {one.topic_name.rpartition('/')[2] for one in node.publishers}
        assert ('imu' in topics) == (not imu_link)
    finally:
        node.make_safe()


def test_an_error_of_the_emulated_sensor_ends_the_emulated_robot(make_node, tmp_path):
    def fail(now):
        raise ZeroDivisionError('planted')
    node = make_node(EmulatedRobot, scene='flat', link=str(tmp_path / 'motor'),
                     imu_link=str(tmp_path / 'imu'))
    try:
        assert node.failure is None
        node._imu_line.device.tick = fail
        wait_until(lambda: isinstance(node.failure, ZeroDivisionError))
    finally:
        node.make_safe()
