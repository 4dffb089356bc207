# SPDX-License-Identifier: Apache-2.0
"""Parameters that each node can change at run time, and the reload of its own dump."""
import gc
import math

import pytest
from rclpy.node import Node
from rclpy.parameter import get_parameter_value, Parameter
from refusals import refused
import yaml

from ballbot_ros.nodes.bridge.node import Bridge
from ballbot_ros.nodes.controller.node import Controller
from ballbot_ros.nodes.emulated_robot.node import EmulatedRobot
from ballbot_ros.nodes.imu.node import ImuNode
from ballbot_ros.nodes.navigator.node import NavigatorNode
from ballbot_ros.nodes.obstacle_decision.node import ObstacleDecision
from ballbot_ros.nodes.simulator.node import Simulator
from ballbot_ros.ros.parameters import BUILT_IN
from ballbot_ros.ros.topics import TOPICS

NODES = {
    Simulator: {'start_paused': True}, Controller: {}, ObstacleDecision: {'planner': 'cubic'},
    Bridge: {'autostart': False, 'black_box': '', 'port': '/dev/none'},
    ImuNode: {'port': '/dev/none'}, EmulatedRobot: {'scene': 'flat'}}


@pytest.fixture
def start(make_node, tmp_path):
    """Return a function that starts a node, and ends it as `run` does."""
    started = []

    def start(cls, **given):
        own = {'link': str(tmp_path / 'motor')} if cls is EmulatedRobot else {}
        started.append(make_node(cls, **{**NODES.get(cls, {}), **own, **given}))
        return started[-1]
    yield start
    for node in started:
        getattr(node, 'make_safe', lambda: None)()


def changed(node, **values):
    """Set all values atomically; return the reason of a refusal, empty on success."""
    result = node.set_parameters_atomically(
        [Parameter(name.replace('__', '.'), value=value) for name, value in values.items()])
    assert result.successful == (not result.reason)
    return result.reason


def refuses(node, **values):
    """Set values atomically; return whether a refusal names one of them and changes none."""
    def present():
        return [node.get_parameter(name.replace('__', '.')).value for name in values]
    before, reason = present(), changed(node, **values)
    return any(name.replace('__', '.') in reason for name in values) and present() == before


def loaded(node):
    """Dump and load all parameters as `ros2 param` does; return the reasons of refusals."""
    names = node.list_parameters([], 0).names
    dump = yaml.dump({name: node.get_parameter(name).value for name in names})
    assert len(names) > 5
    return [result.reason for result in node.set_parameters([
        Parameter(name, value=Parameter.from_parameter_msg(
            Parameter(name).to_parameter_msg()).value) if value is None else _sent(name, value)
        for name, value in yaml.safe_load(dump).items()]) if not result.successful]


def _sent(name, value):
    message = Parameter(name).to_parameter_msg()
    message.value = get_parameter_value(str(value))
    return Parameter.from_parameter_msg(message)


@pytest.mark.parametrize('cls', NODES)
def test_each_parameter_has_a_description_and_a_range_and_the_own_dump_loads(start, cls):
    node = start(cls)
    own = set(node.get_parameters_by_prefix('')) - set(BUILT_IN)
    some = [node.describe_parameter(name) for name in own]
    assert any(one.read_only for one in some) and not all(one.read_only for one in some)
    for described in some:
        assert len(described.description) > 40, described.name
        assert described.read_only == ('Can change' not in described.description), described.name
        if type(node.get_parameter(described.name).value) in (float, int):
            span, = described.floating_point_range or described.integer_range
            assert math.isfinite(span.from_value) and math.isfinite(span.to_value), described.name
    assert loaded(node) == []


@pytest.mark.parametrize('cls, given', [
    *((cls, {}) for cls in NODES), (NavigatorNode, {'autostart': False}),
    (Simulator, {'floor': 'apartment'}),
    (Simulator, {'publish_clock': False, 'control': 'onboard'})])
def test_the_table_of_topics_names_each_node_at_its_topics(start, cls, given):
    node = start(cls, **given)
    missing = [
        (side, topic) for side in ('publishers', 'subscribers')
        for topic in {one.topic_name for one in getattr(
            node, side.replace('subscribers', 'subscriptions'))} - {'/parameter_events'}
        if node.get_name() not in getattr(
            TOPICS.get(topic) or TOPICS[topic[1:]], side).split(', ')]
    assert missing == []


