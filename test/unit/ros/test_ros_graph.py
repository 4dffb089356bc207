# SPDX-License-Identifier: Apache-2.0
"""The verbs for a running graph, against a robot of a few topics in this process."""
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
def look(monkeypatch):
    """Return an observer with short timeouts: here it discovers all nodes immediately."""
    monkeypatch.setattr(graph, 'DISCOVERY_QUIET_TIME', 0.05)
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'OFF')
    monkeypatch.setenv('ROS_DOMAIN_ID', '231')
    with Observer('test') as one:
        yield one


@pytest.fixture
def robot(look):
    """Return a node on the executor of the observer, as another process would be."""
    node = Node('robot', context=look.node.context)
    look._executor.add_node(node)
    yield node
    look._executor.remove_node(node)
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


def test_topics_are_listed_with_types_and_who_has_them(look, robot):
    robot.create_publisher(Odometry, 'odom', 10)
    robot.create_subscription(Odometry, 'odom', lambda _: None, 10)
    found = {topic.name: topic for topic in graph.topics(look)}
    assert found['/odom'] == ('/odom', ['nav_msgs/msg/Odometry'], 1, 1)


def test_topics_of_the_observer_alone_are_not_listed(look, robot):
    look.node.create_publisher(Bool, 'mine', 1)
    assert '/mine' not in [topic.name for topic in graph.topics(look)]


def echo(observer, topic, show):
    """Show the first message of a topic, and return the number of messages."""
    return graph.echo(observer, topic, show, once=True, timeout=30.0, waiting=lambda: None)


def test_echo_finds_the_type_and_prints_as_ros2_does(look, robot):
    publish_while(robot, Odometry, 'odom', odometry())
    shown = []
    assert echo(look, 'odom', shown.append) == 1
    text = as_yaml(shown[0])
    assert text.startswith('header:\n  stamp:\n    sec: 12\n    nanosec: 500000000\n'
                           '  frame_id: odom\nchild_frame_id:')
    assert text.endswith('\n---')
    content = yaml.safe_load(text[:-3])
    assert content['twist']['twist']['linear']['x'] == 0.25
    assert len(content['pose']['covariance']) == 36


def test_echo_receives_latched_and_best_effort_topics(look, robot):
    robot.create_publisher(Bool, 'e_stop', qos.LATCHED).publish(Bool(data=True))
    shown = []
    echo(look, 'e_stop', shown.append)
    assert shown[0].data is True
    publish_while(robot, String, 'loose', String(data='hello'), qos.SENSOR)
    echo(look, '/loose', shown.append)
    assert shown[1].data == 'hello'


def test_a_topic_that_is_not_there_is_waited_for_and_its_neighbour_named(look, robot):
    robot.create_publisher(Odometry, 'odom', 10)
    said = []
    with refused('unknown_name', 'topic') as caught:
        graph.echo(look, 'odmo', print, False, 0.2, lambda: said.append(1))
    assert '/odom' in str(caught.value)
    assert said == [1]
    with refused('wrong_type', 'topic'):
        graph.echo(look, 'a b', print, False, 0.2, print)


def test_a_topic_of_two_types_and_one_of_a_missing_package_are_refused(look, monkeypatch):
    # Not even DDS lets one process make both.
    monkeypatch.setattr(look, '_types', lambda name: ['std_msgs/msg/Bool', 'std_msgs/msg/String'])
    with refused('ambiguous', 'topic'):
        graph.echo(look, 'torn', print, False, 1.0, print)
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
def test_the_rate_is_that_of_the_messages(look, robot):
    publish_while(robot, Bool, 'tick', Bool())
    said = [sentence for sentence in graph.rates(look, 'tick', 1.1, lambda: None)]
    assert said[-1].startswith('average rate: ')
    assert rate_in_words([1.0]) is None
    assert rate_in_words([0.0, 0.1, 0.3]) == (
        'average rate: 6.667\n\tmin: 0.100s max: 0.200s std dev: 0.05000s window: 3')


@pytest.mark.slow
def test_a_recording_has_all_that_came_and_says_how_many(look, robot, tmp_path):
    publish_while(robot, Odometry, 'odom', odometry())
    said = []
    counts = record.record(look, tmp_path / 'bag', ['odom', 'later'], 1.0, said.append)
    assert counts['/odom'] > 3 and set(counts) == {'/odom'}
    assert 'recording /odom [nav_msgs/msg/Odometry]' in said
    assert any('/later' in words for words in said)
    with open(next((tmp_path / 'bag').glob('*.mcap')), 'rb') as file:
        assert len(list(make_reader(file).iter_messages())) == counts['/odom']
    with refused('exists', '-o'):
        record.record(look, tmp_path / 'bag', ['odom'], 1.0, said.append)


def test_a_recording_keeps_the_parameters_of_the_one_simulator(look, robot, tmp_path):
    simulator, other = (Node('simulator', namespace=namespace, context=look.node.context)
                        for namespace in ('', 'other'))
    simulator.declare_parameter('floor', 'apartment')
    assert record.source_metadata(look) == {}  # of two, neither is the source
    other.destroy_node()
    assert look.wait(lambda: look.node.get_node_names().count('simulator') == 1, 30.0)
    look._executor.add_node(simulator)
    publish_while(robot, Odometry, 'odom', odometry())
    record.record(look, tmp_path / 'bag', ['odom'], 0.5, lambda _: None)
    look._executor.remove_node(simulator)
    simulator.destroy_node()
    with open_bag(tmp_path / 'bag') as bag:
        found = BagMetadata.read(bag.metadata)
    assert found.source == 'simulator' and found.parameters == {'floor': 'apartment'}


