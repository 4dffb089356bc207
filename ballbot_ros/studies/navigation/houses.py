# SPDX-License-Identifier: Apache-2.0
"""
Random houses: a hall with rooms on both sides, whose doors have steps, thresholds or nothing.

Half of the rooms have a carpet, a cord, a platform, a ramp to a platform or a lower level.

A house has two floors: the true one, and the map, whose heights deviate and which lacks obstacles.
House number n of a seed does not depend on the other houses.
"""
from dataclasses import astuple, dataclass, replace
import math
from typing import List, Tuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.floors import Feature, Floor
from ballbot_ros.floors.floor import distance_to_segment, FREE, OCCUPIED, Point
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.studies.evaluation.approaches import draw_robot
from ballbot_ros.studies.navigation.closed_loop import Errors

RESOLUTION, THICKNESS = 0.05, 0.1  # [m]
HALL = (1.2, 1.7)  # width [m]
ROOM_WIDTH, ROOM_DEPTH = (2.4, 4.2), (2.4, 3.6)  # [m]
DOOR = (0.85, 1.2)  # width [m]
STEP, BAR = (0.006, 0.055), (0.005, 0.025)  # heights [m]
WIDTHS = (0.02, 0.08)  # of thresholds [m]
HEIGHT_SD = 0.002  # of the map, as stated in it [m]
# Shares: doors with a step, with a threshold; heights with a gross error; rooms with an obstacle
# that the map lacks; houses with stairs.
STEPS, BARS, GROSS, OBSTACLES, STAIRS = 0.4, 0.3, 0.08, 0.15, 0.25
GROSS_ERROR = 0.02  # largest [m]
FURNISHED = 0.5  # share of rooms with a feature inside
AREA = (0.7, 1.1)  # sides of carpets and levels, and length of ramps [m]
LOW, LEVEL = (0.003, 0.012), (0.006, 0.05)  # heights of cords and carpets, and of levels [m]
BOX = 0.3  # side of an obstacle [m]
# Largest errors of sensors and localisation, see `Errors`: [m], [rad], [m], [m].
ERRORS_MAX = Errors(0.03, 0.015, 0.002, 0.015)
ROOM = 0.35  # half the side of the free square around start and goal [m]


@dataclass(frozen=True)
class House:
    """A house with a robot, a start and a goal."""

    number: int
    truth: Floor
    map: Floor
    robot: Robot  # the true one
    errors: Errors  # of sensors and localisation
    start: Tuple[float, float, float]
    goal: Point


def draw_house(nominal: Robot, seed: int, number: int) -> House:
    """Return house `number` of a seed."""
    random = np.random.default_rng([seed, number])
    hall = float(random.uniform(*HALL))
    depths = [float(random.uniform(*ROOM_DEPTH)) for _ in range(2)]
    length = float(random.uniform(7.0, 11.0))
    cells = np.zeros((round((depths[0] + hall + depths[1]) / RESOLUTION),
                      round(length / RESOLUTION)), np.uint8)
    _wall(cells, (0.0, 0.0), (length, 0.0))
    _wall(cells, (0.0, sum(depths) + hall), (length, sum(depths) + hall))
    for x in (0.0, length):
        _wall(cells, (x, 0.0), (x, sum(depths) + hall))
    features: List[Feature] = []
    rooms: List[Tuple[float, float, float, float]] = [(0.0, length, depths[0], depths[0] + hall)]
    for side in (0, 1):
        y = depths[0] + side * hall
        low, high = (0.0, depths[0]) if side == 0 else (y, y + depths[1])
        _wall(cells, (0.0, y), (length, y))
        x = 0.0
        while x < length - ROOM_WIDTH[0]:
            end = x + float(random.uniform(*ROOM_WIDTH))
            end = length if length - end < ROOM_WIDTH[0] else end
            _wall(cells, (end, low), (end, high))
            width = float(random.uniform(*DOOR))
            door = float(random.uniform(x + 0.3, end - width - 0.3))
            _wall(cells, (door, y), (door + width, y), FREE, 0.0)
            # The room is on the left of the line.
            line = ((door + width, y), (door, y)) if side == 0 else ((door, y), (door + width, y))
            kind = random.random()
            if kind < STEPS:
                features.append(Feature(kind='step', line=line, height_sd=HEIGHT_SD, height=float(
                    random.uniform(*STEP))))
            elif kind < STEPS + BARS:
                features.append(Feature(
                    kind='threshold', line=line, height=float(random.uniform(*BAR)),
                    height_sd=HEIGHT_SD, width=float(random.uniform(*WIDTHS))))
            rooms.append((x, end, low, high))
            x = end
    if random.random() < STAIRS:
        y = depths[0] + 0.1
        features.append(Feature(kind='stairs', polygon=(
            (length - 0.9, y), (length - 0.15, y), (length - 0.15, y + hall - 0.2),
            (length - 0.9, y + hall - 0.2))))
    for room in rooms[1:]:
        if random.random() < FURNISHED:
            features.extend(_in_room(room, random))
    mapped = tuple(_mapped(feature, random) for feature in features)
    truth = cells.copy()
    for left, right, bottom, top in rooms[1:]:
        if random.random() < OBSTACLES:
            corner = (float(random.uniform(left + 0.3, right - 0.3 - BOX)),
                      float(random.uniform(bottom + 0.3, top - 0.3 - BOX)))
            truth[round(corner[1] / RESOLUTION):round((corner[1] + BOX) / RESOLUTION),
                  round(corner[0] / RESOLUTION):round((corner[0] + BOX) / RESOLUTION)] = OCCUPIED
    places: List[Point] = []
    for index in random.choice(len(rooms), 2, replace=False).tolist():
        left, right, bottom, top = rooms[index]
        while len(places) < 2:
            place = (float(random.uniform(left + 0.5, right - 0.5)),
                     float(random.uniform(bottom + 0.5, top - 0.5)))
            if _is_free(truth, features, place):
                places.append(place)
                break
    name = f'house {number} of seed {seed}'
    errors = Errors(*(float(random.uniform(0.0, high)) for high in astuple(ERRORS_MAX)))
    return House(number, Floor(name, truth, RESOLUTION, (0.0, 0.0), tuple(features)),
                 Floor(name, cells, RESOLUTION, (0.0, 0.0), mapped), draw_robot(nominal, random),
                 errors, (*places[0], float(random.uniform(-math.pi, math.pi))), places[1])


