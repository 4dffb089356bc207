# SPDX-License-Identifier: Apache-2.0
"""Invalid messages are refused, counted by reason, and without effect."""
from itertools import cycle
import math

from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
import pytest
from sensor_msgs.msg import JointState

from ballbot_ros.msg import BallState, StepDecision, StepObservation
from ballbot_ros.ros import diagnostics, qos
from ballbot_ros.ros.conversions import to_seconds, to_time

NAN, INF = math.nan, math.inf


def publish_until_counted(graph, name, topic, **messages):
    """Publish one bad message per reason until the node has counted each reason."""
    wanted = {reason.rstrip('_0123456789') for reason in messages}
    graph.publish_until(lambda: wanted <= set(graph.refusals(name)), f'{name} counts {wanted}',
                        topic, *messages.values())
    assert set(graph.refusals(name)) == wanted


def test_bad_commands_are_counted_and_do_not_move_the_robot(graph):
    states = graph.subscribe('ball_state', BallState)
    graph.start('simulator', scene='flat', start_paused=True)
    graph.wait_until_connected(states)
    now = graph.step(100)
    publish_until_counted(
        graph, 'simulator', 'joint_commands',
        not_finite_1=graph.joint(effort=[NAN], stamp=now),
        not_finite_2=graph.joint(effort=[INF], stamp=now),
        not_finite_3=graph.joint(effort=[-INF], stamp=now),
        stale_1=graph.joint(effort=[3.0], stamp=now - 0.11),
        stale_2=graph.joint(effort=[3.0]),
        from_the_future=graph.joint(effort=[3.0], stamp=1.8e9),
        wrong_length_1=graph.joint(effort=[3.0, 3.0], stamp=now),
        wrong_length_2=graph.joint(stamp=now),
        unknown_joint=graph.joint(effort=[3.0], stamp=now, name=['pendlum']),
        unsupported_1=graph.joint(position=[1.0], stamp=now),
        unsupported_2=graph.joint(velocity=[1.0], effort=[3.0], stamp=now))
    values = graph.values('simulator')
    assert values['commands_accepted'] == '0'
    assert int(values['commands_refused']) == sum(graph.refusals('simulator').values())
    graph.wait_for_health('simulator', diagnostics.OK, 'paused')
    graph.trigger('resume')
    graph.wait_for_health('simulator', diagnostics.WARN, 'commands were refused')
    log = graph.log('simulator')
    assert 'command refused: ' in log and 'Traceback' not in log
    assert {state.pendulum_torque for state in states} == {0.0}
    assert max(abs(state.pendulum_angle) for state in states) < 1e-9
    graph.publish_until(lambda: states[-1].pendulum_torque == 0.125, 'a good command is followed',
                        'joint_commands', lambda: graph.joint(
                            effort=[0.125], stamp=to_seconds(states[-1].header.stamp)))


def test_a_command_older_than_the_last_is_out_of_order(graph):
    states = graph.subscribe('ball_state', BallState)
    graph.start('simulator', scene='flat', start_paused=True)
    graph.wait_until_connected(states)
    now = graph.step(100)
    graph.publish_until(lambda: graph.values('simulator').get('commands_accepted', '0') != '0',
                        'a command is accepted', 'joint_commands',
                        graph.joint(effort=[0.5], stamp=now))
    publish_until_counted(graph, 'simulator', 'joint_commands',
                          out_of_order=graph.joint(effort=[-0.5], stamp=now - 0.002))
    graph.wait_for_time(states, graph.step(10))
    assert states[-1].pendulum_torque == 0.5


def test_bad_set_points_and_readings_leave_the_torque_unchanged(graph):
    commands = graph.subscribe('joint_commands', JointState)
    graph.start('controller', set_point_timeout=0.0)
    state = dict(name=['shell', 'pendulum'], velocity=[0.0, 0.0])
    good = [graph.joint(position=[0.0, 0.0], stamp=0.002 * number, **state)
            for number in range(1, 400)]
    stamps = cycle(good)
    graph.publish_until(lambda: commands, 'the controller answers', 'joint_states', next(stamps))
    graph.publisher('set_point')
    publish_until_counted(
        graph, 'controller', 'set_point',
        not_finite_1=graph.joint(position=[NAN]),
        not_finite_2=graph.joint(position=[INF]),
        not_finite_3=graph.joint(velocity=[-INF]),
        contradictory=graph.joint(position=[1.0], velocity=[1.0]),
        wrong_length=graph.joint(position=[1.0, 1.0]),
        unknown_joint=graph.joint(position=[1.0], name=['shell']),
        from_the_future=graph.joint(position=[1.0], stamp=1.8e9))
    twist = TwistStamped()
    twist.twist.linear.x = NAN
    before = graph.refusals('controller')['not_finite']
    graph.publish_until(lambda: graph.refusals('controller')['not_finite'] > before + 5,
                        'a speed that is NaN is counted', 'cmd_vel', twist)
    before = graph.refusals('controller')['not_finite']
    bad = [graph.joint(position=[0.0, NAN], stamp=0.5, **state),
           graph.joint(position=[INF, 0.0], stamp=0.5, **state)]
    graph.publish_until(lambda: graph.refusals('controller')['not_finite'] > before + 5,
                        'readings are counted', 'joint_states', *bad)
    assert graph.values('controller')['mode'] == 'idle'
    assert {command.effort[0] for command in commands} == {0.0}
    assert 'Traceback' not in graph.log('controller')
    graph.publish_until(lambda: graph.values('controller')['mode'] == 'hold',
                        'a valid one is accepted', 'set_point', graph.joint(position=[0.5]))


