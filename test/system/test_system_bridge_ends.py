# SPDX-License-Identifier: Apache-2.0
"""The bridge keeps running for any request from any number of clients, and reports its state."""
import re
import signal

from driving import Driving
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.node import Node
from sensor_msgs.msg import JointState

from ballbot_ros.emulator.control import obey
from ballbot_ros.msg import MotorStatus

def change(graph, transition):
    """Ask for a transition and return whether it was made."""
    return graph.call('bridge/change_state', ChangeState, again=False,
                      transition=Transition(id=transition)).success


def test_transitions_that_are_not_possible_are_answered_and_end_nothing(graph, motor, hardware):
    graph.client('bridge/change_state', ChangeState)
    graph.start('bridge', hardware=hardware(), port=motor.path, autostart=False)
    for transition in (Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_CLEANUP, 99):
        assert not change(graph, transition)
    assert 'activate is not possible: the node is unconfigured' in graph.log('bridge')
    assert change(graph, Transition.TRANSITION_CONFIGURE)
    assert not change(graph, Transition.TRANSITION_CONFIGURE)
    assert change(graph, Transition.TRANSITION_ACTIVATE)
    assert change(graph, Transition.TRANSITION_ACTIVE_SHUTDOWN)
    assert not change(graph, Transition.TRANSITION_CONFIGURE)
    assert graph.end('bridge', signal.SIGINT) == 0


def test_a_requested_transition_ends_the_autostart(graph, motor, hardware):
    graph.client('bridge/change_state', ChangeState)
    obey(motor, 'unplug')
    graph.start('bridge', hardware=hardware(), port=motor.path)
    status = graph.subscribe('motor_status', MotorStatus)
    while not change(graph, Transition.TRANSITION_CONFIGURE):
        obey(motor, 'plug')  # and from now on the bridge could do it by itself
    graph.wait(lambda: status, 'the loop runs')
    graph.spin(2.5)
    assert status[-1].state == MotorStatus.STATE_E_STOP
    assert 'active;' not in graph.log('bridge')
    assert change(graph, Transition.TRANSITION_ACTIVATE)


def test_two_publishers_of_commands_are_both_refused_by_name(graph, motor, hardware):
    graph.start('bridge', hardware=hardware(), port=motor.path, control='direct')
    run = Driving(graph, motor)
    run.release()
    run.pull()
    other = Node('other', context=graph.context)
    try:
        other.create_publisher(JointState, 'joint_commands', 1)
        graph.publish_until(lambda: motor.torque == 0.0 and '/other' in graph.log('bridge'),
                            'both are refused', 'joint_commands', run.command)
        assert re.search(r'/other\b.*/test\b|/test\b.*/other\b', graph.log('bridge'))
    finally:
        other.destroy_node()
