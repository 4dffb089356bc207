# SPDX-License-Identifier: Apache-2.0
"""The live page shows running nodes, drives them while a client attends, and delays none."""
from threading import Event, Thread
from types import SimpleNamespace

from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped, Quaternion, Twist, TwistStamped, Vector3
import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from refusals import refused
from std_srvs.srv import Trigger
from waiting import wait_until

from ballbot_ros.demo.processes import own_domain
from ballbot_ros.errors import RefusedError
from ballbot_ros.msg import BallState
from ballbot_ros.ros import discovery, qos, spectator
from ballbot_ros.ros.spectator import Presence, Spectator
from ballbot_ros.view import live
from ballbot_ros.view.live import LiveSource


def state(stamp, x=0.0):
    """Return a true state."""
    message = BallState(x=x, y=0.226)
    message.header.stamp = Time(sec=int(stamp), nanosec=round(stamp % 1 * 1e9))
    return message


class Link:
    """Stands in for a spectator, and records its calls."""

    def __init__(self, nodes=('simulator',), drivers=(), followers=1):
        self.presence = Presence(frozenset(nodes), drivers, followers)
        self.holding, self.calls, self.refusal = False, [], ''

    def __getattr__(self, name):
        def record(*values):
            self.holding = name.startswith('hold') or self.holding and name != 'release_set_point'
            if name != 'attend':
                self.calls.append((name, *values))
            if self.refusal:
                raise RefusedError(self.refusal, 'refused', '')
        return record


@pytest.fixture
def link():
    """Return the link of a simulator."""
    return Link()


@pytest.fixture
def source(link):
    """Return a source of this link with two frames."""
    source = LiveSource(link=link)
    for stamp in (5.0, 5.01):
        source.receive('ball_state', state(stamp, stamp))
    return source


def test_new_frames_are_shown_and_seek_returns_to_old_ones(source):
    assert source.shown.time == pytest.approx(5.01) and source.health.running
    source.apply('seek', 5.0)
    assert source.shown.x == 5.0 and source.controls['pause'].value is True
    source.apply('pause', False)
    assert source.shown.x == pytest.approx(5.01)


def test_a_clock_that_counts_from_1970_is_shown_from_0(link):
    source = LiveSource(link=link)
    for stamp in (1.7e9, 1.7e9 + 0.5):
        source.receive('ball_state', state(stamp))
    assert source.history.span == (0.0, pytest.approx(0.5))


def test_a_repeated_state_counts_once_and_a_restart_of_time_is_a_new_epoch(source, link):
    source.receive('ball_state', state(5.01))
    assert len(source.history) == 2
    epoch = source.history.epoch
    source.receive('ball_state', state(0.0))
    assert source.history.epoch != epoch and source.history.span == (0.0, 0.0)
    assert ('ask_again',) in link.calls  # it may be another simulator


def test_a_simulator_is_paused_stepped_and_reset(source, link):
    source.learn('simulator', {'scene': 'fig7_top', 'robot': '', 'control_rate': 250.0})
    assert source.terrain.height(1.5) == pytest.approx(0.021)
    for name, value in (('pause', True), ('step', 0.1), ('pause', False), ('reset', True)):
        source.apply(name, value)
    assert link.calls == [('trigger', 'simulator/pause'), ('step', 25),
                          ('trigger', 'simulator/resume'), ('trigger', 'simulator/reset')]
    assert source.shown is None


def test_pause_stops_only_the_display_of_a_bridge():
    link = Link(nodes=('bridge',))
    source = LiveSource(link=link)
    source.receive('ball_state', state(1.0, 1.0))
    source.apply('pause', True)
    source.receive('ball_state', state(1.1, 1.1))
    assert source.shown.x == 1.0 and not link.calls
    for name, value in (('step', 0.1), ('reset', True)):
        with refused('unavailable', name):
            source.apply(name, value)


def test_an_e_stop_releases_the_set_point_and_a_refused_release_shows_the_message_of_the_bridge():
    link = Link(nodes=('bridge',))
    source = LiveSource(link=link)
    source.apply('law', 'speed')
    source.apply('e_stop', True)
    assert link.calls[-2:] == [('release_set_point',), ('trigger', 'bridge/engage_e_stop')]
    link.refusal = 'no IMU readings come'
    with refused('refused', 'e_stop'):
        source.apply('e_stop', False)


