# SPDX-License-Identifier: Apache-2.0
"""Bags are written with rosbags or, without it, with rosbag2_py of a ROS installation."""
import importlib.util
from types import SimpleNamespace

import pytest
from refusals import refused
from rosbags.rosbag2 import Reader
import yaml

from ballbot_ros.bags import writer
from ballbot_ros.bags.metadata import bag_metadata, BagMetadata, KEY, SIMULATOR
from ballbot_ros.bags.writer import bag_writer
from ballbot_ros.physics import load_scene
from ballbot_ros.ros.topics import LATCHED


class FakeRosbag2:
    """The part of `rosbag2_py` of ROS 2 Jazzy that the writer uses."""

    def __init__(self, broken=False):
        self.calls, self.broken = [], broken

    def StorageOptions(self, **given):
        self.calls.append(('storage', given))
        return SimpleNamespace(**given)

    def ConverterOptions(self, *given):
        return given

    def TopicMetadata(self, **given):
        return given

    class _storage:
        class QoS(str):
            def __new__(cls, text):
                return super().__new__(cls, text)

            def reliable(self):
                return type(self)(f'{self} reliable')

            def transient_local(self):
                return type(self)(f'{self} transient_local')

    def SequentialWriter(self):
        return self

    def open(self, storage, converter):
        if self.broken:
            raise RuntimeError('No plugin mcap')
        self.calls.append(('open', storage.uri, converter))

    def create_topic(self, topic):
        self.calls.append(('topic', topic))

    def write(self, *given):
        self.calls.append(('write', *given))


def only(monkeypatch, *present):
    """Hide all modules except `present`."""
    find = importlib.util.find_spec
    monkeypatch.setattr(writer, 'find_spec', lambda name: (
        find('json') if name in present else None))


def test_a_bag_stores_the_digests_of_its_scene_and_robot(tmp_path):
    scene = load_scene('doorstep')
    writer = bag_writer(tmp_path / 'bag', bag_metadata(SIMULATOR, {'lockstep': True}, scene))
    writer.open()
    writer.write(writer.add_topic('/here', 'std_msgs/msg/String'), 5, b'\0\1\0\0\1\0\0\0\0')
    writer.close()
    file = yaml.safe_load((tmp_path / 'bag' / 'metadata.yaml').read_text())
    metadata = BagMetadata.read(file['rosbag2_bagfile_information']['custom_data'])
    with Reader(tmp_path / 'bag') as bag:
        assert [stamp for _, stamp, _ in bag.messages()] == [5]
    assert metadata.source == SIMULATOR and metadata.parameters == {'lockstep': True}
    assert metadata == BagMetadata.read(bag_metadata(SIMULATOR, {'lockstep': True}, scene))
    other = BagMetadata.read(bag_metadata(SIMULATOR, {}, load_scene('doorstep', 'shellball')))
    assert other.digests['robot'] != metadata.digests['robot']
    assert other.digests['scene'] == metadata.digests['scene']


def test_missing_and_damaged_metadata_of_a_bag_are_ignored():
    assert BagMetadata.read({}) == BagMetadata()
    for damaged in ('{broken', '[]', '1', '{"parameters": 1}'):
        assert BagMetadata.read({KEY: damaged}) == BagMetadata()


def test_without_rosbags_the_library_of_a_ros_installation_is_used(monkeypatch, tmp_path):
    only(monkeypatch, 'rosbag2_py')
    fake = FakeRosbag2()
    monkeypatch.setitem(__import__('sys').modules, 'rosbag2_py', fake)
    writer = bag_writer(tmp_path / 'bag', {'key': 'value'})
    writer.open()
    topic = writer.add_topic('/here', 'std_msgs/msg/String', [LATCHED])
    writer.write(topic, 5, b'data')
    writer.close()
    assert fake.calls == [
        ('storage', {'uri': str(tmp_path / 'bag'), 'storage_id': 'mcap',
                     'custom_data': {'key': 'value'}}),
        ('open', str(tmp_path / 'bag'), ('cdr', 'cdr')),
        ('topic', {'id': 1, 'name': '/here', 'type': 'std_msgs/msg/String',
                   'serialization_format': 'cdr',
                   'offered_qos_profiles': ['1 reliable transient_local']}),
        ('write', '/here', b'data', 5)]


@pytest.mark.parametrize('present, reason', [
    ((), 'not_installed'), (('rosbag2_py',), 'not_writable')])
def test_without_a_library_for_bags_the_error_names_one_to_install(
        monkeypatch, tmp_path, present, reason):
    only(monkeypatch, *present)
    monkeypatch.setitem(__import__('sys').modules, 'rosbag2_py', FakeRosbag2(broken=True))
    with refused(reason):
        bag_writer(tmp_path / 'bag', {}).open()
