# SPDX-License-Identifier: Apache-2.0
"""Lockstep: runs repeat to the bit, and time stops without a controller."""
from itertools import pairwise

import pytest
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from ballbot_ros.msg import BallState, TerrainObservation
from ballbot_ros.ros.conversions import to_seconds

# The ball swings its pendulum and crosses a step.
SCENE = """
robot: gimball
terrain:
  - flat: {length: 1.426}
  - step: {height: 0.031}
  - flat: {length: 3.0}
initial: {x: 0.7}
duration: 2.5
"""
PERIODS = 1250
NOISE = {'observation_distance_sd': 0.02, 'observation_height_sd': 0.001}
KINDS = {'ball_state': BallState, 'joint_states': JointState, 'joint_commands': JointState,
         'terrain_observation': TerrainObservation}


@pytest.fixture
def scene(tmp_path):
    """Return the file of the scene."""
    path = tmp_path / 'close.yaml'
    path.write_text(SCENE)
    return path


def start_all(graph, scene, together=False, **parameters):
    """Start the three nodes; return the lists of their messages once all are connected."""
    received = {topic: graph.subscribe(topic, kind) for topic, kind in KINDS.items()}
    nodes = {'controller': {'lockstep_set_point_period': 0.02},
             'obstacle_decision': {'unseen_room': 1.0},
             'simulator': {'scene': scene, 'lockstep': True, 'real_time_factor': 0.0,
                           'start_paused': True, **parameters}}
    if together:
        graph.start_together(**nodes)
    else:
        for name, values in nodes.items():
            graph.start(name, **values)
    # A command responds to a state and a set-point, a set-point to an observation.
    graph.wait_until_connected(*received.values())
    return received


def record(graph, scene, seed, together):
    """Return the messages of a run by topic and stamp; text distinguishes -0.0 from 0.0."""
    received = start_all(graph, scene, together, seed=seed, **NOISE)
    end = graph.step(PERIODS)
    for messages in received.values():
        graph.wait_for_time(messages, end)
    found = {}
    for topic, messages in received.items():
        for message in messages:
            key = topic, to_seconds(message.header.stamp)
            # A state without an immediate answer is published again, with the same numbers.
            assert found.setdefault(key, str(message)) == str(message), key
    graph.close()
    return found


@pytest.mark.slow
def test_runs_repeat_to_the_bit_in_one_or_several_processes_and_depend_on_the_seed(
        make_graph, scene):
    first = record(make_graph(), scene, seed=7, together=True)
    loaded = make_graph()
    loaded.add_load()
    second = record(loaded, scene, seed=7, together=False)
    other = record(make_graph(), scene, seed=8, together=True)
    assert len(first) == 2 * (PERIODS + 1) + PERIODS // 5 + 1 + PERIODS // 10 + 1
    assert first.keys() == second.keys()
    differ = sorted((key[1], key[0]) for key, text in first.items() if text != second[key])
    assert differ[:3] == []
    assert first != other
    assert 'kind=2' in ''.join(first.values())  # contacts with the edge of the step


def test_each_state_is_published_once_and_the_clock_advances(graph):
    states, clocks = [], []
    graph.subscribe('joint_states', JointState, callback=states.append)
    graph.subscribe('/clock', Clock, callback=clocks.append)
    graph.start('controller')
    graph.start('simulator', scene='flat', lockstep=True, real_time_factor=0.0,
                start_paused=True, clock_rate=250.0)
    graph.wait_until_connected(states, clocks)
    graph.wait_for_time(states, graph.step(300))
    graph.wait(lambda: to_seconds(clocks[-1].clock) >= 0.6, 'the clock has advanced')
    stamps = [to_seconds(state.header.stamp) for state in states]
    assert sorted(set(stamps)) == pytest.approx([0.002 * number for number in range(301)])
    assert stamps == sorted(stamps)
    times = [to_seconds(clock.clock) for clock in clocks]
    assert times == sorted(times)
    steps = [after - before for before, after in pairwise(times) if after > before]
    assert min(steps) > 1 / 250.0 - 1e-9


@pytest.mark.parametrize('name, parameters', [
    # Within a period of the decision: the set-point that the new controller waits for was
    # published before the controller started.
    ('controller', {'lockstep_set_point_period': 0.02}), ('obstacle_decision', {})])
def test_time_stops_without_a_node_and_continues_with_its_replacement(
        graph, scene, name, parameters):
    states = start_all(graph, scene, lockstep_timeout=0.5)['ball_state']
    graph.trigger('resume')
    graph.wait_for_time(states, 0.1)
    graph.kill(name)
    graph.wait_for_log('simulator', 'time is stopped')
    assert 'torque is 0; is the controller running?' in graph.log('simulator')
    # Messages from before the stop may arrive after the log line was read.
    graph.wait(lambda: len(states) > 3 and states[-1] == states[-3], 'the state is repeated')
    stood, before = to_seconds(states[-1].header.stamp), len(states)
    graph.wait(lambda: len(states) > before + 3, 'the state is repeated again')
    assert to_seconds(states[-1].header.stamp) == stood
    graph.start(name, **parameters)
    graph.wait_for_time(states, stood + 0.5)
    assert graph.end('simulator') == 0
    assert graph.refusals('simulator') == {}
