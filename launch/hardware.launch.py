# SPDX-License-Identifier: Apache-2.0
"""Start the bridge to a real motor, with the laws that drive it on board, and an IMU."""
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import EqualsSubstitution, LaunchConfiguration, NotEqualsSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

ARGUMENTS = (
    ('robot', 'gimball', 'Name of a robot in config/robots, or the path of a YAML file'),
    ('hardware', 'gimball_odrive',
     'Name of a hardware file in config/hardware, or the path of a YAML file'),
    ('port', '', 'Serial device, URL or CAN interface; empty takes that of the hardware file'),
    ('tuning', 'gentle', 'Gains: name of a tuning in config/tunings, or the path of a YAML file'),
    ('control', 'onboard',
     'Where the laws run: onboard in the bridge, direct in a node controller beside it'),
    ('imu_port', '',
     'Serial device of a WitMotion sensor; empty where another node publishes imu'),
    ('imu_axes', 'x y z', 'Which of its axes point forward, left and up'),
    ('rate', '500.0', 'In direct control: loop_rate of the hardware file, for the controller'),
)


def value(name, type_):
    """Return a launch argument as a parameter of the given type."""
    return ParameterValue(LaunchConfiguration(name), value_type=type_)


def generate_launch_description():
    """Declare the arguments and start the bridge; real motors go by real time."""
    return LaunchDescription([
        *(DeclareLaunchArgument(name, default_value=default, description=text)
          for name, default, text in ARGUMENTS),
        Node(package='ballbot_ros', executable='bridge', output='screen',
             parameters=[{'hardware': value('hardware', str), 'port': value('port', str),
                          'tuning': value('tuning', str),
                          'control': value('control', str)}]),
        Node(package='ballbot_ros', executable='controller', output='screen',
             condition=IfCondition(EqualsSubstitution(LaunchConfiguration('control'), 'direct')),
             parameters=[{'robot': value('robot', str), 'tuning': value('tuning', str),
                          'rate': value('rate', float), 'delay': 1}]),
        Node(package='ballbot_ros', executable='imu', output='screen',
             condition=IfCondition(NotEqualsSubstitution(LaunchConfiguration('imu_port'), '')),
             parameters=[{'port': value('imu_port', str), 'axes': value('imu_axes', str)}]),
    ])
