# SPDX-License-Identifier: Apache-2.0
"""
The ball robot as a mechanical system, importable without ROS.

    >>> from ballbot_ros.physics import load_scene
    >>> trajectory = load_scene('fig7_top').simulate()
    >>> bool(trajectory['x'][-1] > 1.0)
    True
"""
from ballbot_ros.physics.model.actuation import Actuation
from ballbot_ros.physics.model.contact_options import ContactOptions
from ballbot_ros.physics.model.robot import load_robot, Robot
from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.physics.simulation.model import Model, Solver, State
from ballbot_ros.physics.simulation.scene import load_scene, Scene
from ballbot_ros.physics.simulation.simulate import simulate
from ballbot_ros.physics.simulation.trajectory import Trajectory
from ballbot_ros.renamed import refuse_old_names

__all__ = [
    'Actuation', 'ContactOptions', 'load_robot', 'load_scene', 'Model', 'Robot', 'Scene',
    'simulate', 'Solver', 'State', 'Terrain', 'Trajectory']

refuse_old_names(globals())
