# SPDX-License-Identifier: Apache-2.0
"""Selection of the frames and rows of a film strip."""
import math
from typing import NamedTuple

import numpy as np

from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.simulation.trajectory import Trajectory
from ballbot_ros.results.faces import meet_faces

# Lengths in ball radii.
ROW = 17.0  # maximum travel in one row
TURN = 0.5  # reverse travel that starts a new row
LEAST_GAP = 0.55  # between two outlines
STEP_DISTANCE = 1.2  # of the centre from a step that the ball climbs

# Maximum number of outlines in the longest row, if the ball touches no step.
OUTLINES_MAX = 13
# Factor of the distance between outlines away from the touched steps.
SPARSE = 2.0

# Maximum number of rows of a strip; of a longer run, the rows around its hardest impact.
MOST_ROWS = 4

# Maximum number of evaluated samples; more have no visible effect.
_SAMPLES_MAX = 6000


class Row(NamedTuple):
    """A part of a run in which the ball moves in one direction."""

    samples: Array  # indices of the evaluated samples, in the order of time
    frames: Array  # indices of the samples at which the ball is drawn


class Layout(NamedTuple):
    """The rows of a strip."""

    rows: tuple[Row, ...]
    gap: float  # minimum distance between two outlines [m]
    of: int  # number of rows of the complete run


def lay_out(run: Trajectory) -> Layout:
    """Return the rows of a strip, with the samples that each row shows."""
    radius = run.model.robot.ball_radius
    samples = np.unique(np.linspace(0, len(run) - 1, min(len(run), _SAMPLES_MAX)).astype(int))
    parts = [part for leg in _legs(run['x'], samples, TURN * radius)
             for part in _split(run['x'], leg, ROW * radius)]
    shown = _window(run, parts)
    longest = max(float(np.hypot(np.diff(run['x'][part]), np.diff(run['y'][part])).sum())
                  for part in shown)
    least, even = LEAST_GAP * radius, longest / (OUTLINES_MAX - 1)
    touched = [met.x for met in meet_faces(run) if met.touch_time is not None]
    gaps: Array = np.full(len(run), max(least, even))
    if touched and even > least:
        near = np.min(np.abs(run['x'][:, None] - touched), axis=1) < STEP_DISTANCE * radius
        gaps = np.where(near, least, SPARSE * even)
    return Layout(tuple(Row(part, _frames(run, part, gaps[part])) for part in shown),
                  float(gaps.min()), len(parts))


def _legs(x: Array, samples: Array, least: float) -> list[Array]:
    """Split where the ball reverses and then travels back by more than `least`."""
    legs, start, turn, sign = [], 0, 0, 0
    for index in range(1, len(samples)):
        travel = x[samples[index]] - x[samples[turn]]
        if sign == 0:
            # The direction is known after sufficient travel.
            if abs(travel) > least:
                sign, turn = (1 if travel > 0.0 else -1), index
        elif travel * sign > 0.0:
            turn = index
        elif abs(travel) > least:
            legs.append(samples[start:turn + 1])
            start, turn, sign = turn, index, -sign
    return [*legs, samples[start:]]


def _split(x: Array, leg: Array, length: float) -> list[Array]:
    """Cut a leg into parts of equal travel, none longer than `length`."""
    travel = np.abs(x[leg] - x[leg[0]])
    count = max(1, math.ceil(float(travel.max()) / length))
    # Small reverse motions do not reopen a part.
    part = np.minimum(np.maximum.accumulate(travel) * count / max(travel.max(), 1e-12),
                      count - 1).astype(int)
    return [piece for number in range(count) if len(piece := leg[part == number])]


def _window(run: Trajectory, parts: list[Array]) -> list[Array]:
    """Return the parts around the hardest impact, on an edge if any, else on a surface."""
    if len(parts) <= MOST_ROWS:
        return parts
    force = run['edge_normal_force']
    if not force.any():
        force = run['surface_normal_force']
    peaks = [float(force[part].max()) for part in parts]
    first = int(np.argmax(peaks)) - 1
    first = min(max(first, 0), len(parts) - MOST_ROWS)
    return parts[first:first + MOST_ROWS]


def _frames(run: Trajectory, part: Array, gaps: Array) -> Array:
    """Return the first and the last sample, and samples between them at distances `gaps` [m]."""
    places = np.column_stack([run['x'][part], run['y'][part]])
    kept = [0]
    last = len(part) - 1
    for index in range(1, last):
        away = np.hypot(*(places[kept] - places[index]).T)
        if away.min() >= gaps[index]:
            kept.append(index)
    if last and np.hypot(*(places[last] - places[0])) > 0.2 * gaps[last]:
        # The last outline takes precedence over its neighbours.
        kept = [0, *(index for index in kept[1:]
                     if np.hypot(*(places[last] - places[index])) >= 0.7 * gaps[last]), last]
    return part[kept]
