# SPDX-License-Identifier: Apache-2.0
"""Onboard control laws of simulator and bridge: set-points without the node controller."""
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from ballbot_ros.msg import BallState, MotorStatus, StepDecision
from ballbot_ros.ros import diagnostics, qos
from ballbot_ros.ros.conversions import to_seconds


def test_the_decision_drives_a_simulator_over_a_step_without_a_controller(graph):
    states = graph.subscribe('ball_state', BallState)
    joints = graph.subscribe('joint_states', JointState)
    decisions = graph.subscribe('step_decision', StepDecision, qos.LATCHED)
    graph.start('obstacle_decision')
    graph.wait_for_log('obstacle_decision', 'ready to decide')
    graph.start('simulator', scene='doorstep', control='onboard', start_paused=True)
    graph.wait_until_connected(states, decisions)
    graph.trigger('resume')
    graph.wait(lambda: states[-1].x > 2.2, 'the ball is over the step')
    assert StepDecision.DECISION_CROSS in {decision.decision for decision in decisions}
    stamps = [to_seconds(joint.header.stamp) for joint in joints[-50:]]
    assert abs((stamps[-1] - stamps[0]) / 49 - 0.01) < 1e-6
    assert graph.values('simulator')['law'] == 'hold'


def test_a_simulator_with_onboard_laws_obeys_the_e_stop_and_continues_on_request_only(graph):
    states = graph.subscribe('ball_state', BallState)
    wanted = graph.subscribe('set_point', JointState)
    graph.start('obstacle_decision')
    graph.start('simulator', scene='doorstep', control='onboard')
    graph.wait(lambda: states and abs(states[-1].pendulum_torque) > 0.1, 'a torque')
    latch = graph.publisher('e_stop', Bool, qos.LATCHED)
    latch.publish(Bool(data=True))
    graph.wait_for_health('obstacle_decision', diagnostics.WARN, 'the e-stop is engaged')
    graph.wait(lambda: all(state.pendulum_torque == 0.0 for state in states[-20:]), 'no torque')
    refused = graph.call('obstacle_decision/resume', Trigger)
    assert not refused.success and 'release it first' in refused.message
    latch.publish(Bool(data=False))
    graph.wait_for_health('obstacle_decision', diagnostics.WARN, 'to continue call')
    graph.wait(lambda: len(wanted) > 20, 'set-points flow')
    assert {message.position[0] for message in wanted[-10:]} == {0.0}
    answer = graph.call('obstacle_decision/resume', Trigger)
    assert answer.success, answer.message
    graph.wait(lambda: abs(wanted[-1].position[0]) > 0.05, 'the ball drives on')


def test_a_controller_obeys_the_e_stop_and_does_not_jump_at_its_release(graph):
    commands = graph.subscribe('joint_commands', JointState)
    graph.start('controller')
    # Slowly: half a second without set-points counts as rest, and this machine may be busy.
    graph.start('simulator', scene='flat', real_time_factor=0.2)
    up = graph.joint(position=[0.5])
    graph.publish_until(lambda: commands and commands[-1].effort[0] > 0.3, 'a torque',
                        'set_point', up)
    latch = graph.publisher('e_stop', Bool, qos.LATCHED)
    latch.publish(Bool(data=True))
    graph.wait_for_health('controller', diagnostics.WARN, 'the e-stop is engaged')
    # Earlier commands may still be in transit; those after the first zero are not.
    graph.publish_until(lambda: commands[-1].effort[0] == 0.0, 'the torque is zero',
                        'set_point', up)
    commands.clear()
    released = []

    def answered():
        if len(commands) > 60 and not released:
            released.append(len(commands))
            latch.publish(Bool(data=False))
        return len(commands) > 200
    graph.publish_until(answered, 'states are answered', 'set_point', up)
    assert {command.effort[0] for command in commands} == {0.0}
    graph.publish_until(lambda: graph.refusals('controller').get('e_stop'), 'refusals are counted',
                        'set_point', up)
    rest = graph.joint(position=[0.0])
    graph.publish_until(lambda: commands[-1].effort[0] > 0.3, 'after rest the motor follows again',
                        'set_point', rest, rest, *[up] * 50)


def test_a_bridge_follows_set_points_and_names_the_node_that_prevents_a_release(
        graph, motor, hardware):
    status = graph.subscribe('motor_status', MotorStatus)
    graph.start('bridge', hardware=hardware(), port=motor.path)
    graph.wait(lambda: status and status[-1].control == MotorStatus.CONTROL_ONBOARD, 'it runs')
    up, rest = graph.joint(position=[0.4]), graph.joint(position=[0.0])

    def released():
        return graph.call('bridge/release_e_stop', Trigger)
    graph.publish_until(lambda: graph.values('bridge').get('set_points_e_stop', '0') != '0',
                        'the bridge refuses them', 'set_point', up)
    answer = released()
    assert not answer.success
    assert 'set_point requests a pendulum angle of 0.4 rad (from /test)' in answer.message
    graph.spin(0.6)
    graph.publish_until(lambda: released().success, 'rest lets it be released', 'set_point', rest)
    graph.publish_until(lambda: abs(motor.torque) > 0.0 and status[-1].law == 'hold'
                        and status[-1].set_value == 0.4, 'a torque', 'set_point', up)
    assert graph.call('bridge/engage_e_stop', Trigger).success
    graph.wait(lambda: motor.torque == 0.0, 'the motor torque is zero')
