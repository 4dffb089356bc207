# SPDX-License-Identifier: Apache-2.0
"""Record the topics of a robot into an MCAP bag with ros2 bag."""
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction
from launch.substitutions import LaunchConfiguration

from ballbot_ros.ros.topics import TOPICS

ARGUMENTS = (
    ('bag', 'ballbot_bag', 'Folder to record into; it must not exist yet'),
    ('namespace', '', 'Namespace of the robot'),
    ('use_sim_time', 'false', 'true: stamp with /clock of a running simulator'),
)


def record(context):
    """Return the recorder; it adds topics when their publishers appear."""
    bag, namespace, simulated = (
        LaunchConfiguration(name).perform(context) for name, *_ in ARGUMENTS)
    inside = f'/{namespace.strip("/")}/' if namespace.strip('/') else '/'
    topics = [name if name.startswith('/') else inside + name for name in TOPICS]
    return [ExecuteProcess(output='screen', cmd=[
        'ros2', 'bag', 'record', '--storage', 'mcap', '--output', bag,
        *(['--use-sim-time'] if simulated == 'true' else []), '--topics', *topics])]


def generate_launch_description():
    """Declare the arguments and start the recorder."""
    return LaunchDescription([
        *(DeclareLaunchArgument(name, default_value=default, description=text)
          for name, default, text in ARGUMENTS),
        OpaqueFunction(function=record)])
