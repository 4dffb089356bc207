# SPDX-License-Identifier: Apache-2.0
"""Simulator, controller and navigator as processes, in lockstep: goals of the action."""
import math

from action_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.msg import Odometry
import pytest
from rclpy.action import ActionClient

from ballbot_ros.nodes.navigator.goals import NavigateToPose
from ballbot_ros.nodes.navigator.node import PERIOD
from ballbot_ros.nodes.navigator.outputs import stamped_pose
from ballbot_ros.ros.conversions import to_time

START = 1.7, 1.4  # origin of odom on the map; the ball faces +x
RESTING = 0.03  # [m/s]


class Robot:
    """Three nodes, and a client of the navigator."""

    def __init__(self, graph):
        self.graph = graph
        self.odometry = graph.subscribe('odom', Odometry)
        self.client = ActionClient(graph.node, NavigateToPose, 'navigate_to_pose')
        graph.start('controller', lockstep_set_point_period=PERIOD)
        graph.start('navigator', floor='apartment')
        graph.start('simulator', floor='apartment', start=f'{START[0]},{START[1]},0',
                    lockstep=True, real_time_factor=0.0)
        graph.wait(self.client.server_is_ready, 'the action is served')
        graph.wait_for_health('navigator', DiagnosticStatus.OK)

    @property
    def place(self):
        """Return the position on the map [m]."""
        there = self.odometry[-1].pose.pose.position
        return START[0] + there.x, START[1] + there.y

    @property
    def speed(self):
        return abs(self.odometry[-1].twist.twist.linear.x)

    def send(self, x, y, frame='map'):
        """Send a goal and return its handle."""
        sent = self.client.send_goal_async(NavigateToPose.Goal(
            pose=stamped_pose(frame, to_time(0.0), x, y, 0.0)))
        self.graph.wait(sent.done, 'the goal is answered')
        return sent.result()

    def drive(self):
        """Wait until the ball moves."""
        self.graph.wait(lambda: self.odometry and self.speed > 0.1, 'the ball drives')

    def result(self, handle):
        """
        Wait until a goal has ended and the ball rests; return status and result.

        The result arrives before odom.  Without a goal time is stopped, so that a ball that is
        not at rest by then never comes to rest.
        """
        got = handle.get_result_async()
        self.graph.wait(got.done, 'the goal has ended', timeout=240.0)
        self.graph.wait(lambda: self.speed < RESTING, 'the ball rests')
        return got.result().status, got.result().result


@pytest.mark.slow
def test_goals_are_refused_while_time_is_stopped_then_preempted_and_canceled(graph):
    robot = Robot(graph)
    refused = {'off_map': (99.0, 1.4), 'wall': (0.05, 3.0), 'not_finite': (math.nan, 1.4),
               'feature': (2.9, 3.4)}
    for goal in refused.values():
        assert not robot.send(*goal).accepted
    assert not robot.send(2.6, 1.4, frame='odom').accepted
    graph.wait(lambda: graph.refusals('navigator') == dict.fromkeys(
        (*refused, 'wrong_frame'), 1), 'the reasons are on /diagnostics')
    assert {(one.header.stamp.sec, one.header.stamp.nanosec) for one in robot.odometry} == {(0, 0)}

    old = robot.send(2.7, 1.4)
    robot.drive()
    new = robot.send(2.0, 1.4)
    ended = old.get_result_async()
    graph.wait(ended.done, 'the old goal has ended')
    status, result = ended.result().status, ended.result().result
    assert status == GoalStatus.STATUS_ABORTED and result.error_msg.startswith('preempted')
    status, result = robot.result(new)
    assert status == GoalStatus.STATUS_SUCCEEDED, result.error_msg
    assert math.dist(robot.place, (2.0, 1.4)) < 0.2

    last = robot.send(2.9, 1.4)
    robot.drive()
    last.cancel_goal_async()
    status, result = robot.result(last)
    assert status == GoalStatus.STATUS_CANCELED and result.error_msg.startswith('canceled')
    assert math.dist(robot.place, (2.9, 1.4)) > 0.2
