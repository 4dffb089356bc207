# SPDX-License-Identifier: Apache-2.0
"""The commands for a running graph, with a robot of a few topics in this process."""
import math
import os
import signal
import subprocess
import sys
import time

from geometry_msgs.msg import Twist, TwistStamped, Vector3
from mcap.reader import make_reader
from nav_msgs.msg import Odometry
import numpy as np
import pytest
from rclpy.node import Node
from refusals import refused
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, String
from std_srvs.srv import Trigger
import yaml

from ballbot_ros.bags import record
from ballbot_ros.bags.metadata import BagMetadata
from ballbot_ros.bags.opener import open_bag
from ballbot_ros.cli import main
from ballbot_ros.msg import BallState, Contact, StepDecision
from ballbot_ros.ros import graph, qos
from ballbot_ros.ros.conversions import to_time
from ballbot_ros.ros.graph import as_csv, as_yaml, Observer, rate_in_words
from ballbot_ros.ros.robot_driver import RobotDriver
from ballbot_ros.ros.topics import message_class, plain


@pytest.fixture
def observer(monkeypatch):
    """Return an observer with short timeouts; it discovers nodes of this process immediately."""
    monkeypatch.setattr(graph, 'DISCOVERY_QUIET_TIME', 0.05)
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'OFF')
    monkeypatch.setenv('ROS_DOMAIN_ID', '231')
    with Observer('test') as one:
        yield one


@pytest.fixture
def robot(observer):
    """Return a node on the executor of the observer, instead of another process."""
    node = Node('robot', context=observer.node.context)
    observer._executor.add_node(node)
    yield node
    observer._executor.remove_node(node)
    node.destroy_node()


def publish_while(robot, kind, topic, message, profile=10):
    """Publish a message twenty times a second."""
    publisher = robot.create_publisher(kind, topic, profile)
    robot.create_timer(0.05, lambda: publisher.publish(message))
    return publisher


def odometry():
    message = Odometry()
    message.header.frame_id = 'odom'
    message.header.stamp = to_time(12.5)
    message.twist.twist.linear.x = 0.25
    return message


def test_topics_are_listed_with_types_and_numbers_of_endpoints(observer, robot):
    robot.create_publisher(Odometry, 'odom', 10)
    robot.create_subscription(Odometry, 'odom', lambda _: None, 10)
    found = {topic.name: topic for topic in graph.topics(observer)}
    assert found['/odom'] == ('/odom', ['nav_msgs/msg/Odometry'], 1, 1)


def test_topics_of_the_observer_alone_are_not_listed(observer, robot):
    observer.node.create_publisher(Bool, 'mine', 1)
    assert '/mine' not in [topic.name for topic in graph.topics(observer)]


def echo(observer, topic, show):
    """Show the first message of a topic, and return the number of messages."""
    return graph.echo(observer, topic, show, once=True, timeout=30.0, waiting=lambda: None)


def test_echo_finds_the_type_and_prints_as_ros2_does(observer, robot):
    publish_while(robot, Odometry, 'odom', odometry())
    shown = []
    assert echo(observer, 'odom', shown.append) == 1
    text = as_yaml(shown[0])
    assert text.startswith('header:\n  stamp:\n    sec: 12\n    nanosec: 500000000\n'
                           '  frame_id: odom\nchild_frame_id:')
    assert text.endswith('\n---')
    content = yaml.safe_load(text[:-3])
    assert content['twist']['twist']['linear']['x'] == 0.25
    assert len(content['pose']['covariance']) == 36


def test_echo_receives_latched_and_best_effort_topics(observer, robot):
    robot.create_publisher(Bool, 'e_stop', qos.LATCHED).publish(Bool(data=True))
    shown = []
    echo(observer, 'e_stop', shown.append)
    assert shown[0].data is True
    publish_while(robot, String, 'loose', String(data='hello'), qos.SENSOR)
    echo(observer, '/loose', shown.append)
    assert shown[1].data == 'hello'


def test_a_missing_topic_is_awaited_and_a_similar_name_is_proposed(observer, robot):
    robot.create_publisher(Odometry, 'odom', 10)
    said = []
    with refused('unknown_name', 'topic') as caught:
        graph.echo(observer, 'odmo', print, False, 0.2, lambda: said.append(1))
    assert '/odom' in str(caught.value)
    assert said == [1]
    with refused('wrong_type', 'topic'):
        graph.echo(observer, 'a b', print, False, 0.2, print)


def test_a_topic_of_two_types_and_one_of_a_missing_package_are_refused(observer, monkeypatch):
    # DDS does not permit both types in one process.
    monkeypatch.setattr(observer, '_types', lambda _: ['std_msgs/msg/Bool', 'std_msgs/msg/String'])
    with refused('ambiguous', 'topic'):
        graph.echo(observer, 'torn', print, False, 1.0, print)
    with refused('missing', 'my_msgs/msg/Thing'):
        message_class('my_msgs/msg/Thing')


