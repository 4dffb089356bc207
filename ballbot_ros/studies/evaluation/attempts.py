# SPDX-License-Identifier: Apache-2.0
"""Crossings that were begun: what was promised of them, and which are the same again."""
from dataclasses import dataclass
import math
from typing import Optional, Tuple

from ballbot_ros.decision.values import Decision, Kind

SLACK = 0.06  # between a face and where it is believed to be [m]


@dataclass
class JudgedAttempt:
    """A crossing that was begun: all as it was when the ball touched the face."""

    time: float
    x: float           # [m]
    face: float        # [m]
    speed: float       # [m/s]
    strategy: str
    probability: float  # promised; NaN where nothing was
    edge: float        # last one of the plan [m]
    plan: Tuple[float, ...]  # start, speed, swing position and angle; or the set speed
    same: bool = False  # as one that has failed at this face
    over: Optional[bool] = None
    settled: float = 0.0  # when that was known [s]


def last_edge(decision: Decision, x: float) -> float:
    """Return the last edge that a crossing takes [m]; the ball is at x."""
    if decision.plan is not None and math.isfinite(decision.plan.edge):
        return decision.plan.edge
    return x + decision.distance


def crosses(decision: Decision, x: float, place: float) -> bool:
    """Return whether a decision made at x means to cross a face [m]."""
    return decision.kind is Kind.CROSS and last_edge(decision, x) >= place - SLACK


def alike(one: JudgedAttempt, other: JudgedAttempt) -> bool:
    """Return whether two attempts at a face are the same plan."""
    if abs(one.face - other.face) > SLACK or one.strategy != other.strategy:
        return False
    if len(one.plan) == 1:
        return abs(one.plan[0] - other.plan[0]) < 0.05
    near = (0.1, 0.05, 0.03, 0.1)
    return all(a == b or abs(a - b) < within
               for a, b, within in zip(one.plan, other.plan, near))
