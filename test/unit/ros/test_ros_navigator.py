# SPDX-License-Identifier: Apache-2.0
"""The node ``navigator`` on real topics: actions, goal_pose, cancellation, preemption, e-stop."""
import math
import time

from geometry_msgs.msg import Quaternion, TwistStamped
from nav_msgs.msg import Odometry
from navigator_graph import Graph, START
import numpy as np
import pytest
import rclpy
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.navigation.execution import NavStatus
from ballbot_ros.nodes.navigator.goals import ComputePathToPose, NavigateToPose
from ballbot_ros.nodes.navigator.outputs import stamped_pose
from ballbot_ros.ros import endpoints
from ballbot_ros.ros.conversions import to_time


@pytest.fixture
def graph(request, context):
    made = Graph(context, **getattr(request, 'param', {}))
    assert made.spin(30.0, lambda: made.node.percept is not None
                     and made.navigate.server_is_ready() and made.compute.server_is_ready())
    yield made
    made.close()


@pytest.mark.slow
def test_a_goal_is_reached_with_feedback_and_a_plan(graph):
    handle = graph.send(2.6, 1.4)
    assert handle.accepted
    result = graph.wait(handle.get_result_async(), 60.0)
    assert result.result.error_code == 0
    assert math.dist(graph.pose[:2], (2.6, 1.4)) < 0.2
    assert graph.plans and graph.plans[0].header.frame_id == 'map' and graph.plans[0].poses
    assert graph.feedback and graph.feedback[0].distance_remaining > 0.3


def test_refused_goals_name_their_reason(graph):
    for goal in ((0.05, 3.0), (99.0, 0.0), (math.nan, 0.0)):
        assert not graph.send(*goal).accepted
    for turn in (Quaternion(z=1e300, w=1e300), Quaternion(w=math.inf)):
        request = NavigateToPose.Goal(pose=stamped_pose('map', to_time(0.0), 2.6, 1.4, 0.0))
        request.pose.pose.orientation = turn
        assert not graph.wait(graph.navigate.send_goal_async(request)).accepted
    assert not graph.send(2.6, 1.4, frame='odom').accepted
    request = ComputePathToPose.Goal(goal=stamped_pose('map', to_time(0.0), 0.05, 3.0, 0.0))
    handle = graph.wait(graph.compute.send_goal_async(request))
    result = graph.wait(handle.get_result_async()).result
    assert result.error_code == 9000 and result.error_msg.startswith('wall')


def test_a_path_is_computed_without_driving(graph):
    request = ComputePathToPose.Goal(goal=stamped_pose('map', to_time(0.0), 8.1, 5.5, 0.0))
    handle = graph.wait(graph.compute.send_goal_async(request))
    path = graph.wait(handle.get_result_async()).result.path
    assert len(path.poses) > 50
    end = path.poses[-1].pose.position
    assert math.dist((end.x, end.y), (8.1, 5.5)) < 0.15
    assert graph.node.state.status is NavStatus.IDLE and graph.speed == 0.0


def test_a_quaternion_of_zeros_means_any_heading(graph):
    def length(orientation):
        goal = stamped_pose('map', to_time(0.0), 2.6, 0.8, 0.0)
        goal.pose.orientation = orientation
        handle = graph.wait(graph.compute.send_goal_async(ComputePathToPose.Goal(goal=goal)))
        points = [(pose.pose.position.x, pose.pose.position.y) for pose in
                  graph.wait(handle.get_result_async()).result.path.poses]
        return sum(map(math.dist, points, points[1:]))
    shortest = length(Quaternion(w=0.0))
    assert 0.9 < shortest < 1.5
    assert length(Quaternion(z=1.0, w=0.0)) > shortest + 0.3
    goal = stamped_pose('map', to_time(0.0), 2.6, 1.4, 0.0)
    goal.pose.orientation = Quaternion(w=0.0)
    graph.goals.publish(goal)
    assert graph.spin(20.0, lambda: graph.node.state.goal == (2.6, 1.4))


