# SPDX-License-Identifier: Apache-2.0
"""Inputs of a planner: constant ones, and those of each decision."""
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
import math
from typing import List, Optional, Protocol, Tuple

from ballbot_ros.control import ControlTuning, load_tuning
from ballbot_ros.decision.learning.particles import Particles
from ballbot_ros.decision.planning.braking import Braking
from ballbot_ros.decision.planning.curve import HeightCurve, load_curve
from ballbot_ros.decision.tuning import check_decision, DecisionTuning, load_decision_tuning
from ballbot_ros.decision.values import (
    Decision, Face, Failure, Motion, Obstruction, Profile, UNSEEN)
from ballbot_ros.physics.model.robot import load_robot, Robot


@dataclass(frozen=True)
class Knowledge:
    """
    Constant planner inputs; robot, curve and tuning must be consistent.

    See `tuning.check_decision`.

    Attributes
    ----------
    robot : Robot
    curve : HeightCurve
    tuning : DecisionTuning
    control : ControlTuning
        Gains of the position controller (eq. 11) that executes the set angles.
    seed : int
    particles : Particles or None
        Initial samples of robot and sensor; None for the prior of the robot file.

    """

    robot: Robot
    curve: HeightCurve
    tuning: DecisionTuning
    control: ControlTuning = field(default_factory=lambda: load_tuning('published'))
    seed: int = 0
    particles: Optional[Particles] = None

    @cached_property
    def braking(self) -> Braking:
        """Return the guaranteed accelerations and distances of the robot."""
        return Braking(self.robot, self.tuning, self.control)

    @property
    def initial_particles(self) -> Particles:
        """Return the given particles, or draw the prior of the robot file."""
        return self.particles or Particles.of(self.robot, self.tuning.height_bias_sd)


@lru_cache(maxsize=1)
def nominal_knowledge() -> Knowledge:
    """Return the assumptions of the decision: the nominal robot, curve and tunings."""
    known = Knowledge(load_robot('gimball'), load_curve('gimball_down'),
                      load_decision_tuning('decision_default'))
    check_decision(known.robot, known.curve, known.tuning)
    return known


@dataclass(frozen=True)
class Situation:
    """
    Planner inputs of one decision.

    Attributes
    ----------
    motion : Motion
        The newest odometry, with the state that the pilot estimates.
    profile : Profile
        `UNSEEN` before the first observation.
    failures : tuple of Failure
        Plans that failed, at any face.
    free_from : float
        Farthest position behind the ball to which it may roll back [m].
    obstruction : Obstruction or None
    particles : Particles or None
        Samples updated by outcomes; None for those of the `Knowledge`.

    """

    motion: Motion
    profile: Profile = UNSEEN
    failures: Tuple[Failure, ...] = ()
    free_from: float = float('inf')
    obstruction: Optional[Obstruction] = None
    particles: Optional[Particles] = None

    def failures_at(self, face: Face) -> List[Failure]:
        """Return the failed plans at a face."""
        return [failure for failure in self.failures if failure.is_at(face.position)]

    @property
    def slope(self) -> float:
        """Return the slope below the ball, from observations or else from its motion [rad]."""
        seen = self.profile.slope
        return seen if math.isfinite(seen) else self.motion.slope

    @property
    def slope_sd(self) -> float:
        """Return the standard deviation of `slope` [rad]."""
        seen = self.profile.slope_sd
        return seen if math.isfinite(seen) else self.motion.slope_sd


class Planner(Protocol):
    """Interface of a planner; its only state is cached results."""

    def __call__(self, situation: Situation, previous: Optional[Decision]) -> Decision:
        """
        Return the decision on the terrain ahead, given the previous one.

        Uncertain inputs result in STOP with a reason.  Sensor data never raise an exception.
        """
