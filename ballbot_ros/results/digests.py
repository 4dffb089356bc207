# SPDX-License-Identifier: Apache-2.0
"""Digests of the inputs of a run: equal digests mean equal results."""
from dataclasses import fields, is_dataclass
import hashlib
import json
from typing import Any, Mapping

import numpy as np

from ballbot_ros.physics.simulation.scene import Scene

LENGTH = 16  # characters; collision probability 2**-64


def digest(value: Any) -> str:
    """
    Return a digest of numbers, texts, arrays, lists, mappings and dataclasses of these.

    Comments, the layout of a file and the provenance of a number have no effect.
    """
    text = json.dumps(_plain(value), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:LENGTH]


def scene_digests(scene: Scene) -> Mapping[str, str]:
    """Return digests of the robot, and of all other inputs of the plant of a scene."""
    model = scene.model
    return {'robot': model.robot.digest,
            'scene': digest((model.terrain, model.options, scene.initial))}


def _plain(value: Any) -> Any:
    """Return a value as JSON types; floats are converted without loss."""
    if is_dataclass(value):
        return {item.name: _plain(getattr(value, item.name)) for item in fields(value)
                if item.name != 'provenance'}
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, float):
        return repr(value + 0.0)
    return value
