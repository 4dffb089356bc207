# SPDX-License-Identifier: Apache-2.0
"""Start the bridge to a real motor and the controller that drives it."""
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

ARGUMENTS = (
    ('robot', 'gimball', 'Name of a robot in config/robots, or the path of a YAML file'),
    ('hardware', 'gimball_odrive',
     'Name of a hardware file in config/hardware, or the path of a YAML file'),
    ('port', '', 'Serial device or URL; empty takes that of the hardware file'),
    ('tuning', 'gentle', 'Gains: name of a tuning in config/tunings, or the path of a YAML file'),
    ('rate', '500.0', 'loop_rate of the hardware file, which the controller checks its gains for'),
)


def value(name, type_):
    """Return a launch argument as a parameter of the given type."""
    return ParameterValue(LaunchConfiguration(name), value_type=type_)


def generate_launch_description():
    """Declare the arguments and start both nodes; real motors go by real time."""
    return LaunchDescription([
        *(DeclareLaunchArgument(name, default_value=default, description=text)
          for name, default, text in ARGUMENTS),
        Node(package='ballbot_ros', executable='bridge', output='screen',
             parameters=[{'hardware': value('hardware', str), 'port': value('port', str),
                          'tuning': value('tuning', str)}]),
        Node(package='ballbot_ros', executable='controller', output='screen',
             parameters=[{'robot': value('robot', str), 'tuning': value('tuning', str),
                          'rate': value('rate', float), 'delay': 1}]),
    ])
