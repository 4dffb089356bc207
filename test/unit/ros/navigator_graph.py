# SPDX-License-Identifier: Apache-2.0
"""The node ``navigator`` with a client and a robot that follows cmd_vel exactly."""
import math
import time

from geometry_msgs.msg import PoseStamped, TransformStamped, TwistStamped
from nav_msgs.msg import Odometry, Path
import rclpy
from rclpy.action import ActionClient
from rclpy.parameter import Parameter
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Bool
from tf2_msgs.msg import TFMessage

from ballbot_ros.nodes.navigator.goals import ComputePathToPose, NavigateToPose
from ballbot_ros.nodes.navigator.node import NavigatorNode
from ballbot_ros.nodes.navigator.outputs import stamped_pose
from ballbot_ros.ros import qos
from ballbot_ros.ros.conversions import to_time
from ballbot_ros.ros.rclpy_compat import new_executor

START = (1.7, 1.4, 0.0)


class Graph:
    """The node, a client, and a robot that follows cmd_vel exactly."""

    def __init__(self, context, **parameters):
        self.node = NavigatorNode(context=context, parameter_overrides=[
            Parameter(name, value=value) for name, value in {
                'localized': False, **parameters}.items()])
        self.client = rclpy.create_node('client', context=context)
        self.executor = new_executor(context)
        for node in (self.node, self.client):
            self.executor.add_node(node)
        self.navigate = ActionClient(self.client, NavigateToPose, 'navigate_to_pose')
        self.compute = ActionClient(self.client, ComputePathToPose, 'compute_path_to_pose')
        self.odometry = self.client.create_publisher(Odometry, 'odom', 10)
        self.goals = self.client.create_publisher(PoseStamped, 'goal_pose', 1)
        self.e_stops = self.client.create_publisher(Bool, 'e_stop', 1)
        self.scans = self.client.create_publisher(LaserScan, 'scan', 5)
        self.transforms = self.client.create_publisher(TFMessage, '/tf', 5)
        self.offset = [0.0, 0.0]  # of odom in the frame map
        self.localized = True  # whether the offset is published
        self.plans, self.feedback = [], []
        self.speed, self.yaw_rate, self.time = 0.0, 0.0, 1.0
        self.pose = list(START)
        self.frames = {'odom': 'odom', 'scan': 'base_link'}
        self.turn = None  # orientation in odom in place of the heading
        self.client.create_subscription(TwistStamped, 'cmd_vel', self.on_speed, 10)
        self.client.create_subscription(Path, 'plan', self.plans.append, qos.LATCHED)

    def on_speed(self, message):
        self.speed, self.yaw_rate = message.twist.linear.x, message.twist.angular.z

    def spin(self, seconds, until=lambda: False):
        """Move the robot, publish its odometry, and process the callbacks."""
        end = time.monotonic() + seconds
        while time.monotonic() < end and not until():
            x, y, heading = self.pose
            self.pose = [x + 0.02 * self.speed * math.cos(heading),
                         y + 0.02 * self.speed * math.sin(heading),
                         heading + 0.02 * self.yaw_rate]
            self.time += 0.02
            message = Odometry(child_frame_id='base_link')
            message.header.frame_id = self.frames['odom']
            message.header.stamp = to_time(self.time)
            message.pose.pose = stamped_pose('odom', to_time(0.0), *self.pose).pose
            if self.turn is not None:
                message.pose.pose.orientation = self.turn
            message.twist.twist.linear.x = self.speed
            transform = TransformStamped(child_frame_id='odom')
            transform.header.frame_id, transform.header.stamp = 'map', message.header.stamp
            transform.transform.translation.x, transform.transform.translation.y = self.offset
            if self.localized:
                self.transforms.publish(TFMessage(transforms=[transform]))
            self.odometry.publish(message)
            for _ in range(4):
                self.executor.spin_once(timeout_sec=0.002)
        return until()

    def wait(self, future, seconds=30.0):
        assert self.spin(seconds, future.done)
        return future.result()

    def mount(self, parent, child, place, turn):
        """Publish a static transform, each by a publisher of its own."""
        transform = TransformStamped(child_frame_id=child)
        transform.header.frame_id, transform.transform.rotation = parent, turn
        move = transform.transform.translation
        move.x, move.y, move.z = place
        self.client.create_publisher(TFMessage, '/tf_static', qos.LATCHED).publish(
            TFMessage(transforms=[transform]))

    def scan(self, age, *ranges, increment=0.01):
        """Publish a scan that begins straight ahead."""
        message = LaserScan(ranges=ranges, range_max=8.0, angle_increment=increment)
        message.header.frame_id = self.frames['scan']
        message.header.stamp = to_time(self.time - age)
        self.scans.publish(message)

    def send(self, x, y, heading=0.0, frame='map'):
        goal = NavigateToPose.Goal(pose=stamped_pose(frame, to_time(0.0), x, y, heading))
        return self.wait(self.navigate.send_goal_async(
            goal, feedback_callback=lambda one: self.feedback.append(one.feedback)))

    def fails(self, handle):
        """Return the reason why an accepted goal fails, once the ball is at rest."""
        result = self.wait(handle.get_result_async(), 60.0).result
        assert self.spin(5.0, lambda: self.speed == 0.0) and len(result.error_msg) > 20
        return result.error_msg.split(':')[0]

    def close(self):
        self.executor.shutdown()
        for node in (self.node, self.client):
            node.destroy_node()
