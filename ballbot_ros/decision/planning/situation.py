# SPDX-License-Identifier: Apache-2.0
"""What a planner is told: once, and at each decision."""
from dataclasses import dataclass, field
from typing import Optional, Protocol, Tuple

from ballbot_ros.control import ControlTuning, load_tuning
from ballbot_ros.decision.learning.particles import Particles
from ballbot_ros.decision.planning.curve import HeightCurve
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.decision.values import Decision, Failure, Motion, Obstruction, Profile
from ballbot_ros.physics.model.robot import Robot


@dataclass(frozen=True)
class Knowledge:
    """
    What holds for all decisions; robot, curve and tuning must belong together.

    See `tuning.check_decision`.

    Attributes
    ----------
    robot : Robot
    curve : HeightCurve
    tuning : DecisionTuning
    control : ControlTuning
        That the controller runs with: law (11) makes of the set angles what it says.
    seed : int
    particles : Particles or None
        Robots and sensors that may be the ones at hand, as known at the start; None for what
        the robot file says.

    """

    robot: Robot
    curve: HeightCurve
    tuning: DecisionTuning
    control: ControlTuning = field(default_factory=lambda: load_tuning('published'))
    seed: int = 0
    particles: Optional[Particles] = None


@dataclass(frozen=True)
class Situation:
    """
    What is known now.

    Attributes
    ----------
    motion : Motion
        Propagated to when an answer will act.
    profile : Profile or None
        None if nothing was observed yet.
    failures : tuple of Failure
        What was tried at faces ahead.
    free_from : float
        Farthest position behind the ball to which it may roll back [m].
    obstruction : Obstruction or None
    particles : Particles or None
        Robots and sensors that may be the ones at hand, as outcomes have taught since; None for
        those of the `Knowledge`.

    """

    motion: Motion
    profile: Optional[Profile] = None
    failures: Tuple[Failure, ...] = ()
    free_from: float = float('inf')
    obstruction: Optional[Obstruction] = None
    particles: Optional[Particles] = None


class Planner(Protocol):
    """What every planner promises; it may keep what it has worked out, and nothing else."""

    def __call__(self, situation: Situation, previous: Optional[Decision]) -> Decision:
        """
        Decide on the ground ahead.

        Parameters
        ----------
        situation : Situation
        previous : Decision or None
            The last answer.

        Returns
        -------
        Decision
            Whatever is not known for certain is answered with STOP and a reason.  Nothing is
            raised for anything that a sensor says.

        """
