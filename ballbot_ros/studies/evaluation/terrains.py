# SPDX-License-Identifier: Apache-2.0
"""
Terrains for the evaluation: obstacles of all kinds and of drawn sizes, on a slope.

A kind of obstacle is a line of `KINDS`, and a function of a random generator and of the length of
floor that the decision may assume behind an edge.
"""
from dataclasses import dataclass
import math
from typing import Callable, List, Mapping, Optional, Tuple

import numpy as np

from ballbot_ros.physics.model.terrain import PIECES, Terrain

Strides = List[Tuple[float, float]]
Random = np.random.Generator

FLOOR = 30.0  # length of the floor before and behind all obstacles [m]
SLOPE_MAX = math.radians(4.0)  # largest slope of the entire terrain
PLAIN_DISTANCE = 2.0  # distance to travel over a floor without obstacle [m]
THRESHOLDS = 10  # of a corridor

# A face is steeper than this slope and at least this high; other surfaces are not obstacles.
FACE_SLOPE, FACE_HEIGHT = math.tan(math.radians(25.0)), 0.005  # [1], [m]


@dataclass(frozen=True)
class Shape:
    """An obstacle."""

    description: str
    strides: Strides  # displacements from vertex to vertex, from the foot of the obstacle on [m]
    # The ball is over when its centre is this far behind the foot [m]; infinite for an obstacle
    # that must not be crossed.
    goal: float
    # Sensors that can detect it: ``any``, or ``terrain`` for sensors that measure points.
    sensors: str = 'any'
    # Range of the slope of the entire terrain [rad], if it is specific to the kind.
    slope: Optional[Tuple[float, float]] = None


@dataclass(frozen=True)
class Ground:
    """An obstacle on a slope, with the floor that leads to it."""

    kind: str
    description: str
    terrain: Terrain  # the ball starts at x = 0
    foot: float  # start of the obstacle [m]
    goal: float  # the ball is over when its centre is beyond this [m]
    slope: float  # of the floor, positive uphill [rad]

    @property
    def shortest_floor(self) -> float:
        """Return the length of the shortest floor between two faces of the obstacle [m]."""
        found = [face for face in true_faces(self.terrain) if face[0] >= self.foot - 1e-9]
        return min((after[0] - before[0] - before[2] for before, after in zip(found, found[1:])),
                   default=math.inf)


def true_faces(terrain: Terrain) -> Tuple[Tuple[float, float, float, float], ...]:
    """Return x and y of the left end, width and height of each face, from left to right [m]."""
    return tuple((float(face[0, 0]), float(face[0, 1]), float(face[-1, 0] - face[0, 0]),
                  float(face[-1, 1] - face[0, 1]))
                 for face in terrain.faces(FACE_SLOPE, FACE_HEIGHT))


def _mm(random: Random, low: float, high: float) -> float:
    """Return a height from a range, both in mm [m]."""
    return 1e-3 * round(float(random.uniform(low, high)), 1)


def _length(random: Random, low: float = 0.1, high: float = 0.6, room: float = 0.0) -> float:
    """Return a length from a range, which is shifted up to start at `room` or above [m]."""
    return round(float(random.uniform(low, high)) + max(0.0, room - low), 3)


def _nothing(random: Random, room: float) -> Shape:
    return Shape('nothing', [], PLAIN_DISTANCE)


def _step(random: Random, room: float) -> Shape:
    height = _mm(random, 8.0, 60.0)
    return Shape(f'step of {1e3 * height:.1f} mm', [(0.0, height)], 0.0)


def _curb(random: Random, room: float) -> Shape:
    height = _mm(random, 80.0, 220.0)
    return Shape(f'curb of {1e3 * height:.0f} mm', [(0.0, height)], math.inf)


def _threshold(random: Random, room: float) -> Shape:
    height, width = _mm(random, 8.0, 45.0), _length(random, room=room)
    down = height if random.random() < 0.7 else _mm(random, 8.0, 45.0)
    return Shape(f'threshold of {1e3 * height:.1f} mm up, {1e3 * down:.1f} mm down after '
                 f'{width:.3f} m', [(0.0, height), (width, 0.0), (0.0, -down)], width)


