# SPDX-License-Identifier: Apache-2.0
"""Start two simulated robots in one graph, in the namespaces a and b, with a common clock."""
from pathlib import Path

from launch import LaunchDescription
from launch.actions import GroupAction, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource

# Whether a robot publishes /clock; the other one follows it.
ROBOTS = {'a': 'true', 'b': 'false'}


def generate_launch_description():
    """Include robot.launch.py, which declares the arguments, once for each robot."""
    robot = PythonLaunchDescriptionSource(str(Path(__file__).parent / 'robot.launch.py'))
    return LaunchDescription([
        GroupAction([IncludeLaunchDescription(robot, launch_arguments={
            'namespace': name, 'frame_prefix': f'{name}/', 'publish_clock': publishes,
            'target': 'sim'}.items())])
        for name, publishes in ROBOTS.items()])
