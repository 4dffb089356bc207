# SPDX-License-Identifier: Apache-2.0
"""Which robot and ground a page shows, from what the parameters of nodes say."""
from typing import Any, List, Mapping, NamedTuple, Optional, Tuple

from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.decision.planning.curve import HeightCurve, load_curve
from ballbot_ros.errors import BallbotError
from ballbot_ros.physics.model.robot import load_robot, Robot
from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.physics.simulation.scene import load_scene

DEFAULT = 'gimball'


class Said(NamedTuple):
    """What is known of robot, ground and curve, and what a person should know about that."""

    robot: Robot
    terrain: Optional[Terrain]
    curve: Optional[HeightCurve]
    notes: Tuple[str, ...]


def scene_named(parameters: Mapping[str, Any], robot: str = '') -> Said:
    """
    Return robot, ground and height curve that parameters of nodes name.

    Parameters
    ----------
    parameters : mapping
        ``scene``, ``robot``, ``hardware``, ``curve`` and its ``variant`` count; a file of another
        machine may be missing here.
    robot : str
        Name or file of the robot, which goes before what is said.

    Raises
    ------
    ConfigurationError
        If `robot` cannot be read.

    """
    notes: List[str] = []
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
    curve = _curve(found, parameters, notes)
    return Said(found, terrain, curve, tuple(notes))


def _curve(robot: Robot, parameters: Mapping[str, Any], notes: List[str]
           ) -> Optional[HeightCurve]:
    """Return the curve that is named, or else that of the robot with its pendulum down."""
    if parameters.get('curve'):
        try:
            curve = load_curve(str(parameters['curve']), str(parameters.get('variant') or 'fit'))
            if curve.robot == robot.name:
                return curve
        except BallbotError as error:
            notes.append(f'{error}.')
    try:
        return load_curve(f'{robot.name}_down')
    except BallbotError:
        return None
