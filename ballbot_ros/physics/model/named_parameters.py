# SPDX-License-Identifier: Apache-2.0
"""Parameters of a robot by name: ``ball_mass`` its own, ``motor.resistance`` its motor's."""
from dataclasses import fields
from typing import Any, Dict, Mapping

from ballbot_ros.config.columns import changed
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.model.robot import Motor, Robot


def described(cls: Any, prefix: str = '') -> Dict[str, Mapping[str, Any]]:
    """Return the numeric fields of a dataclass by name, as they are described."""
    return {prefix + item.name: item.metadata for item in fields(cls)
            if item.metadata.get('kind') is float}


ROBOT, MOTOR = described(Robot), described(Motor, 'motor.')


def with_parameters(robot: Robot, values: Mapping[str, Any]) -> Robot:
    """
    Return a robot with other parameters, named as in `ROBOT` and `MOTOR`, SI; or with columns.

    Raises
    ------
    ConfigurationError
        If a value is out of range, or of a motor that the robot has not.

    """
    own: Dict[str, Any] = {name: value for name, value in values.items() if name in ROBOT}
    motor = {name[len('motor.'):]: value for name, value in values.items() if name in MOTOR}
    if motor:
        if robot.motor is None:
            raise ConfigurationError(
                f'robot {robot.name!r} has no motor to change {min(motor)} of')
        own['motor'] = changed(robot.motor, motor)
    return changed(robot, own)
