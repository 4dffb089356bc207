# SPDX-License-Identifier: Apache-2.0
"""Description of the run in the ``metadata.yaml`` of a bag, as JSON."""
from dataclasses import asdict, dataclass, field, fields
import json
from typing import Any, Dict, Mapping, Optional

from ballbot_ros import __version__
from ballbot_ros.physics.simulation.scene import Scene
from ballbot_ros.results.digests import scene_digests

SIMULATOR, BRIDGE = 'simulator', 'bridge'
KEY = 'ballbot_ros'  # key of the text, a JSON object


@dataclass(frozen=True)
class BagMetadata:
    source: str = ''  # `SIMULATOR` or `BRIDGE`; empty if the bag does not contain it
    version: str = ''  # of this package
    # Parameters of the source node.
    parameters: Mapping[str, Any] = field(default_factory=dict)
    # See `scene_digests`; empty without a scene.
    digests: Mapping[str, str] = field(default_factory=dict)
    # Parameters of the node obstacle_decision; empty without one.
    decision: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def read(cls, texts: Mapping[str, str]) -> 'BagMetadata':
        """Return the metadata in the texts of a bag; defaults if they are missing or damaged."""
        try:
            content = json.loads(texts.get(KEY, '{}'))
            return cls(**{item.name: type(getattr(cls(), item.name))(content[item.name])
                          for item in fields(cls) if item.name in content})
        except (TypeError, ValueError):
            return cls()


def bag_metadata(source: str, parameters: Mapping[str, Any],
                 scene: Optional[Scene] = None,
                 decision: Optional[Mapping[str, Any]] = None) -> Dict[str, str]:
    """Return the texts for a bag of a simulator or bridge, from the parameters of its nodes."""
    return {KEY: json.dumps(asdict(BagMetadata(
        source, __version__, parameters, {} if scene is None else scene_digests(scene),
        decision or {})))}
