# SPDX-License-Identifier: Apache-2.0
"""The topics of the nodes with their types: what is recorded and shown; importable without ROS."""
from types import MappingProxyType
from typing import Mapping

# Those with a slash before them are the same in every namespace.
TOPICS: Mapping[str, str] = MappingProxyType({
    '/clock': 'rosgraph_msgs/msg/Clock',
    '/tf': 'tf2_msgs/msg/TFMessage',
    '/tf_static': 'tf2_msgs/msg/TFMessage',
    '/diagnostics': 'diagnostic_msgs/msg/DiagnosticArray',
    'robot_description': 'std_msgs/msg/String',
    'joint_states': 'sensor_msgs/msg/JointState',
    'joint_commands': 'sensor_msgs/msg/JointState',
    'set_point': 'sensor_msgs/msg/JointState',
    'cmd_vel': 'geometry_msgs/msg/TwistStamped',
    'e_stop': 'std_msgs/msg/Bool',
    'odom': 'nav_msgs/msg/Odometry',
    'imu': 'sensor_msgs/msg/Imu',
    'ball_state': 'ballbot_ros/msg/BallState',
    'step_observation': 'ballbot_ros/msg/StepObservation',
    'terrain_observation': 'ballbot_ros/msg/TerrainObservation',
    'step_decision': 'ballbot_ros/msg/StepDecision',
    'motor_status': 'ballbot_ros/msg/MotorStatus',
    'battery_state': 'sensor_msgs/msg/BatteryState',
    'markers': 'visualization_msgs/msg/MarkerArray'})
