# SPDX-License-Identifier: Apache-2.0
"""Start the simulator and the controller: a ball robot that follows its goals in simulation."""
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, GroupAction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node, SetParameter
from launch_ros.parameter_descriptions import ParameterValue

ARGUMENTS = (
    ('robot', 'gimball', 'Name of a robot in config/robots, or the path of a YAML file'),
    ('scene', 'doorstep', 'Name of a scene in config/scenes, or the path of a YAML file'),
    ('lockstep', 'false', 'true: each period waits for its command, so that a run is repeatable'),
    ('terrain_rate', '50.0', 'How often the ground ahead is seen as a polyline [Hz]; 0: not'),
    ('observation_rate', '0.0', 'How often the next step is seen by a simple sensor [Hz]; 0: not'),
    ('real_time_factor', '1.0', 'Simulated seconds per second; 0 means as fast as possible'),
)


def value(name, type_):
    """Return a launch argument as a parameter of the given type."""
    return ParameterValue(LaunchConfiguration(name), value_type=type_)


def generate_launch_description():
    """Declare the arguments and start both nodes."""
    # The simulator makes the time that the others go by, so it must not wait for it.
    simulator = Node(
        package='ballbot_ros', executable='simulator', output='screen',
        parameters=[{
            'use_sim_time': False,
            'robot': value('robot', str),
            'scene': value('scene', str),
            'lockstep': value('lockstep', bool),
            'terrain_rate': value('terrain_rate', float),
            'observation_rate': value('observation_rate', float),
            'real_time_factor': value('real_time_factor', float),
        }])
    followers = GroupAction([
        SetParameter(name='use_sim_time', value=True),
        Node(package='ballbot_ros', executable='controller', output='screen',
             parameters=[{'robot': value('robot', str)}]),
    ])
    return LaunchDescription([
        *(DeclareLaunchArgument(name, default_value=default, description=text)
          for name, default, text in ARGUMENTS),
        simulator,
        followers,
    ])
