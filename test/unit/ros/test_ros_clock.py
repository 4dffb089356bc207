# SPDX-License-Identifier: Apache-2.0
"""No stamp is ahead of /clock, and all simulators of a graph share one time."""

from nav_msgs.msg import Odometry
import pytest
from rclpy.node import Node
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from ballbot_ros.msg import BallState, TerrainObservation
from ballbot_ros.nodes.simulator.node import Simulator
from ballbot_ros.nodes.simulator.outputs import CDR, CLOCK
from ballbot_ros.nodes.simulator.scheduler import FollowedClock, LAG_MAX
from ballbot_ros.physics import load_scene
from ballbot_ros.plant import Plant
from ballbot_ros.ros import qos
from ballbot_ros.ros.conversions import to_seconds, to_time
from ballbot_ros.ros.endpoints import mismatches

TOPICS = (('joint_states', JointState), ('odom', Odometry), ('ball_state', BallState),
          ('terrain_observation', TerrainObservation))


@pytest.fixture
def simulators(make_node, spinner):
    """Return a function that makes simulators, and one that spins until a condition is true."""
    def make(namespace='', **parameters):
        # Only subscriptions that the executor has collected receive messages in order.
        spinner.executor.spin_once(timeout_sec=0.01)
        node = make_node(Simulator, namespace=namespace, **{'scene': 'flat', **parameters})
        spinner.add(node)
        return node

    make.listener = make_node(Node, 'listener')
    spinner.add(make.listener)
    return make, spinner.until


class Arrivals:
    """Messages that one subscriber receives, in order of arrival."""

    def __init__(self, node, *namespaces):
        self.now, self.clocks, self.ahead = -1.0, [], []
        self.received = {}
        node.create_subscription(Clock, '/clock', self._tick, qos.recording('/clock'))
        for namespace in namespaces:
            for topic, kind in TOPICS:
                name = f'{namespace}/{topic}'
                self.received[name] = []
                node.create_subscription(kind, name, self._receiver(name), qos.STATE)

    def _tick(self, message):
        self.now = to_seconds(message.clock)
        self.clocks.append(self.now)

    def _receiver(self, name):
        def receive(message):
            stamp = to_seconds(message.header.stamp)
            self.received[name].append(stamp)
            if stamp > self.now:
                self.ahead.append((name, stamp, self.now))
        return receive


@pytest.mark.slow
@pytest.mark.parametrize('parameters', [
    {}, {'real_time_factor': 0.0}, {'control': 'onboard'},
    {'control': 'onboard', 'joint_state_rate': 250.0, 'odom_rate': 20.0}])
def test_no_stamp_is_ahead_of_the_clock_in_order_of_arrival(simulators, parameters):
    make, until = simulators
    arrivals = Arrivals(make.listener, '')
    make(**parameters)
    until(lambda: all(len(found) > 20 for found in arrivals.received.values()))
    assert not arrivals.ahead
    # The clock is not published more often than required.
    assert len(set(arrivals.clocks)) <= 1 + max(map(len, map(set, arrivals.received.values()))) * (
        3 if parameters.get('joint_state_rate') == 250.0 else 1)


def test_stamps_are_ahead_of_a_clock_with_a_given_rate_by_less_than_its_period(simulators):
    make, until = simulators
    arrivals = Arrivals(make.listener, '')
    make(clock_rate=100.0)
    until(lambda: len(arrivals.received['/odom']) > 20)
    assert arrivals.ahead and all(
        stamp - now < 0.01 for _, stamp, now in arrivals.ahead if now >= 0.0)


@pytest.mark.parametrize('seconds', [0.0, 0.002, 12.5, 1e6 + 0.25])
def test_the_clock_is_serialized_as_by_the_middleware(seconds):
    time_of = to_time(seconds)
    assert CLOCK.pack(CDR, time_of.sec, time_of.nanosec) == serialize_message(
        Clock(clock=time_of))


def test_two_robots_share_one_time_and_the_second_never_runs_ahead_of_it(simulators):
    make, until = simulators
    arrivals = Arrivals(make.listener, '/a', '/b')
    follower = make('b', publish_clock=False, real_time_factor=0.0)
    until(lambda: follower._scheduler._pace._waiting_since is not None)
    assert not arrivals.received['/b/odom'] or arrivals.received['/b/odom'] == [0.0]
    make('a')
    until(lambda: min(len(arrivals.received[f'/{name}/odom']) for name in 'ab') > 30)
    assert not [one for one in arrivals.ahead if one[2] >= 0.0]
    one, other = (arrivals.received[f'/{name}/joint_states'] for name in 'ab')
    assert abs(one[-1] - other[-1]) < 0.2
    assert make.listener.count_publishers('/clock') == 1
    assert not mismatches(follower)


def test_two_publishers_of_the_clock_are_reported_by_name(simulators):
    make, until = simulators
    first, second = make('a'), make('b')
    until(lambda: mismatches(first) and mismatches(second))  # after discovery
    assert mismatches(first)[0].startswith('/b/simulator ')
    assert mismatches(second)[0].startswith('/a/simulator ')


# The clock that is followed ----------------------------------------------------------------

@pytest.fixture
def followed(make_node):
    """Return a plant, the clock that it follows, and a function that sets that clock."""
    plant = Plant(load_scene('flat'), 500.0)
    clock = FollowedClock(make_node(Node, 'b'), plant)

    def at(seconds):
        clock._on_clock(Clock(clock=to_time(seconds)))
        due = clock.due(0.0)
        plant.periods += due
        return due
    return plant, clock, at


def test_time_starts_at_the_clock_and_follows_it(followed):
    plant, clock, at = followed
    assert clock.due(0.0) == 0
    assert at(7.25) == 0 and plant.time == 7.25
    assert [at(7.25 + 0.002 * number) for number in (1, 1, 2, 5, 5)] == [1, 0, 1, 3, 0]
    assert at(7.2639) == 1 and plant.time == pytest.approx(7.262)  # never ahead


def test_a_lag_is_made_up_for_unless_it_is_long_and_a_clock_set_back_is_followed(followed):
    plant, clock, at = followed
    at(1.0)
    assert at(1.9) == 50 and [at(1.9) for _ in range(8)] == [50] * 8
    assert plant.time == pytest.approx(1.9) and clock.dropped == 0
    assert at(1.9 + LAG_MAX + 0.1) == 0 and plant.time == pytest.approx(3.0)
    assert clock.dropped == 550
    assert at(0.5) == 0 and plant.time == 0.5
    clock.restart(0.0)  # after a pause of its own
    assert at(0.9) == 0 and plant.time == 0.9 and clock.dropped == 550


def test_a_missing_clock_is_reported_after_a_timeout(followed, capfd):
    _, clock, _ = followed
    clock.due(100.0)
    clock.due(102.9)
    assert 'no /clock' not in capfd.readouterr().err
    clock.due(103.1)
    assert 'no /clock, and publish_clock is false: time is stopped' in capfd.readouterr().err
