# SPDX-License-Identifier: Apache-2.0
"""Markers match the model and the decision; without a subscriber nothing is drawn."""
import math
from types import SimpleNamespace

from nav_msgs.msg import Odometry
import pytest
from rclpy.node import Node
from visualization_msgs.msg import Marker

from ballbot_ros.decision import Decision, Kind, Outlook, Reason
from ballbot_ros.physics import Model, Terrain
from ballbot_ros.ros import markers
from ballbot_ros.ros.markers import decision_markers, MarkerTopic, world_markers


def named(found):
    """Return markers by their namespaces; no two may have the same name."""
    assert len({(marker.ns, marker.id) for marker in found}) == len(found)
    return {marker.ns: marker for marker in found}


def decided(kind=Kind.CROSS, **numbers):
    """Return the markers of a decision of a ball whose centre is at (1.0, 0.5)."""
    odometry = Odometry()
    odometry.header.frame_id = 'left/odom'
    odometry.pose.pose.position.x, odometry.pose.pose.position.z = 1.0, 0.5
    return named(decision_markers(
        Decision(kind, Reason.LIKELY, 0.4, 'a sentence', **numbers), odometry, 0.2))


def test_the_force_on_a_ball_at_rest_points_up_from_the_contact(gimball):
    model = Model(gimball, Terrain.flat())
    drawn = named(world_markers(model.at_rest(2.0), model, 'odom'))
    contact, = drawn['contacts'].points
    assert (contact.x, contact.y, contact.z) == pytest.approx((2.0, 0.0, 0.0), abs=1e-9)
    foot, head = drawn['forces'].points
    assert foot == contact
    assert (head.x, head.z) == pytest.approx((2.0, markers.WEIGHT_ARROW_LENGTH))


def test_contacts_are_deleted_for_a_ball_in_the_air(gimball):
    model = Model(gimball, Terrain.flat())
    flying = model.at_rest(0.0)._replace(y=1.0)
    drawn = named(world_markers(flying, model, 'odom'))
    assert drawn['contacts'].action == drawn['forces'].action == Marker.DELETE
    assert drawn['terrain'].action == Marker.ADD


def test_the_ground_is_drawn_through_all_its_vertices_and_extended(gimball):
    terrain = Terrain.step(0.05, at=1.0)
    model = Model(gimball, terrain)
    drawn = named(world_markers(model.at_rest(0.0), model, 'odom'))['terrain']
    assert len(drawn.points) % 3 == 0
    points = {(point.x, point.z) for point in drawn.points}
    assert {tuple(vertex) for vertex in terrain.vertices.tolist()} <= points
    assert min(points)[0] == pytest.approx(terrain.vertices[0, 0] - markers.GROUND_EXTENSION)
    assert max(points) == pytest.approx((terrain.vertices[-1, 0] + markers.GROUND_EXTENSION, 0.05))


def test_the_step_is_drawn_at_its_distance_from_odometry():
    drawn = decided(distance=0.7, height=0.03, outlook=Outlook(height_limit=0.04))
    assert {point.x for point in drawn['step'].points} == {1.7}
    assert sorted({point.z for point in drawn['step'].points}) == pytest.approx([0.3, 0.33])
    assert [point.z for point in drawn['height_limit'].points] == pytest.approx([0.34, 0.34])
    assert {marker.header.frame_id for marker in drawn.values()} == {'left/odom'}


def test_the_text_is_above_the_ball_in_the_colour_of_the_decision():
    taken, refused = decided(), decided(Kind.GO_ROUND)
    assert taken['decision'].text == 'CROSS\na sentence'
    assert taken['decision'].pose.position.z > 0.5 + 0.2
    assert taken['decision'].color != refused['decision'].color


@pytest.mark.parametrize('numbers', [{}, {'distance': math.nan, 'height': 0.03},
                                     {'distance': 3.0, 'height': 0.0}], ids=str)
def test_unknown_values_are_not_drawn(numbers):
    drawn = decided(**numbers)
    assert drawn['step'].action == drawn['height_limit'].action == Marker.DELETE


@pytest.fixture
def topic(monkeypatch):
    """Return a publisher with a variable number of subscribers."""
    publisher = SimpleNamespace(listeners=1)
    publisher.get_subscription_count = lambda: publisher.listeners
    monkeypatch.setattr(markers, 'create_publisher', lambda *_: publisher)
    return publisher


def test_markers_are_due_at_most_ten_times_a_second_and_after_time_went_back(make_node, topic):
    marks = MarkerTopic(make_node(Node, 'robot'), True)
    due = [number for number in range(1000) if marks.is_due(0.002 * number)]
    assert len(due) == pytest.approx(20, abs=1)
    assert marks.is_due(0.0)


def test_nothing_is_drawn_without_a_subscriber(make_node, topic):
    assert not MarkerTopic(make_node(Node, 'robot'), False).is_due(0.0)
    topic.listeners = 0
    assert not MarkerTopic(make_node(Node, 'robot'), True).is_due(0.0)
