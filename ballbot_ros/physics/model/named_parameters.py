# SPDX-License-Identifier: Apache-2.0
"""Parameters of a robot and its parts by name, as ``ball_mass`` and ``motor.resistance``."""
from dataclasses import fields
from typing import Any, Dict, Mapping

from ballbot_ros.config.columns import changed
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.model.robot import PARTS, Robot


def described(cls: Any, prefix: str = '') -> Dict[str, Mapping[str, Any]]:
    """Return the numeric fields of a dataclass by name, as they are described."""
    return {prefix + item.name: item.metadata for item in fields(cls)
            if item.metadata.get('kind') is float}


ROBOT = described(Robot)
MOTOR, STEERING = (described(cls, f'{name}.') for name, cls in PARTS.items())


def with_parameters(robot: Robot, values: Mapping[str, Any]) -> Robot:
    """
    Return a robot with other parameters, SI, or with columns.

    Names are those of `ROBOT`, `MOTOR` and `STEERING`.

    Raises
    ------
    ConfigurationError
        If a value is out of range, or of a part that the robot has not.

    """
    own: Dict[str, Any] = {name: value for name, value in values.items() if name in ROBOT}
    for part, known in (('motor', MOTOR), ('steering', STEERING)):
        given = {name.partition('.')[2]: value for name, value in values.items() if name in known}
        if given:
            if getattr(robot, part) is None:
                raise ConfigurationError(
                    f'robot {robot.name!r} has no {part} to change {min(given)} of')
            own[part] = changed(getattr(robot, part), given)
    return changed(robot, own)