def test_cancellation_and_preemption_end_at_rest(graph):
    first = graph.send(2.6, 2.0)
    assert graph.spin(20.0, lambda: abs(graph.speed) > 0.1)
    second = graph.send(2.6, 0.8)
    assert graph.wait(first.get_result_async()).result.error_msg.startswith('preempted')
    assert graph.spin(20.0, lambda: abs(graph.speed) > 0.1)
    graph.wait(second.cancel_goal_async())
    assert graph.wait(second.get_result_async()).result.error_msg.startswith('canceled')
    assert abs(graph.speed) < 0.03 and graph.node.state.status is NavStatus.CANCELED


def test_a_goal_pose_of_rviz_is_followed_until_the_e_stop_and_its_end_is_logged(graph, capfd):
    graph.goals.publish(stamped_pose('map', to_time(0.0), 2.6, 1.4, 0.0))
    assert graph.spin(20.0, lambda: abs(graph.speed) > 0.1)
    graph.e_stops.publish(Bool(data=True))
    assert graph.spin(10.0, lambda: graph.node.state.status is NavStatus.FAILED)
    assert graph.node.state.reason == 'e_stop'
    assert graph.spin(5.0, lambda: graph.speed == 0.0)
    assert 'failed: the e-stop is engaged' in capfd.readouterr().err


def test_goals_are_refused_while_the_e_stop_is_engaged_and_paths_are_computed(graph):
    graph.e_stops.publish(Bool(data=True))
    assert graph.spin(10.0, lambda: graph.node.e_stop)
    assert not graph.send(2.6, 1.4).accepted
    graph.goals.publish(stamped_pose('map', to_time(0.0), 2.6, 1.4, 0.0))
    assert graph.spin(10.0, lambda: graph.node.servers.refused['e_stop'] == 2)
    request = ComputePathToPose.Goal(goal=stamped_pose('map', to_time(0.0), 2.6, 1.4, 0.0))
    handle = graph.wait(graph.compute.send_goal_async(request))
    assert graph.wait(handle.get_result_async()).result.path.poses
    graph.e_stops.publish(Bool(data=False))
    assert graph.spin(10.0, lambda: not graph.node.e_stop)
    assert graph.send(2.6, 1.4).accepted


def test_a_goal_at_the_position_of_the_ball_is_reached_without_a_motion(graph):
    handle = graph.send(*START)
    assert graph.wait(handle.get_result_async()).result.error_code == 0
    assert graph.node.state.status is NavStatus.SUCCEEDED and graph.speed == 0.0


def test_deactivation_ends_a_goal_and_further_goals_are_refused(graph):
    handle = graph.send(2.6, 1.4)
    graph.node.trigger_deactivate()
    assert graph.wait(handle.get_result_async()).result.error_msg.startswith('inactive')
    assert not graph.send(2.6, 1.4).accepted


def test_shutdown_ends_a_goal_and_further_goals_are_refused(graph):
    handle = graph.send(2.6, 1.4)
    assert graph.spin(20.0, lambda: abs(graph.speed) > 0.1)
    graph.node.trigger_shutdown()
    assert graph.wait(handle.get_result_async()).result.error_msg.startswith('inactive')
    assert graph.spin(5.0, lambda: graph.speed == 0.0)
    assert not graph.send(2.6, 1.4).accepted


@pytest.mark.parametrize('paused', [False, True])
def test_a_goal_ends_when_odometry_stops_unless_time_is_paused(graph, paused, monkeypatch):
    monkeypatch.setattr(endpoints, 'ODOMETRY_TIMEOUT', 1)
    graph.node.set_parameters([Parameter('use_sim_time', value=paused)])  # nothing publishes it
    result = graph.send(2.6, 1.4).get_result_async()

    def ends(seconds):
        end = time.monotonic() + seconds
        while not result.done() and time.monotonic() < end:
            graph.executor.spin_once(timeout_sec=0.1)
        return result.done()
    if paused:
        for _ in range(4):
            graph.node._timeout._count()  # as its timer does each second
        assert not ends(0.1)
        graph.client.destroy_publisher(graph.odometry)  # the simulator has ended
    assert ends(20.0) and result.result().result.error_msg.startswith('missing')


