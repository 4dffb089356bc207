# SPDX-License-Identifier: Apache-2.0
"""Nodes that die, publish too rarely or restart cause no dangerous torque."""
import re

import pytest
from sensor_msgs.msg import JointState

from ballbot_ros.msg import BallState, StepDecision
from ballbot_ros.ros import diagnostics, qos
from ballbot_ros.ros.conversions import to_seconds


def test_torque_ends_within_its_timeout_when_the_controller_is_killed(graph):
    states = graph.subscribe('ball_state', BallState)
    commands = graph.subscribe('joint_commands', JointState)
    graph.start('controller', set_point_timeout=0.0, tuning='gentle')
    graph.start('simulator', scene='flat', ball_state_rate=500.0, command_timeout=0.1)
    # A pendulum held at an angle needs a constant torque against gravity.
    graph.publish_until(lambda: commands and states and states[-1].pendulum_torque > 0.3,
                        'a torque',
                        'set_point', graph.joint(position=[0.5]))
    graph.kill('controller')
    graph.wait(lambda: states[-1].pendulum_torque == 0.0, 'the torque is zero')
    graph.wait_for_log('simulator', 'no command for 0.1 s at t =')
    assert 'torque is 0; is the controller running?' in graph.log('simulator')
    paused = float(graph.trigger('pause').split()[-2])
    graph.wait_for_time(states, paused - 1e-6)
    last = max(to_seconds(command.header.stamp) for command in commands)
    late = [to_seconds(state.header.stamp) for state in states if state.pendulum_torque != 0.0]
    # A state holds the torque of the period that ends with it.
    assert max(late) <= last + 0.1 + 0.002 + 1e-6

    graph.trigger('resume')
    graph.start('controller', set_point_timeout=0.0, tuning='gentle')
    graph.publish_until(lambda: states[-1].pendulum_torque > 0.1, 'torque of the next one',
                        'set_point', graph.joint(position=[0.5]))


def test_the_controller_commands_zero_when_the_states_stop(graph):
    commands = graph.subscribe('joint_commands', JointState)
    graph.start('controller', set_point_timeout=0.0)
    graph.start('simulator', scene='flat')
    graph.publish_until(lambda: commands and commands[-1].effort[0] > 0.3, 'a torque',
                        'set_point', graph.joint(position=[0.5]))
    graph.wait_for_time(commands, 0.5)
    assert graph.end('simulator') == 0
    graph.wait(lambda: commands[-1].effort[0] == 0.0, 'the controller commands zero')
    graph.wait_for_log('controller', 'no joint state for 0.1 s: torque is 0')
    graph.wait_for_health('controller', diagnostics.WARN, 'joint_states stopped')

    # Another simulation starts at time 0: the controller must detect it.
    graph.start('simulator', scene='flat', start_paused=True)
    while 'time went back' not in graph.log('controller'):
        graph.spin(0.1)
        graph.step(1)
    graph.trigger('resume')
    graph.publish_until(lambda: commands[-1].effort[0] > 0.3, 'the motor applies a torque again',
                        'set_point', graph.joint(position=[0.5]))


def test_states_at_a_low_rate_get_no_torque(graph):
    commands = graph.subscribe('joint_commands', JointState)
    graph.start('controller')
    graph.start('simulator', scene='flat', control_rate=200.0)
    # On a busy machine the first two received may not be consecutive: 100 Hz, 67 Hz and so on.
    (rate,) = graph.wait(lambda: re.findall(
        r'arrive at (\d+) Hz and these gains need 275 Hz', graph.log('controller'))[:1],
        'the controller reports the rate of the states')
    assert int(rate) in {round(200.0 / number) for number in range(1, 21)}
    commands.clear()
    graph.publish_until(lambda: len(commands) > 50, 'commands come', 'set_point',
                        graph.joint(position=[0.5]))
    assert {command.effort[0] for command in commands} == {0.0}
    graph.wait_for_health('controller', diagnostics.ERROR, 'rate of joint_states is too low')