def _stairs(random: Random, room: float) -> Shape:
    first, second, gap = _mm(random, 8.0, 40.0), _mm(random, 8.0, 40.0), _length(random, room=room)
    return Shape(f'steps of {1e3 * first:.1f} and {1e3 * second:.1f} mm, {gap:.3f} m apart',
                 [(0.0, first), (gap, 0.0), (0.0, second)], gap)


def _drop(random: Random, room: float) -> Shape:
    depth = _mm(random, 8.0, 300.0)
    return Shape(f'drop of {1e3 * depth:.0f} mm', [(0.0, -depth)], math.inf)


def _step_drop(random: Random, room: float) -> Shape:
    height, gap = _mm(random, 10.0, 45.0), _length(random, 0.15, room=room)
    depth = _mm(random, 60.0, 200.0)
    return Shape(f'step of {1e3 * height:.1f} mm, {gap:.3f} m behind it a drop of '
                 f'{1e3 * depth:.0f} mm', [(0.0, height), (gap, 0.0), (0.0, -depth)], math.inf)


def _wall(random: Random, room: float) -> Shape:
    return Shape('wall', [(0.0, _mm(random, 250.0, 1000.0))], math.inf)


def _step_wall(random: Random, room: float) -> Shape:
    height, gap = _mm(random, 10.0, 45.0), _length(random, 0.3, room=room)
    return Shape(f'step of {1e3 * height:.1f} mm, {gap:.3f} m behind it a wall',
                 [(0.0, height), (gap, 0.0), (0.0, 0.6)], math.inf)


def _bevel(random: Random, room: float) -> Shape:
    height, angle = _mm(random, 10.0, 60.0), float(random.uniform(20.0, 70.0))
    run = height / math.tan(math.radians(angle))
    # A step sensor detects faces steeper than 45 degrees.
    return Shape(f'bevel of {1e3 * height:.1f} mm at {angle:.0f} degrees', [(run, height)], run,
                 'any' if angle > 50.0 else 'terrain')


def _ramp(random: Random, room: float) -> Shape:
    angle, length = float(random.uniform(4.0, 8.0)), _length(random, 0.2, 1.5)
    up = 1.0 if random.random() < 0.6 else -1.0
    rise = up * length * math.tan(math.radians(angle))
    return Shape(f'ramp {"up" if up > 0.0 else "down"} of {angle:.1f} degrees, {length:.2f} m',
                 [(length, rise)], length)


def _trench(random: Random, room: float) -> Shape:
    width, depth = _length(random, 0.03, 0.3), _mm(random, 10.0, 60.0)
    return Shape(f'trench of {1e3 * width:.0f} mm, {1e3 * depth:.0f} mm deep',
                 [(0.0, -depth), (width, 0.0), (0.0, depth)], width)


def _carpet(random: Random, room: float) -> Shape:
    thickness, length = _mm(random, 4.0, 15.0), _length(random, 0.3, 1.5)
    return Shape(f'carpet of {1e3 * thickness:.1f} mm, {length:.2f} m long',
                 PIECES['carpet'][0](thickness=thickness, length=length), length)


def _cord(random: Random, room: float) -> Shape:
    diameter = _mm(random, 4.0, 12.0)
    return Shape(f'cord of {1e3 * diameter:.1f} mm', PIECES['cord'][0](diameter=diameter),
                 diameter)


def _step_down(random: Random, room: float) -> Shape:
    depth = _mm(random, 8.0, 60.0)
    return Shape(f'step down of {1e3 * depth:.1f} mm', [(0.0, -depth)], 0.0)


def _sill_drop(random: Random, room: float) -> Shape:
    height, width = _mm(random, 9.0, 22.0), _length(random, 0.03, 0.15, room)
    gap, depth = _length(random, 0.15, 1.0, room), _mm(random, 60.0, 200.0)
    return Shape(f'sill of {1e3 * height:.1f} mm, {width:.3f} m wide, {gap:.3f} m behind it a '
                 f'drop of {1e3 * depth:.0f} mm',
                 [(0.0, height), (width, 0.0), (0.0, -height), (gap, 0.0), (0.0, -depth)],
                 math.inf, 'any', DESCENT)


