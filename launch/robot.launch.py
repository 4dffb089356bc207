# SPDX-License-Identifier: Apache-2.0
"""Start a robot, simulated or real, with its laws on board, and the decision about steps."""
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import EqualsSubstitution, LaunchConfiguration, NotEqualsSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

ARGUMENTS = (
    ('target', 'sim', 'sim for the simulator, hardware for the bridge to a real motor'),
    ('robot', 'gimball', 'Name of a robot in config/robots, or the path of a YAML file'),
    ('tuning', 'gentle', 'Gains: name of a tuning in config/tunings, or the path of a YAML file'),
    ('decision', 'true', 'Start obstacle_decision, which drives; false to drive by cmd_vel'),
    ('scene', 'doorstep', 'sim: name of a scene in config/scenes, or the path of a YAML file'),
    ('terrain_rate', '50.0', 'sim: how often the ground ahead is seen as a polyline [Hz]; 0: not'),
    ('hardware', 'gimball_odrive',
     'hardware: name of a hardware file in config/hardware, or the path of a YAML file'),
    ('port', '', 'hardware: serial device, URL or CAN interface; empty takes that of the file'),
    ('imu_port', '',
     'hardware: serial device of a WitMotion sensor; empty where another node publishes imu'),
    ('imu_axes', 'x y z', 'hardware: which of its axes point forward, left and up'),
)


def value(name, type_):
    """Return a launch argument as a parameter of the given type."""
    return ParameterValue(LaunchConfiguration(name), value_type=type_)


def target(name):
    """Return a substitution: whether that is the target."""
    return EqualsSubstitution(LaunchConfiguration('target'), name)


def generate_launch_description():
    """Declare the arguments and start the nodes; only a simulated robot makes its own time."""
    return LaunchDescription([
        *(DeclareLaunchArgument(name, default_value=default, description=text)
          for name, default, text in ARGUMENTS),
        Node(package='ballbot_ros', executable='simulator', output='screen',
             condition=IfCondition(target('sim')),
             parameters=[{'control': 'onboard', 'robot': value('robot', str),
                          'tuning': value('tuning', str), 'scene': value('scene', str),
                          'terrain_rate': value('terrain_rate', float)}]),
        Node(package='ballbot_ros', executable='bridge', output='screen',
             condition=IfCondition(target('hardware')),
             parameters=[{'control': 'onboard', 'tuning': value('tuning', str),
                          'hardware': value('hardware', str), 'port': value('port', str)}]),
        Node(package='ballbot_ros', executable='imu', output='screen',
             condition=IfCondition(NotEqualsSubstitution(LaunchConfiguration('imu_port'), '')),
             parameters=[{'port': value('imu_port', str), 'axes': value('imu_axes', str)}]),
        Node(package='ballbot_ros', executable='obstacle_decision', output='screen',
             condition=IfCondition(LaunchConfiguration('decision')),
             parameters=[{'use_sim_time': ParameterValue(target('sim'), value_type=bool),
                          'robot': value('robot', str),
                          'control_tuning': value('tuning', str)}]),
    ])
