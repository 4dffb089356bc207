# SPDX-License-Identifier: Apache-2.0
"""Start the complete loop: simulator, controller and obstacle decision."""
from pathlib import Path

from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource

from ballbot_ros.ros.launching import together


def start(given):
    """Return the node obstacle_decision, which drives."""
    return [given.node('obstacle_decision', {
        'use_sim_time': True, 'robot': given.robot(real=False),
        'terrain_frame': given['frame_prefix'] + 'base_link'})]


def generate_launch_description():
    """Include sim.launch.py, which also declares the arguments, and add the decision."""
    # Included by path, so that `ros2 launch --show-args` also lists its arguments.
    simulation = PythonLaunchDescriptionSource(str(Path(__file__).parent / 'sim.launch.py'))
    return LaunchDescription([IncludeLaunchDescription(simulation), together(start)])
