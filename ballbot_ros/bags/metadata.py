# SPDX-License-Identifier: Apache-2.0
"""Description of the run in the ``metadata.yaml`` of a bag: texts by key."""
from dataclasses import dataclass, field
import json
from typing import Any, Dict, Mapping, Optional

from ballbot_ros import __version__
from ballbot_ros.physics.simulation.scene import Scene
from ballbot_ros.results.digests import scene_digests

SIMULATOR, BRIDGE = 'simulator', 'bridge'
PREFIX = 'ballbot_ros.'


@dataclass(frozen=True)
class BagMetadata:
    """
    The origin of a bag.

    Attributes
    ----------
    source : str
        `SIMULATOR` or `BRIDGE`; empty if the bag does not contain it.
    version : str
        Of this package.
    parameters : mapping
        Those of the node that is the source.
    digests : mapping of str to str
        See `scene_digests`; empty where no scene is known.
    decision : mapping
        Parameters of the node obstacle_decision; empty without one.

    """

    source: str = ''
    version: str = ''
    parameters: Mapping[str, Any] = field(default_factory=dict)
    digests: Mapping[str, str] = field(default_factory=dict)
    decision: Mapping[str, Any] = field(default_factory=dict)

    def texts(self) -> Dict[str, str]:
        """Return the texts for `read`."""
        return {f'{PREFIX}source': self.source, f'{PREFIX}version': self.version,
                f'{PREFIX}parameters': json.dumps(dict(self.parameters), sort_keys=True),
                f'{PREFIX}decision': json.dumps(dict(self.decision), sort_keys=True),
                **{f'{PREFIX}{name}_digest': text for name, text in self.digests.items()}}

    @classmethod
    def read(cls, texts: Mapping[str, str]) -> 'BagMetadata':
        """Return the values of texts; missing or unreadable ones are left out."""
        return cls(
            texts.get(f'{PREFIX}source', ''), texts.get(f'{PREFIX}version', ''),
            _mapping(texts, 'parameters'),
            {name: texts[f'{PREFIX}{name}_digest'] for name in ('robot', 'scene')
             if f'{PREFIX}{name}_digest' in texts},
            _mapping(texts, 'decision'))


def _mapping(texts: Mapping[str, str], name: str) -> Dict[str, Any]:
    """Return a mapping that is stored as JSON; empty if it is not a mapping."""
    try:
        found = json.loads(texts.get(f'{PREFIX}{name}', '{}'))
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def bag_metadata(source: str, parameters: Mapping[str, Any],
                 scene: Optional[Scene] = None,
                 decision: Optional[Mapping[str, Any]] = None) -> Dict[str, str]:
    """
    Return the texts for a bag.

    Parameters
    ----------
    source : str
        `SIMULATOR` or `BRIDGE`.
    parameters : mapping
        Of that node.
    scene : Scene, optional
        Of the simulator.
    decision : mapping, optional
        Parameters of the node obstacle_decision.

    """
    return BagMetadata(source, __version__, parameters,
                       {} if scene is None else scene_digests(scene), decision or {}).texts()
