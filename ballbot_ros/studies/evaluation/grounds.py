# SPDX-License-Identifier: Apache-2.0
"""
Grounds that a ball is sent to: every kind of obstacle, drawn in size, on a slope.

A kind is a function of a random generator and a line of `KINDS`.
"""
from dataclasses import dataclass
import math
from typing import Callable, List, Mapping, Optional, Tuple

import numpy as np

from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.physics.model.terrain_file import PIECES

Strides = List[Tuple[float, float]]

LONG = 30.0  # floor before and behind everything [m]
STEEPEST = math.radians(4.0)  # slope below a whole ground
ROLLED = 2.0  # so far over an empty floor is enough [m]


@dataclass(frozen=True)
class Shape:
    """
    An obstacle.

    Attributes
    ----------
    words : str
        For people.
    strides : list of (float, float)
        From vertex to vertex, from the foot of the obstacle on [m].
    goal : float
        A ball whose centre is farther behind the foot than this is over [m]; infinite where
        nobody should get over.
    sensors : str
        That can see it: ``any``, or ``terrain`` alone.

    """

    words: str
    strides: Strides
    goal: float
    sensors: str = 'any'


@dataclass(frozen=True)
class Ground:
    """
    An obstacle on a slope, with the floor that leads to it.

    Attributes
    ----------
    kind, words : str
    terrain : Terrain
        The ball starts at x = 0.
    foot : float
        Where the obstacle begins [m].
    goal : float
        A ball whose centre is beyond this is over [m].
    slope : float
        Of the floor, positive uphill [rad].
    sensors : str

    """

    kind: str
    words: str
    terrain: Terrain
    foot: float
    goal: float
    slope: float
    sensors: str


Random = np.random.Generator


def _mm(random: Random, low: float, high: float) -> float:
    """Return a height from a range, both in mm [m]."""
    return 1e-3 * round(float(random.uniform(low, high)), 1)


def _gap(random: Random, low: float = 0.1, high: float = 0.6) -> float:
    """Return a length [m]."""
    return round(float(random.uniform(low, high)), 3)


def _nothing(random: Random) -> Shape:
    return Shape('nothing', [], ROLLED)


def _step(random: Random) -> Shape:
    height = _mm(random, 8.0, 60.0)
    return Shape(f'step of {1e3 * height:.1f} mm', [(0.0, height)], 0.0)


def _curb(random: Random) -> Shape:
    height = _mm(random, 80.0, 220.0)
    return Shape(f'curb of {1e3 * height:.0f} mm', [(0.0, height)], math.inf)


def _threshold(random: Random) -> Shape:
    height, width = _mm(random, 8.0, 45.0), _gap(random)
    down = height if random.random() < 0.7 else _mm(random, 8.0, 45.0)
    return Shape(f'threshold of {1e3 * height:.1f} mm up, {1e3 * down:.1f} mm down after '
                 f'{width:.3f} m', [(0.0, height), (width, 0.0), (0.0, -down)], width)


def _stairs(random: Random) -> Shape:
    first, second, gap = _mm(random, 8.0, 40.0), _mm(random, 8.0, 40.0), _gap(random)
    return Shape(f'steps of {1e3 * first:.1f} and {1e3 * second:.1f} mm, {gap:.3f} m apart',
                 [(0.0, first), (gap, 0.0), (0.0, second)], gap)


def _drop(random: Random) -> Shape:
    depth = _mm(random, 8.0, 300.0)
    return Shape(f'drop of {1e3 * depth:.0f} mm', [(0.0, -depth)], math.inf)


def _step_drop(random: Random) -> Shape:
    height, gap, depth = _mm(random, 10.0, 45.0), _gap(random, 0.15), _mm(random, 60.0, 200.0)
    return Shape(f'step of {1e3 * height:.1f} mm, {gap:.3f} m behind it a drop of '
                 f'{1e3 * depth:.0f} mm', [(0.0, height), (gap, 0.0), (0.0, -depth)], math.inf)


def _wall(random: Random) -> Shape:
    return Shape('wall', [(0.0, _mm(random, 250.0, 1000.0))], math.inf)


def _step_wall(random: Random) -> Shape:
    height, gap = _mm(random, 10.0, 45.0), _gap(random, 0.3)
    return Shape(f'step of {1e3 * height:.1f} mm, {gap:.3f} m behind it a wall',
                 [(0.0, height), (gap, 0.0), (0.0, 0.6)], math.inf)