@pytest.mark.parametrize('graph', [{'floor': 'no_such_floor'}], indirect=True)
def test_a_missing_floor_leaves_the_node_unconfigured(graph, capfd):
    graph.node._try_start()  # as a timer does each second
    assert graph.node.state_label == 'unconfigured'
    assert 'no_such_floor' in graph.node._health()[1]
    assert 'no_such_floor' not in capfd.readouterr().err  # logged once, at the start
    assert not graph.send(2.6, 1.4).accepted


def test_a_file_for_learned_data_that_cannot_be_written_is_reported(context, tmp_path, capfd):
    (tmp_path / 'file').touch()
    Graph(context, learned=str(tmp_path / 'file' / 'learned.json')).close()
    assert 'learned data cannot be kept: ' in capfd.readouterr().err


def test_a_curve_of_another_robot_ends_the_node(context):
    with pytest.raises(ConfigurationError) as caught:
        Graph(context, curve='shellball_free')
    assert (caught.value.reason, caught.value.field) == ('inconsistent', 'curve')


@pytest.mark.parametrize('age, frame, seen', [
    (0.0, 'base_link', True), (2.0, 'base_link', False), (0.0, 'laser', False)],
    ids=['new', 'stale', 'unknown frame'])
def test_an_obstacle_counts_in_a_new_scan_of_a_known_frame_only(
        graph, capfd, age, frame, seen):
    graph.frames['scan'] = frame

    def decided():
        graph.scan(age, 0.7, math.nan, math.inf, -1.0)
        return graph.node.state.learned.obstacles or graph.node.state.status.ended
    graph.send(2.7, 1.4)
    assert graph.spin(60.0, decided)
    assert bool(graph.node.state.learned.obstacles) == seen
    refused = "no valid static transform from 'base_link', the child_frame_id of odom, to 'laser'"
    assert (refused in capfd.readouterr().err) == (frame == 'laser')


def test_a_scan_of_a_laser_that_is_mounted_upside_down_is_transformed(graph):
    """The laser is turned to the left on a mount that is turned over about the x axis."""
    half = math.sqrt(0.5)
    graph.mount('base_link', 'mount', (0.1, 0.02, 0.2), Quaternion(x=3.0, w=0.0))
    graph.mount('mount', 'laser', (0.0, 0.0, 0.0), Quaternion(z=half, w=half))
    graph.frames['scan'], found = 'laser', []

    def received():
        graph.scan(0.0, 2.0, math.nan, 1.0, math.inf, -1.0, increment=-0.5 * math.pi)
        percept = graph.node.percept
        if percept is not None and percept.points is not None:
            found.append(percept)
        return found
    assert graph.spin(20.0, received)
    x, y, heading = found[0][1:4]
    ahead = np.array([math.cos(heading), math.sin(heading)])
    left = np.array([-ahead[1], ahead[0]])
    # The rays at 0 and -180 degrees in the scan point to the right and to the left of the robot.
    assert np.allclose(found[0].points, [
        (x, y) + 0.1 * ahead + (0.02 - 2.0) * left,
        (x, y) + 0.1 * ahead + (0.02 + 1.0) * left], atol=1e-6)


@pytest.mark.parametrize('begin, end, turn', [
    ('laser', 'laser', 1.0), ('laser', 'mount', 1.0), ('base_link', 'mount', 0.0),
    ('base_link', 'mount', math.nan)], ids=['loop', 'cycle', 'zeros', 'nan'])
def test_a_scan_with_invalid_static_transforms_is_refused(graph, capfd, begin, end, turn):
    graph.mount(begin, 'mount', (0.1, 0.0, 0.0), Quaternion(w=turn))
    graph.mount(end, 'laser', (0.1, 0.0, 0.0), Quaternion(w=1.0))
    graph.frames['scan'] = 'laser'
    refused = []

    def received():
        graph.scan(0.0, 2.0)
        refused.append('scan refused' in capfd.readouterr().err)
        return any(refused)
    assert graph.spin(20.0, received) and graph.node.percept.points is None


