# SPDX-License-Identifier: Apache-2.0
"""Start the whole loop: simulator, controller, and the decision what to do about a step."""
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, GroupAction, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, ThisLaunchFileDir
from launch_ros.actions import Node, SetParameter
from launch_ros.parameter_descriptions import ParameterValue


def generate_launch_description():
    """Include sim.launch.py, whose arguments pass through, and add the decision."""
    return LaunchDescription([
        DeclareLaunchArgument(
            'robot', default_value='gimball',
            description='Name of a robot in config/robots, or the path of a YAML file'),
        IncludeLaunchDescription(PythonLaunchDescriptionSource(
            PathJoinSubstitution([ThisLaunchFileDir(), 'sim.launch.py']))),
        GroupAction([
            SetParameter(name='use_sim_time', value=True),
            Node(package='ballbot_ros', executable='obstacle_decision', output='screen',
                 parameters=[{'robot': ParameterValue(LaunchConfiguration('robot'),
                                                      value_type=str)}]),
        ]),
    ])
