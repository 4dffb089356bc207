# SPDX-License-Identifier: Apache-2.0
"""Invalid positions, localisation and maps end the goal of the node ``navigator`` at rest."""
import math

from geometry_msgs.msg import Quaternion
from navigator_graph import Graph, START
import numpy as np
from PIL import Image
import pytest
from sensor_msgs.msg import LaserScan
from std_srvs.srv import Trigger

from ballbot_ros.msg import TerrainObservation
from ballbot_ros.navigation.execution import NavStatus
from ballbot_ros.nodes.navigator.localization import heading_of, rotation_of
from ballbot_ros.nodes.navigator.outputs import stamped_pose
from ballbot_ros.ros.conversions import to_time
from ballbot_ros.ros.endpoints import ODOMETRY_TIMEOUT


@pytest.fixture(scope='module')
def room(context, tmp_path_factory):
    """Return a localised robot on a floor with a step, stairs and unknown space."""
    folder = tmp_path_factory.mktemp('room')
    shades = np.full((80, 140), 255, np.uint8)
    shades[:, 120:] = 128
    image, path = Image.fromarray(shades), folder / 'floor.yaml'
    image.save(folder / 'plan.pgm')
    (folder / 'plan.yaml').write_text('image: plan.pgm\nresolution: 0.05\n'
                                      'origin: [0.0, 0.0, 0.0]\n')
    path.write_text('map: plan.yaml\nfeatures:\n'
                    '  - {kind: step, line: [[3.0, 4.0], [3.0, 0.0]], height: 0.015}\n'
                    '  - {kind: stairs, polygon: [[4.5, 3.4], [5.5, 3.4], [5.5, 4.0]]}\n')
    graph = Graph(context, floor=str(path), localized=True)
    assert graph.spin(30.0, lambda: graph.node.percept is not None
                      and graph.navigate.server_is_ready())
    graph.folder, graph.image = folder, image
    yield graph
    graph.close()


@pytest.fixture
def at_start(room):
    room.pose, room.offset, room.speed, room.yaw_rate = list(START), [0.0, 0.0], 0.0, 0.0
    room.localized = True
    assert localised(room, START)
    return room


def localised(room, pose):
    """Return whether the node receives this pose on the map from now on."""
    begin, node = room.time, room.node
    return room.spin(30.0, lambda: node.percept.stamp > begin
                     and node.percept[1:4] == pytest.approx(pose, nan_ok=True))


@pytest.mark.parametrize('length', [0.5, 1.0, 2.0])
@pytest.mark.parametrize('heading', [-3.0, 0.0, math.pi / 2, 3.0])
def test_the_heading_of_a_quaternion_does_not_depend_on_its_length(heading, length):
    half = 0.5 * heading
    turn = Quaternion(z=length * math.sin(half), w=length * math.cos(half))
    assert heading_of(turn) == pytest.approx(heading)


def test_a_rotation_turns_vectors_and_is_not_finite_if_the_quaternion_overflows():
    # A third of a turn about (1, 1, 1) maps x to y, y to z and z to x.
    turned = rotation_of(Quaternion(x=2.0, y=2.0, z=2.0, w=2.0)) @ (1.0, 2.0, 3.0)
    assert turned == pytest.approx([3.0, 1.0, 2.0])
    for turn in (Quaternion(z=1e300, w=1e300), Quaternion(w=math.inf), Quaternion(w=0.0)):
        assert not np.isfinite(rotation_of(turn)).all() and math.isnan(heading_of(turn))


@pytest.mark.parametrize('place, reason', [
    ((3.0, 1.4), 'feature'), ((5.2, 3.6), 'feature'), ((6.5, 1.4), 'unknown'),
    ((99.0, 1.4), 'off_map'), ((2.0, 0.05), 'wall'), ((2.0, math.nan), 'not_finite')])
def test_goals_at_invalid_positions_are_refused_from_action_and_topic(at_start, place, reason):
    refused = at_start.node.servers.refused
    before = refused[reason]
    assert not at_start.send(*place).accepted and refused[reason] == before + 1
    at_start.goals.publish(stamped_pose('map', to_time(0.0), *place, 0.0))
    assert at_start.spin(10.0, lambda: refused[reason] == before + 2)
    assert at_start.speed == 0.0 and at_start.node.state.status.ended


