# SPDX-License-Identifier: Apache-2.0
"""
The layouts for RViz, Foxglove and PlotJuggler use existing topics, fields and frames.

None of the three programs runs here: loading of the files is not tested.
"""
from importlib import import_module
import json
from pathlib import Path
import re
from xml.etree import ElementTree

import pytest
import yaml

from ballbot_ros.ros.frames import FRAMES, JOINTS
from ballbot_ros.ros.topics import TOPICS

ROOT = Path(__file__).resolve().parent.parent
RVIZ = ROOT / 'rviz' / 'ballbot.rviz'
FOXGLOVE = ROOT / 'foxglove' / 'ballbot.json'
PLOTJUGGLER = ROOT / 'plotjuggler' / 'ballbot.xml'
NAMES = set(vars(FRAMES).values())
# Class of a display -> type of its topic.
DISPLAYS = {'RobotModel': 'std_msgs/msg/String', 'Odometry': 'nav_msgs/msg/Odometry',
            'MarkerArray': 'visualization_msgs/msg/MarkerArray'}


def type_of(topic):
    """Return the type of an absolute topic of a robot without a namespace."""
    return TOPICS[topic if topic in TOPICS else topic.lstrip('/')].type


def field_type(type_name, path):
    """Return the type of a nested field of a message."""
    for word in path:
        package, _, name = type_name.replace('/msg/', '/').rpartition('/')
        pytest.importorskip('rclpy')
        message = getattr(import_module(f'{package}.msg'), name)
        word, index = re.fullmatch(r'(\w+)((?:\[\d+\])?)', word).groups()
        type_name = message.get_fields_and_field_types()[word]
        listed = re.fullmatch(r'sequence<(.*)>', type_name)
        assert bool(listed) is bool(index), word
        type_name = listed.group(1) if listed else type_name
    return type_name


def is_number(type_name):
    """Return whether a field of a type can be plotted."""
    return re.fullmatch(r'(float|double|u?int\d+|boolean|octet)\d*', type_name) is not None


def displays():
    """Return the displays of RViz by class name."""
    view = yaml.safe_load(RVIZ.read_text())['Visualization Manager']
    return view, {display['Class'].rpartition('/')[2]: display for display in view['Displays']}


def test_rviz_displays_match_the_types_of_their_topics():
    _, shown = displays()
    for name, kind in DISPLAYS.items():
        topic = shown[name].get('Topic') or shown[name]['Description Topic']
        assert type_of(topic['Value']) == kind


def test_rviz_receives_latched_messages():
    _, shown = displays()
    assert shown['RobotModel']['Description Topic']['Durability Policy'] == 'Transient Local'
    assert shown['MarkerArray']['Topic']['Durability Policy'] == 'Volatile'


def test_rviz_uses_existing_frames():
    view, _ = displays()
    assert view['Global Options']['Fixed Frame'] == FRAMES.odom
    assert view['Views']['Current']['Target Frame'] in NAMES


def test_the_topics_of_rviz_follow_the_namespace():
    source = (ROOT / 'ballbot_ros' / 'ros' / 'launching.py').read_text()
    remapped = set(re.findall(r"'(\w+)'", re.search(r'RVIZ_TOPICS = \((.*)\)', source).group(1)))
    _, shown = displays()
    named = {(shown[name].get('Topic') or shown[name]['Description Topic'])['Value'].lstrip('/')
             for name in DISPLAYS}
    assert remapped == named


def panels():
    """Return the panels of the Foxglove layout."""
    return json.loads(FOXGLOVE.read_text())['configById']


def test_foxglove_plots_numbers_of_messages():
    paths = [path['value'] for name, panel in panels().items()
             if name.startswith(('Plot!', 'StateTransitions!')) for path in panel['paths']]
    assert len(paths) > 10
    for path in paths:
        topic, *words = path.split('.')
        assert is_number(field_type(type_of(topic), words)), path


def test_foxglove_uses_existing_topics_and_frames():
    shown, = [panel for name, panel in panels().items() if name.startswith('3D!')]
    assert all(map(type_of, shown['topics']))
    assert type_of(shown['layers']['robot']['topic']) == 'std_msgs/msg/String'
    named = {name.removeprefix('frame:') for name in shown['transforms']}
    assert named == NAMES
    assert {shown['followTf'], shown['layers']['grid']['frameId']} <= NAMES


def test_foxglove_shows_text_and_health():
    topic, *words = panels()['RawMessages!explanation']['topicPath'].split('.')
    assert field_type(type_of(topic), words) == 'string'
    assert type_of(panels()['DiagnosticSummary!health']['topicToRender']) \
        == 'diagnostic_msgs/msg/DiagnosticArray'


def test_foxglove_places_every_panel_once():
    def leaves(place):
        return [place] if isinstance(place, str) else [
            *leaves(place['first']), *leaves(place['second'])]
    placed = leaves(json.loads(FOXGLOVE.read_text())['layout'])
    assert sorted(placed) == sorted(panels())


def test_plotjuggler_plots_numbers_of_messages_and_joints():
    curves = [curve.get('name') for curve in ElementTree.parse(PLOTJUGGLER).iter('curve')]
    assert len(curves) > 10
    for curve in curves:
        topic, *words = curve.lstrip('/').split('/')
        if type_of(topic) == 'sensor_msgs/msg/JointState':  # PlotJuggler sorts these by joint
            joint, quantity = words
            assert joint in JOINTS and quantity in ('position', 'velocity', 'effort')
        else:
            assert is_number(field_type(type_of(topic), words)), curve


def named_topics():
    """Return all topics that the layouts name, without slash."""
    text = ''.join(path.read_text() for path in (RVIZ, FOXGLOVE, PLOTJUGGLER))
    return {topic for topic in (name.lstrip('/') for name in TOPICS)
            if re.search(rf'[ "]/{topic}\b', text)}


@pytest.mark.parametrize('topic', sorted(TOPICS))
def test_the_type_of_each_topic_exists(topic):
    package, _, name = TOPICS[topic].type.partition('/msg/')
    assert hasattr(pytest.importorskip(f'{package}.msg'), name)
