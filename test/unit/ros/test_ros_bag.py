# SPDX-License-Identifier: Apache-2.0
"""Messages that a recorder stores, and their times in the bag."""
import time

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TransformStamped
import pytest
from rclpy.node import Node
from rclpy.serialization import serialize_message
from rosbags.rosbag2 import Reader
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray

from ballbot_ros.bags.writer import BagRecorder, stamp_of, stamp_of_first, stamp_reader, unstamped
from ballbot_ros.ros import qos
from ballbot_ros.ros.conversions import to_time


def stamped(kind, seconds):
    """Return a message with a header."""
    message = kind()
    message.header.stamp = to_time(seconds)
    return message


def test_stamps_are_read_from_messages_that_have_them():
    assert stamp_reader(JointState) is stamp_reader(Clock) is stamp_of
    assert stamp_reader(String) is stamp_reader(DiagnosticArray) is unstamped
    assert stamp_of(serialize_message(stamped(JointState, 1.25))) == 1_250_000_000
    assert stamp_of(serialize_message(Clock(clock=to_time(2.5)))) == 2_500_000_000
    assert stamp_reader(MarkerArray) is stamp_of_first
    markers = MarkerArray(markers=[stamped(Marker, 3.5), stamped(Marker, 4.0)])
    assert stamp_of_first(serialize_message(markers)) == 3_500_000_000
    assert stamp_of_first(serialize_message(MarkerArray())) == 0

    class Transforms:
        """The only field of TFMessage; there is no wheel of tf2_msgs."""

        @staticmethod
        def get_fields_and_field_types():
            return {'transforms': 'sequence<geometry_msgs/TransformStamped>'}
    assert stamp_reader(Transforms) is stamp_of_first
    # A serialized sequence of one message is its length followed by the message.
    one = serialize_message(stamped(TransformStamped, 5.0))
    assert stamp_of_first(one[:4] + b'\1\0\0\0' + one[4:]) == 5_000_000_000


@pytest.fixture
def recorded(make_node, tmp_path):
    """Return a function that publishes messages one by one, and returns the bag's contents."""
    def record(*messages):
        source, sink = make_node(Node, 'source'), make_node(Node, 'sink')
        kinds = dict.fromkeys(map(type, messages))
        publishers = {kind: source.create_publisher(kind, kind.__name__, qos.STATE)
                      for kind in kinds}
        with BagRecorder(tmp_path / 'bag') as bag:
            for kind in kinds:
                bag.subscribe(sink, kind.__name__, kind=kind, profile=qos.STATE)
            for message in messages:
                publishers[type(message)].publish(message)
                bag.take_all()
        with Reader(tmp_path / 'bag') as reader:
            return bag, [(connection.topic, stamp) for connection, stamp, _ in reader.messages()]
    return record


def test_a_message_without_a_stamp_takes_the_last_stamp(recorded):
    bag, found = recorded(
        String(data='robot'), stamped(JointState, 0.0), stamped(DiagnosticArray, 1.7e9),
        stamped(JointState, 2.0), stamped(JointState, 0.0), String(), MarkerArray(),
        MarkerArray(markers=[stamped(Marker, 1.5)]))
    assert bag.recorded == {
        'String': [0, 2 * 10**9], 'JointState': [0, 2 * 10**9, 2 * 10**9],
        'DiagnosticArray': [0],
        'MarkerArray': [2 * 10**9, 1_500_000_000]}
    assert len(found) == 8 and max(stamp for _, stamp in found) == 2 * 10**9


def test_without_any_stamp_the_wall_clock_is_used(recorded):
    _, found = recorded(String(data='robot'))
    assert found[0][0] == '/String' and abs(found[0][1] - time.time_ns()) < 3600 * 10**9


@pytest.mark.slow
def test_a_recorder_with_its_own_thread_misses_nothing_without_an_executor(make_node, tmp_path):
    source, sink = make_node(Node, 'source'), make_node(Node, 'sink')
    publisher = source.create_publisher(JointState, 'states', qos.STATE)
    received = []
    with BagRecorder(tmp_path / 'bag') as bag:
        bag.subscribe(sink, 'states', received.append, JointState, qos.recording('joint_states'))
        bag.record_in_thread()
        for number in range(10000):  # twice the queue of a subscription; no executor spins
            publisher.publish(stamped(JointState, 0.002 * number))
        while len(received) < 10000:
            assert bag.failure is None
            time.sleep(0.001)
    assert bag.recorded == {'states': [2_000_000 * number for number in range(10000)]}


def test_a_bag_that_cannot_be_written_is_reported(make_node, tmp_path):
    source, sink = make_node(Node, 'source'), make_node(Node, 'sink')
    publisher = source.create_publisher(String, 'words', qos.STATE)

    def disk_full(_):
        raise OSError('No space left on device')
    with BagRecorder(tmp_path / 'bag') as bag:
        publisher.publish(String())
        bag.subscribe(sink, 'words', None, String, qos.STATE)
        bag.subscribe(sink, 'states', disk_full, JointState, qos.STATE)
        bag.record_in_thread()
        states = source.create_publisher(JointState, 'states', qos.STATE)
        while bag.failure is None:
            states.publish(JointState())
            time.sleep(0.001)
    assert 'No space left' in str(bag.failure)


def test_a_bag_keeps_the_offered_quality_of_service_for_its_replay(make_node, spinner, tmp_path):
    source, sink = make_node(Node, 'source'), make_node(Node, 'sink')
    publisher = source.create_publisher(String, 'notes', qos.LATCHED)
    source.create_publisher(JointState, 'joint_states', qos.SENSOR)
    spinner.until(lambda: sink.count_publishers('notes') and sink.count_publishers('joint_states'))
    publisher.publish(String())
    with BagRecorder(tmp_path / 'bag') as bag:
        bag.subscribe(sink, 'notes', None, String, qos.LATCHED)
        bag.subscribe(sink, 'joint_states', profile=qos.SENSOR)
        bag.subscribe(sink, 'robot_description')  # no publisher: profile of the table
    with Reader(tmp_path / 'bag') as reader:
        offered = {one.topic: one.ext.offered_qos_profiles for one in reader.connections}
    found = {topic: [(one.depth, one.reliability.name, one.durability.name) for one in profiles]
             for topic, profiles in offered.items()}
    # Discovery reports no depth: it is that of the table, or 1 for a topic that is not in it.
    assert found == {'/notes': [(1, 'RELIABLE', 'TRANSIENT_LOCAL')],
                     '/joint_states': [(qos.STATE.depth, 'BEST_EFFORT', 'VOLATILE')],
                     '/robot_description': [(1, 'RELIABLE', 'TRANSIENT_LOCAL')]}


def test_a_signal_during_the_start_of_the_thread_is_not_replaced_by_an_error(
        tmp_path, monkeypatch):
    def interrupted(thread):
        raise SystemExit(143)
    monkeypatch.setattr('threading.Thread.start', interrupted)
    with pytest.raises(SystemExit), BagRecorder(tmp_path / 'bag') as bag:
        bag.record_in_thread()