@pytest.mark.parametrize('offset, reason', [
    ((1.3, 0.0), 'feature'), ((50.0, 0.0), 'off_map'), ((4.8, 0.0), 'unknown'),
    ((math.nan, 0.0), 'not_finite')])
def test_an_invalid_start_position_ends_the_goal(at_start, offset, reason):
    at_start.offset = list(offset)
    assert localised(at_start, (START[0] + offset[0], *START[1:]))
    assert at_start.fails(at_start.send(2.4, 2.4)) == reason


@pytest.mark.parametrize('goal', [(2.6, 2.6), (4.5, 1.4)], ids=['driving', 'crossing'])
def test_a_jump_of_the_localisation_stops_the_ball(at_start, goal):
    handle, node = at_start.send(*goal), at_start.node
    assert at_start.spin(60.0, lambda: node.state.status is NavStatus.CROSSING if goal[0] > 3.0
                         else abs(at_start.speed) > 0.1)
    at_start.offset = [0.0, 1.0]
    assert at_start.spin(10.0, lambda: node.state.reason == 'localisation_jump')
    assert at_start.spin(10.0, lambda: at_start.speed == 0.0)
    handle.cancel_goal_async()
    assert at_start.fails(handle) == 'canceled'


def test_a_goal_ends_when_the_localisation_stops(at_start):
    handle, node = at_start.send(2.4, 2.4), at_start.node
    assert at_start.spin(20.0, lambda: abs(at_start.speed) > 0.1)
    at_start.localized = False
    at_start.spin(0.5)
    assert not node.state.status.ended
    at_start.time += ODOMETRY_TIMEOUT
    assert at_start.fails(handle) == 'stale'
    assert not at_start.send(2.4, 2.4).accepted
    at_start.localized = True
    assert at_start.spin(10.0, lambda: node.refusal is None)
    assert at_start.send(2.4, 2.4).accepted


def test_a_static_transform_from_the_map_is_not_renewed(at_start):
    at_start.localized = False
    at_start.mount('map', 'odom', (0.1, 0.0, 0.0), Quaternion(w=1.0))
    assert at_start.spin(10.0, lambda: at_start.node.percept.x > START[0] + 0.05)
    at_start.time += 2 * ODOMETRY_TIMEOUT
    at_start.spin(0.5)
    assert at_start.node.refusal is None and at_start.send(2.4, 2.4).accepted


def test_sensor_data_that_are_not_finite_have_no_lasting_effect(at_start):
    node, before = at_start.node, at_start.node._traveled
    terrain = at_start.client.create_publisher(TerrainObservation, 'terrain_observation', 1)
    for value in (math.nan, math.inf, 1e300):
        at_start.scans.publish(LaserScan(
            ranges=[1.0] * 9, range_max=8.0, angle_min=value, angle_increment=value))
        terrain.publish(TerrainObservation(x=[value] * 9, z=[0.0]))
        at_start.pose[0], at_start.turn = value, Quaternion(z=value, w=1.0)
        at_start.spin(0.3)
    at_start.pose, at_start.turn = list(START), None
    assert at_start.spin(5.0, lambda: node.percept.x == START[0] and node._faces is None)
    assert abs(node._traveled - before) < 1.0


def test_odometry_and_transforms_with_a_quaternion_of_zeros_end_the_goal(at_start):
    handle = at_start.send(2.4, 2.4)
    at_start.turn = Quaternion(w=0.0)
    at_start.spin(0.5)
    at_start.turn = None
    assert at_start.fails(handle) == 'not_finite'


def test_a_map_with_a_wall_at_the_goal_ends_it_while_the_ball_drives(at_start):
    reload = at_start.client.create_client(Trigger, 'navigator/reload')

    def replace(shades):
        Image.fromarray(shades).save(at_start.folder / 'plan.pgm')
        assert at_start.wait(reload.call_async(Trigger.Request())).success
    handle = at_start.send(2.5, 2.6)
    assert at_start.spin(20.0, lambda: abs(at_start.speed) > 0.1)
    shades = np.array(at_start.image)
    shades[24:32, 44:56] = 0
    replace(shades)
    assert at_start.fails(handle) == 'wall'
    replace(np.array(at_start.image))
