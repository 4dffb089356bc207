# SPDX-License-Identifier: Apache-2.0
"""Start the whole loop: simulator, controller, and the decision what to do about a step."""
from pathlib import Path

from launch import LaunchDescription
from launch.actions import GroupAction, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node, SetParameter
from launch_ros.parameter_descriptions import ParameterValue


def generate_launch_description():
    """Include sim.launch.py, which also declares the arguments, and add the decision."""
    # By its path, so that `ros2 launch --show-args` sees its arguments too.
    simulation = PythonLaunchDescriptionSource(str(Path(__file__).parent / 'sim.launch.py'))
    return LaunchDescription([
        IncludeLaunchDescription(simulation),
        GroupAction([
            SetParameter(name='use_sim_time', value=True),
            Node(package='ballbot_ros', executable='obstacle_decision', output='screen',
                 parameters=[{'robot': ParameterValue(LaunchConfiguration('robot'),
                                                      value_type=str)}]),
        ]),
    ])