@pytest.mark.slow
def test_a_decision_that_dies_during_an_approach_is_replaced_safely(graph, tmp_path):
    scene = tmp_path / 'two_steps.yaml'
    scene.write_text('robot: gimball\nterrain:\n  - flat: {length: 2.2}\n'
                     '  - step: {height: 0.031}\n  - flat: {length: 1.8}\n'
                     '  - step: {height: 0.08}\n  - flat: {length: 1.0}\nduration: 20.0\n')
    states = graph.subscribe('ball_state', BallState)
    decisions = graph.subscribe('step_decision', StepDecision, qos.LATCHED)
    graph.start('controller')
    graph.start('obstacle_decision')
    # A busy machine may lose every other state, and the controller then correctly commands zero:
    # in lockstep none is lost.  Time does not wait for the decision.
    graph.start('simulator', scene=scene, start_paused=True, lockstep=True)
    graph.wait_until_connected(states, decisions)
    graph.trigger('resume')
    graph.wait(lambda: states[-1].velocity_x > 0.2, 'the ball moves')
    graph.kill('obstacle_decision')
    graph.wait_for_log('controller', 'the pendulum is lowered')
    graph.wait(lambda: abs(states[-1].pendulum_angle) < 0.2, 'the pendulum hangs down')
    graph.trigger('pause')  # or, on a busy machine, the next one would start after the run
    decisions.clear()
    graph.start('obstacle_decision')
    graph.wait(lambda: graph.log('obstacle_decision').count('ready to decide') == 2,
               'the new decision is ready')
    # Discovery takes real time, in which the ball must not reach the step.
    graph.wait(lambda: graph.step(1) and (graph.spin(0.1) or decisions),
               'the new node publishes a decision')
    graph.trigger('resume')
    # The ball may also rest during an evaluation, before it reaches the steps.
    graph.wait(lambda: at_rest(states)
               and decisions[-1].decision == StepDecision.DECISION_GO_ROUND,
               'the ball has come to rest before the second step')

    found = [decision for decision in decisions
             if decision.reason != StepDecision.REASON_EVALUATING]
    first = [decision for decision in found if 0.0 < decision.height < 0.05]
    second = [decision for decision in found if decision.height > 0.05]
    assert first and all(decision.explanation for decision in decisions)
    for decision in first:
        if decision.reason == StepDecision.REASON_LIKELY:
            assert decision.decision == StepDecision.DECISION_CROSS
            assert decision.probability >= 0.5
        elif decision.decision == StepDecision.DECISION_CROSS:
            assert decision.reason == StepDecision.REASON_COMMITTED
    assert {decision.decision for decision in second} <= {StepDecision.DECISION_GO_ROUND}
    assert not any(abs(touch.x - 4.0) < 0.01 for state in states for touch in state.contacts)
    # The room sufficed, and the ball followed the decision.
    assert first[0].decision == StepDecision.DECISION_CROSS
    assert 2.2 < states[-1].x < 4.0 - 0.226


def at_rest(states):
    """Return whether the ball has not moved for half a second."""
    last = states[-50:]
    return len(last) == 50 and all(abs(state.velocity_x) < 0.02 for state in last)


def test_a_signal_lowers_the_pendulum_before_a_node_ends(graph):
    commands = graph.subscribe('joint_commands', JointState)
    points = graph.subscribe('set_point', JointState)
    graph.start('controller')
    graph.start('obstacle_decision')
    graph.start('simulator')
    graph.wait(lambda: commands and commands[-1].effort[0] > 0.3
               and points and points[-1].position[0] != 0.0, 'the ball is driven')
    assert graph.end('controller') == 0
    graph.wait(lambda: commands[-1].effort[0] == 0.0, 'the last command is 0')
    assert graph.end('obstacle_decision') == 0
    graph.wait(lambda: points[-1].position[0] == 0.0, 'the last set-point is 0')
