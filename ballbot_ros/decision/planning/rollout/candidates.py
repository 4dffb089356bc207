# SPDX-License-Identifier: Apache-2.0
"""
Plans worth trying: few numbers each, which reach what the best that was found reaches.

An approach under the speed law up to a speed, and a swing of the pendulum to an angle at a
distance before the touch, held until the edge is passed: those three numbers come within 2 mm of
the highest steps that any plan was found to cross, and the same regions are best for all robots
drawn.  A swing from far off is all the lean there is.
"""
from dataclasses import dataclass, replace
import math
from typing import List, Sequence

import numpy as np

from ballbot_ros.decision.planning.rollout.ahead import Ahead, End
from ballbot_ros.decision.planning.rollout.layout import (
    EDGE, EDGE_AT, NEXT_AT, PLAN, SPEED, START, SWING_ANGLE, SWING_AT)
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.decision.values import Strategy
from ballbot_ros.physics.model.terrain import Array

SPEEDS = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1)  # [m/s]
SWINGS = (0.1, 0.2, 0.3, 0.42, 0.6, 0.9)  # before the touch [m]
ANGLES = (1.5, 2.2)  # [rad]
# Faster than it rolls by less than this is not an acceleration [m/s].
SAME = 0.05
# Acceleration with all the lean there is, about [m/s2].
BRISK = 0.75


@dataclass(frozen=True)
class Candidate:
    """
    A plan relative to the faces, so that it follows updates of their positions.

    Attributes
    ----------
    strategy : Strategy
    speed : float
        Of the approach [m/s].
    swing : float
        Distance before the touch at which the pendulum swings [m]; -inf for never.
    angle : float
        Swing angle [rad].
    faces : int
        Number of faces that it crosses.
    back : float
        Distance before the touch at which it starts from rest [m]; 0 for the present position.

    """

    strategy: Strategy
    speed: float
    swing: float = -math.inf
    angle: float = 0.0
    faces: int = 1
    back: float = 0.0

    @property
    def briskness(self) -> float:
        """Return about the speed that it touches with, to try gentle ones first [m/s]."""
        return math.sqrt(self.speed**2 + 2.0 * BRISK * max(self.swing, 0.0))

    def row(self, ahead: Ahead) -> Array:
        """Return the plan as rollouts read it, (PLAN,)."""
        row = np.zeros(PLAN)
        end = self.end(ahead)
        row[SPEED] = self.speed
        row[SWING_AT] = ahead.touch - self.swing
        row[SWING_ANGLE] = self.angle
        row[START] = ahead.touch - self.back if self.back > 0.0 else math.inf
        row[EDGE] = end.passed
        row[EDGE_AT], row[NEXT_AT] = end.vertex, end.following
        return row

    def end(self, ahead: Ahead) -> End:
        """Return where it ends: the face that it was made for, or the last one that is left."""
        for end in ahead.ends:
            if end.faces >= self.faces:
                return end
        return ahead.ends[-1]


def candidates(ahead: Ahead, position: float, speed: float, tuning: DecisionTuning,
               reachable: float) -> List[Candidate]:
    """
    Return plans from here.

    Parameters
    ----------
    ahead : Ahead
        With at least one end.
    position, speed : float
        Of the ball [m], [m/s].
    tuning : DecisionTuning
    reachable : float
        Speed that no approach from here exceeds [m/s].

    """
    run_up = ahead.touch - position
    cruise = min(max(tuning.cruise_speed, speed), tuning.highest_speed)
    speeds = [cruise] + [item for item in SPEEDS
                         if cruise + SAME < item <= tuning.highest_speed]
    # Of those that cannot be reached one is enough.
    beyond = [item for item in speeds if item > reachable]
    speeds = [item for item in speeds if item <= reachable] + beyond[:1]
    found = []
    for end in ahead.ends:
        for item in speeds:
            gentle = Strategy.CRUISE if item <= cruise + SAME else Strategy.ACCELERATE
            found.append(Candidate(gentle, item, faces=end.faces))
        for item in speeds:
            found += swings(Candidate(Strategy.SWING, item, faces=end.faces), run_up, tuning)
    return [replace(item, strategy=Strategy.CARRY) if item.faces > 1 else item
            for item in found]


def swings(plain: Candidate, run_up: float, tuning: DecisionTuning) -> List[Candidate]:
    """Return a candidate with the swings that fit into its run-up [m]."""
    # A swing from farther back than the ball is one that begins now.
    near = [item for item in SWINGS if item < run_up]
    fitting = near if len(near) == len(SWINGS) else [*near, max(run_up, 0.02)]
    return [replace(plain, swing=swing, angle=angle) for swing in fitting for angle in ANGLES
            if angle <= tuning.largest_swing]


def from_farther_back(ahead: Ahead, position: float, room: float, tuning: DecisionTuning,
                      backs: Sequence[float] = (0.5, 0.8, 1.2, 1.8)) -> List[Candidate]:
    """Return plans that start at rest, up to `room` [m] behind the ball, nearest first."""
    run_up = ahead.touch - position
    most = run_up + room
    fitting = [back for back in backs if run_up + 0.1 < back < most]
    if most > run_up + 0.1 and most < backs[-1]:
        fitting.append(most)
    found = []
    for back in fitting:
        for end in ahead.ends:
            plain = [Candidate(Strategy.BACK_OFF, item, faces=end.faces, back=back)
                     for item in (0.7, 0.9, 1.0, 1.1) if item <= tuning.highest_speed]
            for item in plain:
                found.append(item)
                found += [one for one in swings(item, back, tuning)
                          if one.angle < 2.2 and (one.swing > 0.2 or back < 0.6)]
    return found
