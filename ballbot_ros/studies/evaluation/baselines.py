# SPDX-License-Identifier: Apache-2.0
"""
Baselines to compare a planner with.

Each is the planner ``cubic`` with another height curve and without margins, so that everything
else (drops, stale observations, driving) is equal; ``always-try`` attempts every step at `TRY`.
"""
from dataclasses import replace
from typing import Callable, Mapping

from ballbot_ros.decision import Knowledge, Planner, PLANNERS
from ballbot_ros.studies.comparators import quasi_static, rolling_energy

UNLIMITED = 10.0  # above every step [m]
RISE = 1e-6  # smallest slope of a curve [s]
SLOWEST, TRY = 0.1, 0.7  # lowest collision speeds [m/s]


def _cubic(knowledge: Knowledge, constant: float, square: float,
           slowest: float = SLOWEST) -> Planner:
    """Return a planner that assumes the maximum step height constant + square v^2 [m, s2/m]."""
    curve = replace(knowledge.curve, coefficients=(constant, RISE, square, 0.0), conservative=(),
                    covariance=(), residual=0.0, rms=0.0, made=None, band=None,
                    lowest_speed=slowest)
    tuning = replace(knowledge.tuning, speed_margin=0.0, height_margin=0.0, sigma_margin=0.0)
    return PLANNERS['cubic'](replace(knowledge, curve=curve, tuning=tuning))


# Name -> function that creates a planner from its inputs.
BASELINES: Mapping[str, Callable[[Knowledge], Planner]] = {
    'always-try': lambda knowledge: _cubic(knowledge, UNLIMITED, 0.0, TRY),
    'quasi-static': lambda knowledge: _cubic(knowledge, quasi_static(knowledge.robot), 0.0),
    'energy': lambda knowledge: _cubic(
        knowledge, 0.0, rolling_energy(knowledge.robot, 1.0) / knowledge.robot.weight)}