def test_the_e_stop_of_a_bridge_is_shown():
    source = LiveSource(link=Link(nodes=('bridge',)))
    source.receive('motor_status', SimpleNamespace(e_stop='at start'))
    source.receive('ball_state', state(1.0))
    assert source.controls['e_stop'].value is True and source.shown.e_stop is True


def test_a_law_is_held_and_released(source, link):
    with refused('unavailable', 'set_point'):
        source.apply('set_point', 0.3)
    source.apply('law', 'speed')
    source.apply('set_point', 0.3)
    source.apply('law', 'position')
    source.apply('set_point', 90.0)
    assert [words for words in link.calls if words[0].startswith('hold')] == [
        ('hold_speed', 0.0), ('hold_speed', 0.3), ('hold_angle', 0.0),
        ('hold_angle', pytest.approx(1.5708, abs=1e-4))]
    assert source.controls['law'].value == 'position'
    link.holding = False  # no client attended
    assert source.controls['law'].value == 'free'
    source.apply('law', 'free')
    assert link.calls[-1] == ('release_set_point',)


@pytest.mark.parametrize('link, says', [
    (Link(drivers=('obstacle_decision',)), 'published by obstacle_decision'),
    (Link(followers=0), 'no node subscribes to set-points')])
def test_the_page_does_not_drive_with_another_publisher_or_without_a_subscriber(link, says):
    with refused('unavailable', 'law') as caught:
        LiveSource(link=link).apply('law', 'speed')
    assert says in str(caught.value)


@pytest.mark.parametrize('nodes, says', [
    ((), 'Waiting for a simulator or a bridge'), (('bridge',), 'waits for its drive'),
    (('simulator',), 'paused, or waits')])
def test_health_names_the_missing_input(nodes, says):
    source = LiveSource('left', link=Link(nodes=nodes))
    assert says in source.health.notes[-1] and not source.health.running
    assert source.shown is None and source.title.startswith('Live: ')


def test_a_click_on_the_floor_is_a_goal_on_the_map_if_a_navigator_runs(link, source):
    pytest.importorskip('viser')
    from ballbot_ros.view.page import Page
    from ballbot_ros.view.server import free_port, LOOPBACK, PageServer
    said = []
    event = SimpleNamespace(client=SimpleNamespace(
        add_notification=lambda title, *_, **__: said.append(title)))
    source.learn('simulator', {'floor': 'apartment', 'start': ''})
    page = Page(source, PageServer(LOOPBACK, free_port(LOOPBACK, 0)))
    try:
        page._draw(whole=True)
        stage, controls = page._stage, page._controls
        x, y, z = stage._world.position
        point = stage.point_at((2.0 + x, 1.0 + y, 5.0 + z), (0.0, 0.1, -1.0))
        assert point == pytest.approx((2.0, 1.5))
        assert stage.point_at((2.0 + x, 1.0 + y, 5.0 + z), (0.0, 9.0, -1.0)) is None
        assert stage.point_at((2.0 + x, 1.0 + y, 5.0 + z), (0.0, 0.0, 1.0)) is None
        controls.go_to(point, event)
        assert said == ['Refused'] and 'navigator' in source.controls['goal'].refusal
        link.presence = Presence(frozenset({'simulator', 'navigator'}), ('navigator',), 1)
        controls.go_to(point, event)
        controls.go_to(None, event)
        assert link.calls == [('go_to', *point, 'map')] and said == ['Refused', 'Goal']
    finally:
        page._server.end()


def test_a_page_survives_another_publisher_while_it_holds_a_set_point(link, source):
    pytest.importorskip('viser')
    from ballbot_ros.view.controls import Controls
    from ballbot_ros.view.server import free_port, LOOPBACK, PageServer
    source.apply('law', 'speed')
    source.apply('set_point', 0.3)
    server = PageServer(LOOPBACK, free_port(LOOPBACK, 0))
    try:
        controls = Controls(server, source)
        link.presence = Presence(frozenset({'simulator'}), ('obstacle_decision',), 1)
        for _ in range(2):
            controls.refresh()
        assert [controls._widgets[name].value for name in ('law', 'set_point')] == ['-', '-']
    finally:
        server.end()


# --- With ROS -------------------------------------------------------------------------------


SETTINGS = {'scene': 'fig7_top', 'robot': '', 'control_rate': 250.0, 'floor': '', 'start': ''}


