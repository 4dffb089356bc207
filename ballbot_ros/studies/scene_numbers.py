# SPDX-License-Identifier: Apache-2.0
"""The numbers of a scene that can be estimated: of its robot, the motor and the start."""
from dataclasses import replace
from operator import attrgetter
from typing import Any, Dict, Mapping, Sequence, Tuple

import numpy as np

from ballbot_ros.config.fields import suggestion
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics import Scene
from ballbot_ros.physics.model.named_parameters import described, MOTOR, ROBOT, with_parameters
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.simulation.scene import Initial

INITIAL = described(Initial, 'initial.')
NUMBERS = {**ROBOT, **MOTOR, **INITIAL}


def with_values(scene: Scene, values: Mapping[str, float]) -> Scene:
    """
    Return a scene with other numbers of robot, motor and start.

    Raises
    ------
    ConfigurationError
        If a number is unknown or out of range.

    """
    for name in values:
        check_known(scene, name)
    robot = with_parameters(scene.model.robot, values)
    start: Dict[str, Any] = {
        name[len('initial.'):]: value for name, value in values.items() if name in INITIAL}
    return replace(scene, model=replace(scene.model, robot=robot),
                   initial=replace(scene.initial, **start))


def check_known(scene: Scene, name: str) -> None:
    """Refuse a number that is unknown, or that the robot does not have."""
    if name not in NUMBERS:
        raise ConfigurationError(
            f'identify: {name!r} is no number that can be estimated{suggestion(name, NUMBERS)}')
    if name in MOTOR and scene.model.robot.motor is None:
        raise ConfigurationError(f'identify: robot {scene.model.robot.name!r} has no motor')


def present(scene: Scene, name: str) -> float:
    """Return the number that a scene has."""
    owner = scene if name in INITIAL else scene.model.robot
    return float(attrgetter(name)(owner) or 0.0)


def bounds(names: Sequence[str], starts: Array, scales: Array) -> Tuple[Array, Array]:
    """Return how far each number may go, as relative changes."""
    low, high = [], []
    for name, start, scale in zip(names, starts, scales):
        item = NUMBERS[name]
        least = max(item['minimum'], item['above'] + 1e-6 * scale)
        low.append(max((least - start) / scale, -1e6))
        high.append(min((item['maximum'] - start) / scale, 1e6))
    # A start on its bound would leave no room for a first step.
    return np.minimum(np.array(low), -1e-9), np.maximum(np.array(high), 1e-9)
