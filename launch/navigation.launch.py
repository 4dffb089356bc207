# SPDX-License-Identifier: Apache-2.0
"""Start simulator, controller and navigator on a floor; goals are those of Nav2 and RViz."""
from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource

from ballbot_ros.ros.launching import together


def start(given):
    """Return the navigator, which drives."""
    return [given.node('navigator', {
        'use_sim_time': True, 'robot': given.robot(real=False), 'floor': given['floor'],
        'learned': given['learned'], 'odom_frame': given['frame_prefix'] + 'odom'})]


def generate_launch_description():
    """Include sim.launch.py, which also declares the arguments, and add the navigator."""
    # Included by path, so that `ros2 launch --show-args` also lists its arguments.
    simulation = PythonLaunchDescriptionSource(str(Path(__file__).parent / 'sim.launch.py'))
    return LaunchDescription([
        DeclareLaunchArgument(
            'floor', default_value='apartment',
            description='Name of a floor in config/floors, or the path of a YAML file'),
        DeclareLaunchArgument(
            'learned', default_value='',
            description='File for learned data of the floor; empty for none'),
        IncludeLaunchDescription(simulation), together(start)])