def _bevel(random: Random) -> Shape:
    height, angle = _mm(random, 10.0, 60.0), float(random.uniform(20.0, 70.0))
    run = height / math.tan(math.radians(angle))
    # A sensor that sees steps only takes what is steeper than 45 degrees for one.
    return Shape(f'bevel of {1e3 * height:.1f} mm at {angle:.0f} degrees', [(run, height)], run,
                 'any' if angle > 50.0 else 'terrain')


def _ramp(random: Random) -> Shape:
    angle, length = float(random.uniform(4.0, 8.0)), _gap(random, 0.2, 1.5)
    up = 1.0 if random.random() < 0.6 else -1.0
    rise = up * length * math.tan(math.radians(angle))
    return Shape(f'ramp {"up" if up > 0.0 else "down"} of {angle:.1f} degrees, {length:.2f} m',
                 [(length, rise)], length)


def _groove(random: Random) -> Shape:
    width, depth = _gap(random, 0.03, 0.3), _mm(random, 10.0, 60.0)
    return Shape(f'groove of {1e3 * width:.0f} mm, {1e3 * depth:.0f} mm deep',
                 [(0.0, -depth), (width, 0.0), (0.0, depth)], width)


def _carpet(random: Random) -> Shape:
    thickness, length = _mm(random, 4.0, 15.0), _gap(random, 0.3, 1.5)
    return Shape(f'carpet of {1e3 * thickness:.1f} mm, {length:.2f} m long',
                 PIECES['carpet'][0](thickness=thickness, length=length), length)


def _cord(random: Random) -> Shape:
    diameter = _mm(random, 4.0, 12.0)
    return Shape(f'cord of {1e3 * diameter:.1f} mm', PIECES['cord'][0](diameter=diameter),
                 diameter)


# Kind -> how often, and what draws one.
KINDS: Mapping[str, Tuple[float, Callable[[Random], Shape]]] = {
    'step': (0.20, _step), 'threshold': (0.12, _threshold), 'stairs': (0.10, _stairs),
    'drop': (0.10, _drop), 'step_drop': (0.08, _step_drop), 'wall': (0.05, _wall),
    'step_wall': (0.06, _step_wall), 'curb': (0.05, _curb), 'bevel': (0.05, _bevel),
    'ramp': (0.05, _ramp), 'groove': (0.04, _groove), 'carpet': (0.04, _carpet),
    'cord': (0.03, _cord), 'nothing': (0.03, _nothing)}


def draw_shape(random: Random, kind: Optional[str] = None) -> Tuple[str, Shape]:
    """Return a kind and an obstacle of it; of a given kind, if one is given."""
    names = list(KINDS)
    weights = np.array([KINDS[name][0] for name in names])
    drawn = names[int(random.choice(len(names), p=weights / weights.sum()))]
    name = kind or drawn
    return name, KINDS[name][1](random)


def lay(kind: str, shape: Shape, foot: float, slope: float, back: Optional[float],
        friction: float) -> Ground:
    """
    Return the ground with an obstacle.

    Parameters
    ----------
    kind : str
    shape : Shape
    foot : float
        Where it begins; the ball starts at 0 [m].
    slope : float
        Of everything, positive uphill [rad].
    back : float or None
        Where behind the start the floor ends in a deep drop [m], if it does.
    friction : float
        Coefficient of all surfaces.

    """
    vertices = [(foot, 0.0)]
    for run, rise in shape.strides:
        vertices.append((vertices[-1][0] + run, vertices[-1][1] + rise))
    begin = [(-LONG, 0.0)] if back is None else [(-LONG, -0.5), (-back, -0.5), (-back, 0.0)]
    level = np.array([*begin, *vertices, (vertices[-1][0] + LONG, vertices[-1][1])])
    # Sheared, not turned: faces stay vertical, and steps as high as they are.
    level[:, 1] += math.tan(slope) * level[:, 0]
    words = shape.words + (f', slope {math.degrees(slope):.1f} degrees' if slope else '')
    return Ground(kind, words, Terrain(level, np.full(len(level) - 1, friction)), foot,
                  foot + shape.goal, slope, shape.sensors)