def odometry(stamp, x=0.0, speed=0.2):
    message = Odometry()
    message.header.stamp = to_time(stamp)
    message.pose.pose.position.x = x
    message.twist.twist.linear.x = speed
    return message


def observation_at(stamp, **changes):
    fields = {'detected': True, 'distance': 1.4, 'height': 0.015, 'distance_sd': 0.01,
              'height_sd': 0.001, **changes}
    message = StepObservation(**fields)
    message.header.stamp = to_time(stamp)
    return message


BAD = {
    'distance is NaN': ({'distance': NAN}, StepDecision.REASON_BAD_OBSERVATION),
    'height is infinite': ({'height': INF}, StepDecision.REASON_BAD_OBSERVATION),
    'distance is negative': ({'distance': -0.1}, StepDecision.REASON_BAD_OBSERVATION),
    'deviation is negative': ({'height_sd': -0.001}, StepDecision.REASON_BAD_OBSERVATION),
    'deviation is NaN': ({'distance_sd': NAN}, StepDecision.REASON_BAD_OBSERVATION),
    'step that changes': ({'height': 0.06}, StepDecision.REASON_CONTRADICTORY),
    'height of nothing': ({'detected': False}, StepDecision.REASON_CONTRADICTORY),
}


@pytest.mark.parametrize('planner, good_reason', [
    ('cubic', StepDecision.REASON_WITHIN_CURVE), ('rollout', StepDecision.REASON_LIKELY)])
def test_bad_observations_stop_the_robot_with_their_reason(graph, planner, good_reason):
    decisions = graph.subscribe('step_decision', StepDecision, qos.LATCHED)
    points = graph.subscribe('set_point', JointState)
    graph.start('obstacle_decision', planner=planner, unseen_room=1.0)
    observations = graph.publisher('step_observation', StepObservation)
    motions = graph.publisher('odom', Odometry)
    stamp = 0.0

    def ask(observation=None, **motion):
        """Return decision and set angle after one observation, or after none."""
        nonlocal stamp
        stamp += 0.02 if observation is not None else 0.7
        motions.publish(odometry(stamp, **motion))
        if observation is not None:
            observations.publish(observation_at(stamp, **observation))
        for messages in (decisions, points):
            graph.wait(lambda got=messages: got and got[-1].header.stamp == to_time(stamp),
                       f'a decision at {stamp} s')
        return decisions[-1].decision, decisions[-1].reason, points[-1].position[0]

    def approve():
        """Call `ask` until the search for plans has ended, which takes several decisions."""
        answers = []
        while good not in answers:
            answers.append(ask({})[:2])
            assert len(answers) < 100, answers[-1]

    graph.wait(lambda: graph.node.count_publishers('step_decision')
               and graph.node.count_publishers('set_point'), 'the decision publishes')
    good = StepDecision.DECISION_CROSS, good_reason
    approve()
    for name, (change, reason) in BAD.items():
        for _ in range(3):  # one or two refused observations count as missing
            decision, why, angle = ask(change)
        assert (decision, why) == (StepDecision.DECISION_STOP, reason), name
        assert angle < 0.0, name  # braking
        assert decisions[-1].speed == 0.0 and decisions[-1].explanation
        approve()
    for _ in range(3):  # before the mapped one
        decision = ask({'distance': 0.7, 'height': 0.031})[0]
    assert decision != StepDecision.DECISION_CROSS and decisions[-1].distance < 0.8
    approve()
    assert ask({}, speed=NAN) == (
        StepDecision.DECISION_STOP, StepDecision.REASON_BAD_OBSERVATION, 0.0)
    assert ask({}, x=INF)[:2] == (StepDecision.DECISION_STOP, StepDecision.REASON_BAD_OBSERVATION)
    approve()
    # Odometry continues, observations stop.
    assert ask()[:2] == (StepDecision.DECISION_STOP, StepDecision.REASON_STALE)
    graph.wait_for_health('obstacle_decision', diagnostics.WARN)
    assert graph.end('obstacle_decision') == 0
    assert 'Traceback' not in graph.log('obstacle_decision')
