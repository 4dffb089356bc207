# SPDX-License-Identifier: Apache-2.0
"""Which robot and ground a page shows, from what the parameters of nodes say."""
from typing import Any, Mapping, NamedTuple, Optional, Tuple

from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.decision.curve import HeightCurve, load_curve
from ballbot_ros.errors import BallbotError
from ballbot_ros.physics.model.robot import load_robot, Robot
from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.physics.simulation.scene import load_scene

DEFAULT = 'gimball'


class Said(NamedTuple):
    """What is known of robot and ground, and what a person should know about that."""

    robot: Robot
    terrain: Optional[Terrain]
    notes: Tuple[str, ...]


def scene_named(parameters: Mapping[str, Any], robot: str = '') -> Said:
    """
    Return robot and ground that parameters of nodes name.

    Parameters
    ----------
    parameters : mapping
        ``scene``, ``robot`` and ``hardware`` count; a file of another machine may be missing here.
    robot : str
        Name or file of the robot, which goes before what is said.

    Raises
    ------
    ConfigurationError
        If `robot` cannot be read.

    """
    notes = []
    terrain: Optional[Terrain] = None
    found = load_robot(robot) if robot else None
    try:
        if parameters.get('scene'):
            other = str(parameters.get('robot') or '')
            scene = load_scene(str(parameters['scene']), other or None)
            terrain, found = scene.model.terrain, found or scene.model.robot
        elif found is None and parameters.get('robot'):
            found = load_robot(str(parameters['robot']))
        elif found is None and parameters.get('hardware'):
            found = load_robot(load_hardware(str(parameters['hardware'])).robot)
    except BallbotError as error:
        notes.append(f'{error}.')
    if found is None:
        found = load_robot(DEFAULT)
        notes.append(f'Nobody says which robot this is; it is drawn as {DEFAULT} (--robot NAME).')
    return Said(found, terrain, tuple(notes))


def curve_for(robot: Robot) -> Optional[HeightCurve]:
    """Return the height curve of a robot with its pendulum down, None where none is at hand."""
    try:
        curve = load_curve(f'{robot.name}_down')
    except BallbotError:
        return None
    return curve