@pytest.mark.slow
def test_the_duration_of_a_recording_begins_when_its_source_is_known(
        look, robot, tmp_path, monkeypatch):
    monkeypatch.setattr(record, 'source_metadata', lambda _: time.sleep(1.0) or {})
    publish_while(robot, Odometry, 'odom', odometry())
    counts = record.record(look, tmp_path / 'bag', ['odom'], 0.8, lambda _: None)
    assert counts['/odom'] > 3


def test_ctrl_c_completes_the_bag_and_topics_that_come_late_are_in_it(
        look, robot, tmp_path, monkeypatch):
    publish_while(robot, Odometry, 'odom', odometry())
    spin, start = look.spin, time.monotonic()
    late = []

    def interrupted(seconds=0.05):
        spin(seconds)
        if not late and time.monotonic() > start + 0.5:
            late.append(publish_while(robot, Odometry, 'later', odometry()))
        if late and late[0].get_subscription_count():
            late.append(None)
        if len(late) > 20:
            raise KeyboardInterrupt
    monkeypatch.setattr(look, 'spin', interrupted)
    counts = record.record(look, tmp_path / 'bag', [], math.inf, lambda _: None)
    assert counts['/odom'] and counts['/later']
    assert not set(counts) & set(record.GRAPH_TOPICS)
    assert (tmp_path / 'bag' / 'metadata.yaml').is_file()


def answer(success, message):
    def callback(_, response):
        response.success, response.message = success, message
        return response
    return callback


def test_an_e_stop_is_called_by_the_name_of_its_node_and_a_refusal_handed_on(look, robot):
    robot.create_service(Trigger, 'bridge/release_e_stop', answer(False, 'no IMU'))
    robot.create_service(Trigger, 'left/bridge/release_e_stop', answer(True, 'released'))
    assert graph.trigger(look, 'bridge', 'release_e_stop', 30.0) == (False, 'no IMU')
    assert graph.trigger(look, '/left/bridge', 'release_e_stop', 30.0) == (True, 'released')
    with refused('unknown_name', '--node') as caught:
        graph.trigger(look, 'brigde', 'release_e_stop', 0.2)
    assert "'/bridge'" in str(caught.value) and '/left/bridge' in str(caught.value)
    with refused('unknown_name', '--node'):
        graph.trigger(look, 'bridge', 'engage_e_stop', 0.2)


def test_a_driver_has_a_name_and_receives_the_state_of_the_robot(look, robot):
    came = []
    robot.create_subscription(TwistStamped, 'cmd_vel', came.append, 10)
    publish_while(robot, Odometry, 'odom', odometry())
    publish_while(robot, JointState, 'joint_states', JointState(
        name=['shell', 'pendulum'], position=[-7.0, 7.5], velocity=[0.0, 0.0]))
    latched = robot.create_publisher(Bool, 'e_stop', qos.LATCHED)
    latched.publish(Bool(data=True))
    robot.create_publisher(StepDecision, 'step_decision', qos.LATCHED).publish(
        StepDecision(decision=StepDecision.DECISION_GO_ROUND))
    driver = RobotDriver(look, 'bridge')

    def arrived():
        driver.publish(0.3)
        return came and driver.speed and driver.pendulum and driver.e_stop and driver.decision
    assert look.wait(arrived, 30.0)
    assert came[0].twist.linear.x == 0.3
    assert came[0].header.stamp.sec == 0
    assert driver.speed == 0.25 and driver.pendulum == pytest.approx(0.5)
    assert driver.followers == 1 and driver.decision == 'GO ROUND'


def test_a_driver_sends_the_type_that_is_followed(look, robot):
    came = []
    robot.create_subscription(Twist, 'cmd_vel', came.append, 10)
    driver = RobotDriver(look, 'bridge')
    assert look.wait(lambda: driver.publish(0.3) or came, 30.0)
    assert came[0] == Twist(linear=Vector3(x=0.3)) and driver.followers == 1


def test_the_e_stop_of_a_driver_is_that_of_the_bridge_or_else_the_topic(look, robot):
    received = []
    robot.create_subscription(Bool, 'e_stop', received.append, qos.LATCHED)
    driver = RobotDriver(look, 'bridge')
    driver.engage()
    assert look.wait(lambda: received and received[-1].data, 30.0)
    driver.release()
    assert look.wait(lambda: not received[-1].data, 30.0)
    robot.create_service(Trigger, 'bridge/engage_e_stop', answer(True, 'engaged by service'))
    assert look.wait(lambda: driver._clients['engage_e_stop'].service_is_ready(), 30.0)
    driver.engage()
    assert look.wait(lambda: driver.reply == 'engaged by service', 30.0)


def logged_until(text, *words):
    """Return exit code and log of `ballbot run` that gets Ctrl-C once it has logged a text."""
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
def test_a_node_runs_as_with_ros2_run_and_ends_well_with_ctrl_c():
    code, logged = logged_until('no_such_line', 'imu', '--ros-args', '-p',
                                'port:=/dev/no_such_line', '-r', '__node:=my_imu')
    assert code == 0 and '[my_imu]' in logged and 'Traceback' not in logged


@pytest.mark.slow
def test_nodes_that_share_a_process_each_take_their_parameters_and_all_are_made_safe():
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


def test_an_unknown_node_and_a_missing_verb_of_recording_are_refused(capsys):
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
