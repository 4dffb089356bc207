# SPDX-License-Identifier: Apache-2.0
"""
The ball robot as a mechanical system, importable without ROS; the public interface, with examples.

A `Scene` that comes with the package, and the `Trajectory` of its run:

    >>> scene = load_scene('fig7_top')
    >>> isinstance(scene, Scene)
    True
    >>> run = scene.simulate()
    >>> isinstance(run, Trajectory), bool(run['x'][-1] > 1.0)
    (True, True)

A `Robot` on a ground, with a contact law and a solver, is a `Model`:

    >>> robot = load_robot('gimball')
    >>> isinstance(robot, Robot), robot.total_mass
    (True, 5.4)
    >>> model = Model(robot, Terrain.step(0.02, at=0.5), ContactOptions(friction_ramp='smooth'),
    ...               Solver('adaptive', tolerance=1e-8))

It maps a `State` to a later one:

    >>> start = model.at_rest(x=0.0, speed=0.8, pendulum_angle=0.3)
    >>> isinstance(start, State), start.velocity_x
    (True, 0.8)
    >>> run = simulate(model, start, Actuation('position', set_angle=0.3), duration=1.0)
    >>> bool(run['x'][-1] > 0.5)
    True

and returns energies and contacts of a state:

    >>> energies = model.energies(start)
    >>> isinstance(energies, Energies), energies.kinetic > energies.contact > 0.0
    (True, True)
    >>> [touch] = model.touches(start)
    >>> isinstance(touch, Touch), abs(touch.normal_force / robot.weight - 1.0) < 1e-9
    (True, True)
"""
from ballbot_ros.physics.model.actuation import Actuation
from ballbot_ros.physics.model.robot import ContactOptions, load_robot, Robot
from ballbot_ros.physics.model.state import Energies, State, Touch
from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.physics.simulation.model import Model
from ballbot_ros.physics.simulation.run import simulate
from ballbot_ros.physics.simulation.scene import load_scene, Scene
from ballbot_ros.physics.simulation.solver import Solver
from ballbot_ros.physics.simulation.trajectory import Trajectory

__all__ = [
    'Actuation', 'ContactOptions', 'Energies', 'load_robot', 'load_scene', 'Model', 'Robot',
    'Scene', 'simulate', 'Solver', 'State', 'Terrain', 'Touch', 'Trajectory']
