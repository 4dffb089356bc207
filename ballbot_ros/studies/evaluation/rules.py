# SPDX-License-Identifier: Apache-2.0
"""
Rules to compare a planner with: what one would do without knowing better.

Each is the planner ``cubic`` with another curve of heights and without margins, so that all else
(drops, stale observations, driving) is the same; ``always-try`` takes every step at `TRY`.
"""
from dataclasses import replace
from typing import Callable, Mapping

from ballbot_ros.decision import Knowledge, Planner, PLANNERS
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.studies.comparators import inertia_ratio, quasi_static

ANY = 10.0  # height of a step that is higher than all [m]
RISE = 1e-6  # a curve must rise [s]
SLOWEST, TRY = 0.1, 0.7  # speeds of touch that are asked for at the least [m/s]


def _ruled(knowledge: Knowledge, constant: float, square: float,
           slowest: float = SLOWEST) -> Planner:
    """Return a planner that believes in the height constant + square v^2 [m, s2/m]."""
    curve = replace(knowledge.curve, coefficients=(constant, RISE, square, 0.0), conservative=(),
                    covariance=(), residual=0.0, rms=0.0, made=None, band=None,
                    lowest_speed=slowest)
    tuning = replace(knowledge.tuning, speed_margin=0.0, height_margin=0.0, sigma_margin=0.0)
    return PLANNERS['cubic'](replace(knowledge, curve=curve, tuning=tuning))


def _energy(robot: Robot) -> float:
    return (1.0 + inertia_ratio(robot)) / (2.0 * robot.gravity)


# Name -> what makes a planner of what is known.
RULES: Mapping[str, Callable[[Knowledge], Planner]] = {
    'always-try': lambda knowledge: _ruled(knowledge, ANY, 0.0, TRY),
    'quasi-static': lambda knowledge: _ruled(knowledge, quasi_static(knowledge.robot), 0.0),
    'energy': lambda knowledge: _ruled(knowledge, 0.0, _energy(knowledge.robot))}
