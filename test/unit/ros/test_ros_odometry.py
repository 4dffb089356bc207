# SPDX-License-Identifier: Apache-2.0
"""One tree of frames, in which the robot has the pose of odometry."""
import math
from types import SimpleNamespace
from xml.etree import ElementTree

import pytest
from rclpy.node import Node

from ballbot_ros.nodes.simulator.settings import SimulatorSettings
from ballbot_ros.physics.model.state import State
from ballbot_ros.ros import odometry
from ballbot_ros.ros.conversions import odometry_message
from ballbot_ros.ros.frames import Frames
from ballbot_ros.ros.odometry import OdometryTopics
from ballbot_ros.steering import LateralState

STATE = State(time=2.5, x=1.5, y=0.3, ball_angle=-math.pi / 2, pendulum_angle=0.3)


@pytest.fixture
def published(monkeypatch):
    """Return the published messages by topic; tf2_msgs may be missing."""
    found = {}
    monkeypatch.setattr(odometry, 'TFMessage', SimpleNamespace)
    monkeypatch.setattr(odometry, 'create_publisher', lambda node, topic: (
        SimpleNamespace(topic=topic, publish=lambda message: found.update({topic: message}),
                        get_subscription_count=lambda: 1)))
    return found


def publish(make_node, robot, state=STATE, **settings):
    """Publish odometry, the description and transforms of a state; return the topics."""
    topics = OdometryTopics(
        make_node(Node, 'robot'), robot, SimulatorSettings(**settings), steers=False)
    topics.publish(lambda: odometry_message(
        state, (state.x, 0.0, 0.0), LateralState(), robot.ball_radius, topics.frames),
        state.ball_angle, state.joint_angle)
    return topics


def tree(published):
    """Return {child: transform} of all published transforms; no child may occur twice."""
    transforms = [*published['/tf'].transforms,
                  *getattr(published.get('/tf_static'), 'transforms', [])]
    children = [transform.child_frame_id for transform in transforms]
    assert len(set(children)) == len(children)
    return {transform.child_frame_id: transform for transform in transforms}


def placed(transforms, frame):
    """Return x, z and the counter-clockwise angle of a frame in odom."""
    if frame not in transforms:
        return 0.0, 0.0, 0.0
    found = transforms[frame]
    x, z, angle = placed(transforms, found.header.frame_id)
    at, turn = found.transform.translation, found.transform.rotation
    assert (at.y, turn.x, turn.z) == (0.0, 0.0, 0.0)
    return (x + math.cos(angle) * at.x - math.sin(angle) * at.z,
            z + math.sin(angle) * at.x + math.cos(angle) * at.z,
            angle - 2.0 * math.atan2(turn.y, turn.w))


def test_the_transforms_agree_with_odometry(make_node, gimball, published):
    publish(make_node, gimball)
    message, transforms = published['odom'], tree(published)
    assert placed(transforms, message.child_frame_id) == pytest.approx((1.5, 0.3, 0.0))
    assert placed(transforms, 'ball_link') == pytest.approx((1.5, 0.3, STATE.ball_angle))
    assert placed(transforms, 'imu_link') == pytest.approx((1.5, 0.3, STATE.ball_angle))
    assert placed(transforms, 'pendulum_link') == pytest.approx((1.5, 0.3, 0.3))
    assert placed(transforms, 'base_footprint') == pytest.approx(
        (1.5, 0.3 - gimball.ball_radius, 0.0))


def test_moving_frames_have_the_stamp_of_odometry_and_descend_from_it(
        make_node, gimball, published):
    publish(make_node, gimball)
    stamps = [transform.header.stamp for transform in published['/tf'].transforms]
    assert stamps == [published['odom'].header.stamp] * 3
    odometry = tree(published)[published['odom'].child_frame_id]
    assert odometry.header.frame_id == published['odom'].header.frame_id == 'odom'


def test_the_links_of_the_description_are_the_frames_of_the_tree(make_node, robot, published):
    publish(make_node, robot)
    links = {link.get('name') for link in ElementTree.fromstring(
        published['robot_description'].data).findall('link')}
    assert links == set(tree(published))


def test_with_robot_state_publisher_only_odometry_moves_a_frame(make_node, gimball, published):
    publish(make_node, gimball, publish_description=False)
    assert set(published) == {'odom', '/tf'}
    assert set(tree(published)) == {'base_link'}


def test_a_prefix_applies_to_every_frame_but_not_to_the_description(
        make_node, gimball, published):
    publish(make_node, gimball, frame_prefix='left/', base_frame='hull')
    assert published['odom'].child_frame_id == 'left/hull'
    assert published['odom'].header.frame_id == 'left/odom'
    names = {name for child, transform in tree(published).items()
             for name in (child, transform.header.frame_id)}
    assert names and all(name.startswith('left/') for name in names)
    # As with robot_state_publisher, whose viewers add the prefix themselves.
    assert 'left/' not in published['robot_description'].data
    assert 'hull' in published['robot_description'].data


def test_every_frame_has_the_name_of_its_parameter():
    settings = SimulatorSettings(odom_frame='a', footprint_frame='b', base_frame='c',
                                 imu_frame='d', frame_prefix='z/')
    assert Frames.of(settings) == Frames(
        'z/a', 'z/b', 'z/c', 'z/d', 'z/ball_link', 'z/pendulum_link', 'z/axle_link',
        'z/carrier_link', 'map')


def test_without_tf2_msgs_odometry_and_description_are_still_published(
        make_node, gimball, published, monkeypatch):
    monkeypatch.setattr(odometry, 'TFMessage', None)
    publish(make_node, gimball)
    assert set(published) == {'odom', 'robot_description'}


@pytest.mark.parametrize('subscribed', [set(), {'odom'}, {'/tf'}])
def test_odometry_and_transforms_are_each_published_only_to_a_subscriber(
        subscribed, make_node, gimball, published, monkeypatch):
    monkeypatch.setattr(odometry, 'has_subscribers', lambda publisher:
                        publisher.topic in subscribed)
    publish(make_node, gimball)
    assert published.keys() & {'odom', '/tf'} == subscribed
