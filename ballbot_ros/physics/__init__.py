# SPDX-License-Identifier: Apache-2.0
"""
The ball robot as a mechanical system, importable without ROS.

    >>> from ballbot_ros.physics import load_scene
    >>> trajectory = load_scene('fig7_top').simulate()
    >>> bool(trajectory['x'][-1] > 1.0)
    True
"""
from ballbot_ros.physics.actuation import Actuation as Actuation
from ballbot_ros.physics.crossing import crosses as crosses
from ballbot_ros.physics.crossing import held_at as held_at
from ballbot_ros.physics.crossing import highest_step as highest_step
from ballbot_ros.physics.model import Model as Model
from ballbot_ros.physics.model import Solver as Solver
from ballbot_ros.physics.model import State as State
from ballbot_ros.physics.options import ContactOptions as ContactOptions
from ballbot_ros.physics.robot import load_robot as load_robot
from ballbot_ros.physics.robot import Robot as Robot
from ballbot_ros.physics.scene import load_scene as load_scene
from ballbot_ros.physics.scene import Scene as Scene
from ballbot_ros.physics.simulation import simulate as simulate
from ballbot_ros.physics.terrain import Terrain as Terrain
from ballbot_ros.physics.trajectory import Trajectory as Trajectory