def test_a_simulator_changes_rates_noise_and_timeouts_all_or_none(start):
    node = start(Simulator)
    assert changed(node, observation_distance_sd=0.1, command_timeout=0.2, odom_rate=50,
                   terrain_rate=10.0, sensor_dropout=1.0, torque_limit=1.0) == ''
    assert (node._gate.timeout, node._plant.torque_limit) == (0.2, 1.0)
    assert node._outputs._every.odometry == 10
    assert 'terrain_observation' in [one.topic.strip('/') for one in node.publishers]
    assert node._outputs._sensors.measure(everything=True) == []
    assert refuses(node, odom_rate=300.0, command_timeout=0.3)
    assert node._gate.timeout == 0.2
    assert refuses(node, lockstep=True, terrain_rate=0.0)
    assert refuses(node, scene='flat')


def test_the_real_time_factor_of_a_simulator_can_change(start):
    node = start(Simulator)
    periods = []
    for factor in (0.5, 0.0, 1):
        assert changed(node, real_time_factor=factor) == ''
        periods.append(1e-9 * node._timer.timer_period_ns)
    assert periods == pytest.approx([0.004, 0.0005, 0.002])


def test_use_sim_time_of_a_simulator_is_reported_and_does_no_harm(start, capfd):
    node = start(Simulator, use_sim_time=True)
    assert 'use_sim_time' in capfd.readouterr().err
    assert node.get_parameter('use_sim_time').value


def test_a_running_simulator_refuses_use_sim_time(start):
    node = start(Simulator)
    assert refuses(node, use_sim_time=True)
    assert changed(node, use_sim_time=False, odom_rate=50.0) == ''


def test_a_bridge_refuses_simulated_time_at_the_start_and_later(start):
    with refused('inconsistent', 'use_sim_time'):
        start(Bridge, use_sim_time=True)
    node = start(Bridge)
    assert refuses(node, use_sim_time=True)


@pytest.mark.slow
def test_a_controller_refuses_gains_that_diverge_and_names_the_rate_that_works(start):
    node = start(Controller, tuning='gentle')
    assert '1101 Hz' in changed(node, gains__position_kd=40.0)
    assert node.get_parameter('gains.position_kd').value == 0.8
    assert changed(node, tuning='published', torque_limit=2.0, state_timeout=0.2) == ''
    assert node._controller.expected.lowest_rate == pytest.approx(275.0, abs=1.0)
    assert node._settings.state_timeout == 0.2 and node._timer.timer_period_ns == 50_000_000
    assert node.get_parameter('gains.position_kd').value == 10.0


def test_a_decision_changes_margins_unless_they_are_inconsistent(start):
    node = start(ObstacleDecision)
    pilot = node._decider._pilot
    assert changed(node, required_probability=0.8, cruise_speed=0.5) == ''
    assert pilot._tuning.cruise_speed == 0.5 and node._decider._pilot is pilot
    assert refuses(node, cruise_speed=2.0)
    assert refuses(node, forget_after=7)
    assert refuses(node, acceleration=9.0)
    assert pilot._tuning.cruise_speed == 0.5


@pytest.mark.slow
def test_a_bridge_passes_gains_and_timeouts_to_its_loop(start):
    node = start(Bridge)
    law = node._session.law
    assert changed(node, gains__position_kp=7.0, set_point_timeout=0.8, status_rate=5.0) == ''
    assert law._controller._tuning.position_kp == 7.0 and law.expected.set_point_timeout == 0.8
    assert 'diverges on gimball' in changed(node, tuning='published')
    assert refuses(node, joint_state_rate=5000.0)
    assert changed(node, odom_rate=0.0) == ''
    assert node._robot_outputs._topics._odometry is None
    assert law._controller._tuning.position_kp == 7.0


def test_each_parameter_of_a_navigator_is_fixed_for_its_own_reason(start):
    node = start(NavigatorNode, autostart=False)
    assert '~/reload' in node.describe_parameter('floor').description
    assert refuses(node, floor='hall') and '~/reload' in changed(node, floor='hall')


def test_the_axes_of_an_imu_can_change(start):
    node = start(ImuNode)
    assert changed(node, axes='-y x z', gyro_sd=0.01) == ''
    assert refuses(node, axes='up') and refuses(node, rate=100)


def test_the_noise_of_an_emulated_robot_can_change(start):
    node = start(EmulatedRobot)
    assert changed(node, gyro_sd=0.5, imu_rate=100.0) == ''
    assert node._imu._gyro_sd == 0.5 and node._timer.timer_period_ns == 10_000_000


@pytest.mark.slow
@pytest.mark.parametrize('cls', [Simulator, Controller, ObstacleDecision])
def test_a_destroyed_node_leaves_the_graph_immediately(start, make_node, cls):
    onlooker = make_node(Node, 'onlooker')
    gc.collect()  # garbage of other tests
    gc.disable()
    try:
        node = start(cls)
        name = node.get_name()
        assert name in onlooker.get_node_names()
        node.destroy_node()
        assert name not in onlooker.get_node_names()
    finally:
        gc.enable()
