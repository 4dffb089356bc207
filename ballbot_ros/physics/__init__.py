# SPDX-License-Identifier: Apache-2.0
"""
The ball robot as a mechanical system, importable without ROS.

    >>> from ballbot_ros.physics import load_scene
    >>> trajectory = load_scene('fig7_top').simulate()
    >>> bool(trajectory['x'][-1] > 1.0)
    True
"""
from ballbot_ros.physics.actuation import Actuation
from ballbot_ros.physics.crossing import crosses, held_at, highest_step, Rules, Site
from ballbot_ros.physics.max_step import (
    cruising, drive_for, max_step, max_steps, MaxStep, rolling, try_step)
from ballbot_ros.physics.model import Model, Solver, State
from ballbot_ros.physics.options import ContactOptions
from ballbot_ros.physics.robot import load_robot, Robot
from ballbot_ros.physics.scene import load_scene, Scene
from ballbot_ros.physics.simulation import simulate
from ballbot_ros.physics.terrain import Terrain
from ballbot_ros.physics.trajectory import Trajectory

__all__ = [
    'Actuation', 'ContactOptions', 'crosses', 'cruising', 'drive_for', 'held_at',
    'highest_step', 'load_robot', 'load_scene', 'max_step', 'max_steps', 'MaxStep', 'Model',
    'Robot', 'rolling', 'Rules', 'Scene', 'simulate', 'Site', 'Solver', 'State', 'Terrain',
    'Trajectory', 'try_step']
