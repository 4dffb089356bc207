# SPDX-License-Identifier: Apache-2.0
"""Update the particle weights by the likelihood of each outcome."""
from collections import deque
from typing import Deque, Iterable, Optional, Tuple

import numpy as np

from ballbot_ros.decision.learning.chances import Chances, TOUCH_SPEED_MIN, Touching
from ballbot_ros.decision.learning.outcomes import Outcome
from ballbot_ros.decision.learning.particles import Particles

# Minimum height of a step for learning [m].
HEIGHT_MIN = 0.002
# Maximum number of pending outcomes; the oldest are dropped first.
PENDING_MAX = 64


class Learner:
    """Updates the particles from outcomes in small portions, so that no decision is delayed."""

    def __init__(self, particles: Particles):
        self.particles = particles
        self._waiting: Deque[Outcome] = deque(maxlen=PENDING_MAX)
        self._current: Optional[Tuple[Outcome, Chances]] = None

    def take(self, outcome: Outcome) -> bool:
        """Queue an outcome for learning; return whether it is usable."""
        usable = (HEIGHT_MIN < outcome.height < self.particles.robot.ball_radius
                  and outcome.touch_speed > TOUCH_SPEED_MIN and outcome.robot in (
                      '', self.particles.robot.digest))
        if usable:
            self._waiting.append(outcome)
        return usable

    def advance(self, attempts: Optional[int] = None) -> bool:
        """Run some attempts, or all pending ones; return whether the particles have changed."""
        changed = False
        while self._current or self._waiting:
            if self._current is None:
                outcome = self._waiting.popleft()
                self._current = outcome, Chances(self.particles, Touching.of(outcome))
            outcome, chances = self._current
            if not chances.advance(attempts):
                return changed
            self.particles = self.particles.reweighted(np.log(chances.likelihood(outcome)))
            self._current, changed = None, True
            if attempts is not None:
                return changed
        return changed


def learned(particles: Particles, outcomes: Iterable[Outcome]) -> Particles:
    """Return particles updated by outcomes in their order; unusable outcomes are ignored."""
    learner = Learner(particles)
    for outcome in outcomes:
        if learner.take(outcome):
            learner.advance()
    return learner.particles