def test_nested_messages_and_arrays_are_printed():
    message = BallState(contacts=[Contact(kind=2, x=0.5)], pendulum_rate=math.nan)
    content = yaml.safe_load(as_yaml(message)[:-3])
    assert content['contacts'][0]['x'] == 0.5 and math.isnan(content['pendulum_rate'])
    assert plain(np.array([1.0, 2.0])) == [1.0, 2.0]
    assert plain(b'\x02') == 2 and plain((1, b'ab')) == [1, [97, 98]]
    joints = JointState(name=['shell', 'a,b'], position=[1.0, 2.0])
    assert as_csv(joints) == '0,0,,shell,"a,b",1.0,2.0'


@pytest.mark.slow
def test_the_average_rate_of_messages_is_reported(observer, robot):
    publish_while(robot, Bool, 'tick', Bool())
    said = [sentence for sentence in graph.rates(observer, 'tick', 1.1, lambda: None)]
    assert said[-1].startswith('average rate: ')
    assert rate_in_words([1.0]) is None
    assert rate_in_words([0.0, 0.1, 0.3]) == (
        'average rate: 6.667\n\tmin: 0.100s max: 0.200s std dev: 0.05000s window: 3')


@pytest.mark.slow
def test_a_recording_contains_and_counts_all_received_messages(observer, robot, tmp_path):
    publish_while(robot, Odometry, 'odom', odometry())
    said = []
    counts = record.record(observer, tmp_path / 'bag', ['odom', 'later'], 1.0, said.append)
    assert counts['/odom'] > 3 and set(counts) == {'/odom'}
    assert 'recording /odom [nav_msgs/msg/Odometry]' in said
    assert any('/later' in words for words in said)
    with open(next((tmp_path / 'bag').glob('*.mcap')), 'rb') as file:
        assert len(list(make_reader(file).iter_messages())) == counts['/odom']


def test_a_recording_keeps_the_parameters_of_the_only_simulator(observer, robot, tmp_path):
    simulator, other = (Node('simulator', namespace=namespace, context=observer.node.context)
                        for namespace in ('', 'other'))
    simulator.declare_parameter('floor', 'apartment')
    assert record.source_metadata(observer) == {}  # with two, neither is the source
    other.destroy_node()
    assert observer.wait(lambda: observer.node.get_node_names().count('simulator') == 1, 30.0)
    observer._executor.add_node(simulator)
    publish_while(robot, Odometry, 'odom', odometry())
    record.record(observer, tmp_path / 'bag', ['odom'], 0.5, lambda _: None)
    observer._executor.remove_node(simulator)
    simulator.destroy_node()
    with open_bag(tmp_path / 'bag') as bag:
        found = BagMetadata.read(bag.metadata)
    assert found.source == 'simulator' and found.parameters == {'floor': 'apartment'}


@pytest.mark.slow
def test_the_duration_of_a_recording_starts_when_its_source_is_known(
        observer, robot, tmp_path, monkeypatch):
    monkeypatch.setattr(record, 'source_metadata', lambda _: time.sleep(1.0) or {})
    publish_while(robot, Odometry, 'odom', odometry())
    counts = record.record(observer, tmp_path / 'bag', ['odom'], 0.8, lambda _: None)
    assert counts['/odom'] > 3


def test_ctrl_c_completes_the_bag_which_includes_late_topics(
        observer, robot, tmp_path, monkeypatch):
    publish_while(robot, Odometry, 'odom', odometry())
    spin, start = observer.spin, time.monotonic()
    late = []

    def interrupted(seconds=0.05):
        spin(seconds)
        if not late and time.monotonic() > start + 0.5:
            late.append(publish_while(robot, Odometry, 'later', odometry()))
        if late and late[0].get_subscription_count():
            late.append(None)
        if len(late) > 20:
            raise KeyboardInterrupt
    monkeypatch.setattr(observer, 'spin', interrupted)
    counts = record.record(observer, tmp_path / 'bag', [], math.inf, lambda _: None)
    assert counts['/odom'] and counts['/later']
    assert not set(counts) & set(record.GRAPH_TOPICS)
    assert (tmp_path / 'bag' / 'metadata.yaml').is_file()


def answer(success, message):
    def callback(_, response):
        response.success, response.message = success, message
        return response
    return callback


def test_an_e_stop_service_is_called_by_node_name_and_a_refusal_is_returned(observer, robot):
    robot.create_service(Trigger, 'bridge/release_e_stop', answer(False, 'no IMU'))
    robot.create_service(Trigger, 'left/bridge/release_e_stop', answer(True, 'released'))
    assert graph.trigger(observer, 'bridge', 'release_e_stop', 30.0) == (False, 'no IMU')
    assert graph.trigger(observer, '/left/bridge', 'release_e_stop', 30.0) == (True, 'released')
    with refused('unknown_name', '--node') as caught:
        graph.trigger(observer, 'brigde', 'release_e_stop', 0.2)
    assert "'/bridge'" in str(caught.value) and '/left/bridge' in str(caught.value)
    with refused('unknown_name', '--node'):
        graph.trigger(observer, 'bridge', 'engage_e_stop', 0.2)