class Robot:
    """A node with the name and the endpoints of a simulator, in a separate thread."""

    def __init__(self, kind=TwistStamped):
        self.context = Context()
        rclpy.init(context=self.context)
        self.node = Node('simulator', namespace='left', context=self.context)
        for name, value in SETTINGS.items():
            self.node.declare_parameter(name, value)
        self.states = self.node.create_publisher(BallState, 'ball_state', qos.STATE)
        self.speeds, self.goals, self.paused = [], [], Event()
        self.node.create_subscription(PoseStamped, 'goal_pose', self.goals.append, qos.LATEST)
        self.node.create_subscription(kind, 'cmd_vel', self.speeds.append, qos.LATEST)
        self.node.create_service(Trigger, '~/pause', self.pause)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.thread = Thread(target=self.executor.spin)
        self.thread.start()

    def pause(self, _, response):
        self.paused.set()
        response.success = True
        return response

    def close(self):
        self.executor.shutdown()
        self.thread.join()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self.context)


@pytest.fixture
def domain(monkeypatch):
    """Use a ROS domain of this process, limited to this machine."""
    monkeypatch.setattr(discovery, 'apply', lambda _: '')
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    monkeypatch.setenv('ROS_DOMAIN_ID', str(own_domain()))


@pytest.fixture
def robot(domain):
    """Return a robot that has just started."""
    robot = Robot()
    yield robot
    robot.close()


@pytest.mark.slow
def test_a_spectator_receives_and_calls_and_drives_while_a_client_attends(
        domain, robot, monkeypatch):
    monkeypatch.setattr(spectator, 'GRAPH_PERIOD', 0.1)
    received, learned = [], {}
    viewer = Spectator('left', lambda *words: received.append(words), learned.__setitem__)
    viewer.start()
    try:
        wait_until(lambda: learned and viewer.presence.followers)
        assert learned == {'simulator': SETTINGS}
        wait_until(lambda: robot.states.publish(state(1.5, 0.7)) or received)
        assert received[0][0] == 'ball_state' and received[0][1].x == 0.7
        viewer.trigger('simulator/pause')
        assert robot.paused.is_set()

        viewer.go_to(2.0, 3.0, 'map')
        wait_until(lambda: robot.goals)
        assert robot.goals[0].header.frame_id == 'map' and robot.goals[0].pose.position.y == 3.0
        assert robot.goals[0].pose.orientation == Quaternion(w=0.0)  # any heading

        def driven():
            viewer.attend()
            return robot.speeds
        viewer.hold_speed(0.3)
        wait_until(driven)
        assert robot.speeds[0].twist.linear.x == 0.3
        wait_until(lambda: not viewer.holding)  # the browser is closed
        wait_until(lambda: not robot.node.count_publishers('cmd_vel'))
    finally:
        viewer.close()


def test_a_late_subscriber_of_twist_receives_twist(domain):
    viewer = Spectator('left', lambda *_: None, lambda *_: None)
    viewer.start()
    viewer.attend()
    viewer.hold_speed(0.4)
    wait_until(lambda: viewer.attend() or viewer._speeds is not None)  # no follower yet
    robot = Robot(Twist)
    try:
        wait_until(lambda: viewer.attend() or robot.speeds)
        assert robot.speeds[0] == Twist(linear=Vector3(x=0.4))
    finally:
        viewer.close()
        robot.close()


def test_a_page_that_hangs_does_not_delay_the_publisher(domain, robot):
    hangs, resumes = Event(), Event()

    def receive(*_):
        hangs.set()
        resumes.wait()

    viewer = Spectator('left', receive, lambda *_: None)
    viewer.start()
    try:
        wait_until(lambda: robot.states.publish(state(0.0)) or hangs.is_set())
        for number in range(5000):  # more than any queue holds
            robot.states.publish(state(0.01 * number))
        assert not resumes.is_set()
    finally:
        resumes.set()
        viewer.close()


def test_an_invalid_namespace_is_refused(domain):
    with refused('wrong_type', '--namespace'):
        Spectator('not a name', lambda *_: None, lambda *_: None)


def test_live_frames_are_kept_without_a_viewer(link, monkeypatch):
    monkeypatch.setattr(live, 'FRAME_TIMEOUT', 1e9)
    source = LiveSource(link=link)
    for number in range(300):
        source.receive('ball_state', state(0.01 * number))
    assert len(source.history) == 300