def test_odometry_in_another_frame_ends_the_goal_at_rest_until_it_is_correct(graph):
    handle = graph.send(2.7, 1.4)
    assert graph.spin(20.0, lambda: abs(graph.speed) > 0.1)
    graph.frames['odom'] = 'map'
    assert graph.fails(handle) == 'wrong_frame'
    assert "'odom', got 'map'" in graph.node._health()[1]
    assert not graph.send(2.7, 1.4).accepted
    graph.frames['odom'] = 'odom'
    assert graph.spin(20.0, lambda: graph.node.refusal is None)
    assert graph.send(2.7, 1.4).accepted


@pytest.mark.parametrize('kind, topic', [
    (Odometry, 'odom'), (TwistStamped, 'cmd_vel'), (JointState, 'set_point')])
def test_another_publisher_ends_the_goal_at_rest_and_is_named_until_it_ends(graph, kind, topic):
    handle = graph.send(2.7, 1.4)
    assert graph.spin(20.0, lambda: abs(graph.speed) > 0.1)
    other = rclpy.create_node('other_robot', context=graph.client.context)
    other.create_publisher(kind, topic, 10)
    try:
        assert graph.fails(handle) == 'several_publishers'
        assert f'/other_robot publish /{topic}' in graph.node._health()[1]
        refused = graph.node.servers.refused
        assert not graph.send(2.7, 1.4).accepted and refused['several_publishers'] == 1
        graph.goals.publish(stamped_pose('map', to_time(0.0), 2.7, 1.4, 0.0))
        assert graph.spin(20.0, lambda: refused['several_publishers'] == 2)
    finally:
        other.destroy_node()
    assert graph.spin(20.0, lambda: graph.send(2.7, 1.4).accepted)


def test_a_second_navigator_of_the_same_name_is_refused_immediately(graph):
    assert graph.send(2.7, 1.4).accepted
    other = rclpy.create_node('navigator', context=graph.client.context)
    other.create_publisher(TwistStamped, 'cmd_vel', 10)
    try:
        assert graph.spin(20.0, lambda: graph.node.state.status is NavStatus.FAILED)
        assert graph.node.state.reason == 'several_publishers'
        # Its node may be discovered after its publisher.
        assert graph.spin(20.0, lambda: '/navigator and /navigator publish /cmd_vel'
                          in graph.node._health()[1])
        assert not graph.send(2.7, 1.4).accepted
    finally:
        other.destroy_node()


def test_odometry_that_is_not_finite_ends_the_goal_at_rest(graph):
    handle = graph.send(2.7, 1.4)
    assert graph.spin(20.0, lambda: abs(graph.speed) > 0.1)
    graph.pose[0] = math.nan
    graph.spin(10.0, lambda: graph.speed == 0.0)
    graph.pose[0] = START[0]
    result = graph.wait(handle.get_result_async()).result
    assert result.error_msg.startswith('not_finite') and graph.speed == 0.0


def test_a_failed_reload_keeps_the_previous_floor(context, tmp_path):
    path = tmp_path / 'floor.yaml'
    path.write_text('walls: {size: [4, 4], lines: []}\n')
    graph = Graph(context, floor=str(path))
    try:
        assert graph.spin(30.0, lambda: graph.node.percept is not None
                          and graph.navigate.server_is_ready())
        planner = graph.node.navigator.planner
        reload = graph.client.create_client(Trigger, 'navigator/reload')
        assert graph.spin(10.0, reload.service_is_ready)
        for size, loaded in (('[40000, 40000]', False), ('[.nan, 4]', False), ('[5, 4]', True)):
            path.write_text(f'walls: {{size: {size}, lines: []}}\n')
            assert graph.wait(reload.call_async(Trigger.Request())).success == loaded
            assert (graph.node.navigator.planner is planner) != loaded
    finally:
        graph.close()