def _in_room(room: Tuple[float, float, float, float], random: np.random.Generator
             ) -> List[Feature]:
    """Return a carpet, a cord, a platform, a ramp with its platform, or a lower level."""
    left, right, bottom, top = room
    kind = str(random.choice(('carpet', 'cord', 'platform', 'ramp', 'lower')))
    width, depth, length = random.uniform(*AREA, 3).tolist()
    x = float(random.uniform(left + 0.1, right - 0.1 - width - length * (kind == 'ramp')))
    y = float(random.uniform(bottom + 0.1, top - 0.1 - depth))
    height = float(random.uniform(*(LOW if kind in ('carpet', 'cord') else LEVEL)))
    if kind == 'cord':
        return [Feature(kind=kind, line=((left, y), (right, y)), height=height,
                        height_sd=HEIGHT_SD, width=0.01)]

    def area(begin: float, end: float) -> Tuple[Point, ...]:
        return (begin, y), (end, y), (end, y + depth), (begin, y + depth)
    found = [Feature(kind='carpet' if kind == 'carpet' else 'level', polygon=area(x, x + width),
                     height=-height if kind == 'lower' else height, height_sd=HEIGHT_SD)]
    if kind == 'ramp':
        end = x + width + length
        found.append(Feature(kind=kind, polygon=area(x + width, end), height=height,
                             height_sd=HEIGHT_SD, line=((end, y), (x + width, y))))
    return found


def _is_free(cells: NDArray[np.uint8], features: List[Feature], place: Point) -> bool:
    """Return whether a ball has room at a place, off walls, steps and stairs."""
    rows, columns = (slice(round(max(0.0, at - ROOM) / RESOLUTION),
                           round((at + ROOM) / RESOLUTION)) for at in place[::-1])
    return not cells[rows, columns].any() and all(
        float(distance_to_segment(*place, *segment)) > ROOM * (
            3.0 if feature.kind == 'stairs' else 1.0)
        for feature in features for segment in feature.segments)


def _mapped(feature: Feature, random: np.random.Generator) -> Feature:
    """Return a feature as the map has it."""
    error = float(random.normal(0.0, HEIGHT_SD))
    if random.random() < GROSS:
        error = float(random.uniform(-GROSS_ERROR, GROSS_ERROR))
    if feature.kind == 'stairs':
        return feature
    return replace(feature, height=math.copysign(
        max(abs(feature.height) + error, 0.003), feature.height))


def _wall(cells: NDArray[np.uint8], begin: Point, end: Point, value: int = OCCUPIED,
          beyond: float = 0.5 * THICKNESS) -> None:
    """Set the cells of a wall along an axis, or of an opening in one along x."""
    rows, columns = (slice(max(0, round((low - margin) / RESOLUTION)),
                           round((high + margin) / RESOLUTION))
                     for low, high, margin in ((begin[1], end[1], 0.5 * THICKNESS),
                                               (begin[0], end[0], beyond)))
    cells[rows, columns] = value