def _ramp_drop(random: Random, room: float) -> Shape:
    angle, length = float(random.uniform(3.0, 8.0)), _length(random, 0.3, 1.5)
    depth = _mm(random, 60.0, 200.0)
    return Shape(f'ramp down of {angle:.1f} degrees, {length:.2f} m, that ends in a drop of '
                 f'{1e3 * depth:.0f} mm',
                 [(length, -length * math.tan(math.radians(angle))), (0.0, -depth)],
                 math.inf, 'terrain', DESCENT)


def _corridor(random: Random, room: float) -> Shape:
    height, width = _mm(random, 8.0, 20.0), _length(random, 0.03, 0.15, room)
    gap = _length(random, 0.5, 1.2, room)
    one = [(0.0, height), (width, 0.0), (0.0, -height)]
    strides = [*one, *((THRESHOLDS - 1) * [(gap, 0.0), *one])]
    return Shape(f'{THRESHOLDS} thresholds of {1e3 * height:.1f} mm, {width:.3f} m wide, '
                 f'{gap:.2f} m apart', strides, THRESHOLDS * width + (THRESHOLDS - 1) * gap)


DESCENT = (math.radians(-3.0), math.radians(-1.5))

# Kind -> relative frequency, and function that draws an obstacle.
KINDS: Mapping[str, Tuple[float, Callable[[Random, float], Shape]]] = {
    'step': (0.16, _step), 'threshold': (0.10, _threshold), 'stairs': (0.08, _stairs),
    'step_down': (0.08, _step_down), 'drop': (0.08, _drop), 'step_drop': (0.08, _step_drop),
    'sill_drop': (0.07, _sill_drop), 'ramp_drop': (0.06, _ramp_drop), 'wall': (0.04, _wall),
    'step_wall': (0.05, _step_wall), 'curb': (0.04, _curb), 'bevel': (0.04, _bevel),
    'ramp': (0.04, _ramp), 'trench': (0.06, _trench), 'carpet': (0.03, _carpet),
    'cord': (0.03, _cord), 'corridor': (0.02, _corridor), 'nothing': (0.02, _nothing)}


def draw_shape(random: Random, room: float, kind: Optional[str]) -> Tuple[str, Shape]:
    """
    Return the given kind of `KINDS`, any for None, and an obstacle of this kind.

    `room` is the length of floor behind each edge, if the kind allows for it [m].
    """
    names = list(KINDS)
    weights = np.array([KINDS[name][0] for name in names])
    drawn = names[int(random.choice(len(names), p=weights / weights.sum()))]
    name = kind or drawn
    return name, KINDS[name][1](random, room)


def lay(kind: str, shape: Shape, foot: float, slope: float, back: Optional[float],
        friction: float) -> Ground:
    """
    Return the terrain with an obstacle, whose foot is at `foot`; the ball starts at 0 [m].

    `slope` is that of the entire terrain, positive uphill [rad]; `back` is the distance behind the
    start at which the floor ends in a drop [m], None without a drop; and `friction` is the
    coefficient of all surfaces.
    """
    vertices = [(foot, 0.0)]
    for run, rise in shape.strides:
        vertices.append((vertices[-1][0] + run, vertices[-1][1] + rise))
    begin = [(-FLOOR, 0.0)] if back is None else [(-FLOOR, -0.5), (-back, -0.5), (-back, 0.0)]
    level = np.array([*begin, *vertices, (vertices[-1][0] + FLOOR, vertices[-1][1])])
    # Sheared, not rotated: faces stay vertical, and steps keep their heights.
    level[:, 1] += math.tan(slope) * level[:, 0]
    suffix = f', slope {math.degrees(slope):.1f} degrees' if slope else ''
    terrain = Terrain(level, np.full(len(level) - 1, friction))
    return Ground(kind, shape.description + suffix, terrain, foot, foot + shape.goal, slope)
