# SPDX-License-Identifier: Apache-2.0
"""
A pendulum-driven ball robot: simulator, controller and obstacle decision for ROS 2.

    >>> from ballbot_ros import load_robot, load_scene, max_step_height
    >>> run = load_scene('fig7_top').simulate()
    >>> run.crossed
    True
    >>> robot = load_robot('gimball').replace(ball_mass=4.0)
    >>> 0.018 < max_step_height(robot, speed=0.6).height < 0.021
    True

Names are imported when they are first used.
"""
from importlib import import_module
from pkgutil import extend_path
from typing import Any, TYPE_CHECKING

if TYPE_CHECKING:
    from ballbot_ros.crossing import (
        actuation_for, held_at, max_step_height, max_step_heights, MaxStepHeight, Rules, Site,
        try_step)
    from ballbot_ros.errors import BallbotError, ConfigurationError, SimulationError
    from ballbot_ros.physics import (
        Actuation, ContactOptions, load_robot, load_scene, Model, Robot, Scene, simulate, Solver,
        State, Terrain, Trajectory)
    from ballbot_ros.results import report, Summary

# The generated ballbot_ros.msg and ballbot_ros.srv are in another directory than this source
# whenever the package is installed with symlinks or run from a checkout: join the two.
__path__ = extend_path(__path__, __name__)

__version__ = '0.1.0'

__all__ = [
    'Actuation', 'actuation_for', 'BallbotError', 'ConfigurationError', 'ContactOptions',
    'held_at', 'load_robot', 'load_scene', 'max_step_height', 'max_step_heights',
    'MaxStepHeight', 'Model', 'report', 'Robot', 'Rules', 'Scene', 'simulate',
    'SimulationError', 'Site', 'Solver', 'State', 'Summary', 'Terrain', 'Trajectory', 'try_step']

_MODULES = ('errors', 'physics', 'crossing', 'results')


def __getattr__(name: str) -> Any:
    """Import a public name from the module that defines it."""
    if name in __all__:
        for module in _MODULES:
            found = getattr(import_module(f'{__name__}.{module}'), name, None)
            if found is not None:
                globals()[name] = found
                return found
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