def test_a_driver_publishes_speeds_and_receives_the_state_of_the_robot(observer, robot):
    received = []
    robot.create_subscription(TwistStamped, 'cmd_vel', received.append, 10)
    publish_while(robot, Odometry, 'odom', odometry())
    publish_while(robot, JointState, 'joint_states', JointState(
        name=['shell', 'pendulum'], position=[-7.0, 7.5], velocity=[0.0, 0.0]))
    latched = robot.create_publisher(Bool, 'e_stop', qos.LATCHED)
    latched.publish(Bool(data=True))
    robot.create_publisher(StepDecision, 'step_decision', qos.LATCHED).publish(
        StepDecision(decision=StepDecision.DECISION_GO_ROUND))
    driver = RobotDriver(observer, 'bridge')

    def arrived():
        driver.publish(0.3)
        return received and driver.speed and driver.pendulum and driver.e_stop and driver.decision
    assert observer.wait(arrived, 30.0)
    assert received[0].twist.linear.x == 0.3
    assert received[0].header.stamp.sec == 0
    assert driver.speed == 0.25 and driver.pendulum == pytest.approx(0.5)
    assert driver.followers == 1 and driver.decision == 'GO ROUND'


def test_a_driver_publishes_the_type_of_its_subscriber(observer, robot):
    received = []
    robot.create_subscription(Twist, 'cmd_vel', received.append, 10)
    driver = RobotDriver(observer, 'bridge')
    assert observer.wait(lambda: driver.publish(0.3) or received, 30.0)
    assert received[0] == Twist(linear=Vector3(x=0.3)) and driver.followers == 1


def test_a_driver_uses_the_e_stop_service_of_the_bridge_or_else_the_topic(observer, robot):
    received = []
    robot.create_subscription(Bool, 'e_stop', received.append, qos.LATCHED)
    driver = RobotDriver(observer, 'bridge')
    driver.engage()
    assert observer.wait(lambda: received and received[-1].data, 30.0)
    driver.release()
    assert observer.wait(lambda: not received[-1].data, 30.0)
    robot.create_service(Trigger, 'bridge/engage_e_stop', answer(True, 'engaged by service'))
    assert observer.wait(lambda: driver._clients['engage_e_stop'].service_is_ready(), 30.0)
    driver.engage()
    assert observer.wait(lambda: driver.reply == 'engaged by service', 30.0)


def logged_until(text, *words):
    """Return exit code and log of `ballbot run`, which gets SIGINT once it has logged `text`."""
    process = subprocess.Popen(
        [sys.executable, '-m', 'ballbot_ros.cli', 'run', *words],
        stderr=subprocess.PIPE, text=True,
        env={**os.environ, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'},
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))
    try:
        logged = ''
        while text not in logged:
            logged += (line := process.stderr.readline())
            assert line, logged
        process.send_signal(signal.SIGINT)
        logged += process.communicate(timeout=30.0)[1]
    finally:
        process.kill()
        process.wait()
    return process.returncode, logged


@pytest.mark.slow
def test_a_node_runs_as_with_ros2_run_and_exits_with_0_on_ctrl_c():
    code, logged = logged_until('no_such_line', 'imu', '--ros-args', '-p',
                                'port:=/dev/no_such_line', '-r', '__node:=my_imu')
    assert code == 0 and '[my_imu]' in logged and 'Traceback' not in logged


@pytest.mark.slow
def test_nodes_that_share_a_process_get_their_own_parameters_and_exit_with_0():
    # The controller receives the simulator's states within the process.
    code, logged = logged_until(
        'joint states have arrived', 'simulator', 'controller', '--ros-args',
        '-p', 'simulator:lockstep:=true', '-p', 'simulator:real_time_factor:=0.0',
        '-p', 'controller:tuning:=gentle')
    assert code == 0 and 'Traceback' not in logged
    assert "tuning 'gentle'" in logged and 'lockstep True' in logged
    assert '[simulator]' in logged and '[controller]' in logged


@pytest.mark.parametrize('words, said', [
    (['simulator', 'bridge'], 'bridge requires a separate process'),
    (['simulator', 'controller', 'simulator'], 'each can run once')])
def test_nodes_that_cannot_share_a_process_are_refused(words, said, capsys):
    assert main(['run', *words]) == 2
    assert said in capsys.readouterr().err


def test_invalid_arguments_of_the_commands_are_refused(capsys):
    for words, said in ((['run', 'simulatr'], "did you mean 'simulator'"),
                        (['record'], 'name the topics to record'),
                        (['record', '-a', 'odom'], 'name the topics to record'),
                        (['echo', 'odom', '--timeout', '0'], '--timeout must be more than 0'),
                        (['drive', '--step', '0'], '--step must be more than 0'),
                        (['drive', '--step', '0.7'], 'more than --max-speed')):
        assert main(words) == 2
        assert said in capsys.readouterr().err


def test_without_ros_the_error_names_the_remedy(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, 'ballbot_ros.ros.graph', None)
    for words in (['topics'], ['echo', '/odom'], ['release-e-stop']):
        assert main(words) == 2
        error = capsys.readouterr().err
        assert 'needs ROS' in error and 'setup.bash' in error and error.count('\n') == 1
