# SPDX-License-Identifier: Apache-2.0
"""Learned data of a floor: heights, obstacles and outcomes; stored next to the map."""
from dataclasses import asdict, dataclass, replace
import json
from pathlib import Path
from typing import Any, Sequence, Tuple

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.floors.floor import Feature, Point

# Weight of the predicted probability of a crossing against learned outcomes, in attempts.
PRIOR_ATTEMPTS = 5.0
# Obstacles that are closer together than this are merged [m].
SAME_DISTANCE = 0.08
VERSION = 2


@dataclass(frozen=True)
class Learned:
    """
    Learned data; immutable.

    Attributes
    ----------
    heights : tuple of (int, float)
        Number of a feature of the floor, and its observed height [m].
    obstacles : tuple of (float, float)
        Points that are not on the map [m].
    outcomes : tuple of (int, int, float, bool, int)
        Number of a feature, direction (1 towards the left of its line), run-up [m], whether the
        ball crossed it, and number of such attempts.
    places : tuple of (str, tuple of (float, float), float, float)
        Kind, points, height and width [m] on the map of the features to which the numbers refer;
        empty for those of the floor in use.

    """

    heights: Tuple[Tuple[int, float], ...] = ()
    obstacles: Tuple[Point, ...] = ()
    outcomes: Tuple[Tuple[int, int, float, bool, int], ...] = ()
    places: Tuple[Tuple[Any, ...], ...] = ()

    def on(self, features: Sequence[Feature]) -> 'Learned':
        """Return the data for the features of a floor, without those of features not on it."""
        places = tuple((feature.kind, (*feature.line, *feature.polygon), feature.height,
                        feature.width) for feature in features)
        if self.places in ((), places):
            return replace(self, places=places)
        numbers = {number: places.index(place) for number, place in enumerate(self.places)
                   if place in places}
        return replace(
            self, places=places,
            heights=tuple(sorted((numbers[number], height) for number, height in self.heights
                                 if number in numbers)),
            outcomes=tuple((numbers[item[0]], *item[1:]) for item in self.outcomes
                           if item[0] in numbers))

    def probability(self, number: int, sign: int, run_up: float, predicted: float) -> float:
        """
        Return the mean of the beta distribution with the prediction as its prior.

        A crossing also counts for longer run-ups, and a failure for shorter ones.
        """
        counted = [(crossed, count) for feature, direction, tried, crossed, count in self.outcomes
                   if (feature, direction) == (number, sign)
                   and (tried <= run_up if crossed else run_up <= tried)]
        return (PRIOR_ATTEMPTS * predicted + sum(crossed * count for crossed, count in counted)) \
            / (PRIOR_ATTEMPTS + sum(count for _, count in counted))

    def with_height(self, number: int, height: float) -> 'Learned':
        """Return a copy with the observed height of a feature [m]."""
        return replace(self, heights=tuple(sorted({**dict(self.heights),
                                                   number: height}.items())))

    def with_obstacles(self, points: Tuple[Point, ...]) -> 'Learned':
        """Return a copy with additional obstacles [m]."""
        known = list(self.obstacles)
        for x, y in points:
            if not any(max(abs(x - a), abs(y - b)) < SAME_DISTANCE for a, b in known):
                known.append((x, y))
        return replace(self, obstacles=tuple(known))

    def with_outcome(self, number: int, sign: int, run_up: float, crossed: bool) -> 'Learned':
        """Return a copy with another attempt."""
        counts = {item[:4]: item[4] for item in self.outcomes}
        key = number, sign, run_up, crossed
        counts[key] = counts.get(key, 0) + 1
        return replace(self, outcomes=tuple((*tried, count) for tried, count in counts.items()))

    @classmethod
    def read(cls, path: Path) -> 'Learned':
        """
        Read a file; return empty data if it does not exist.

        Raises
        ------
        ConfigurationError
            If the file is damaged.

        """
        if not path.is_file():
            return cls()
        try:
            content = json.loads(path.read_text(encoding='utf-8'))
            if content['version'] != VERSION:
                raise ValueError(f'version {content["version"]}')
            return cls(
                tuple((int(number), float(height)) for number, height in content['heights']),
                tuple((float(x), float(y)) for x, y in content['obstacles']),
                tuple((int(number), int(sign), float(run_up), bool(crossed), int(count))
                      for number, sign, run_up, crossed, count in content['outcomes']),
                tuple((kind, tuple((float(x), float(y)) for x, y in points), float(height),
                       float(width)) for kind, points, height, width in content['places']))
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ConfigurationError(
                f'{path}: cannot be read ({error}); remove it to start with the map alone',
                'unreadable', str(path)) from error

    def write(self, path: Path) -> None:
        """Write a file atomically."""
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = path.with_suffix('.new')
        temporary.write_text(json.dumps({'version': VERSION, **asdict(self)}, indent=1),
                             encoding='utf-8')
        temporary.replace(path)
