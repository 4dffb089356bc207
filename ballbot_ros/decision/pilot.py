# SPDX-License-Identifier: Apache-2.0
"""Carry out a decision: the set angle of the pendulum, anew at each odometry."""
from ballbot_ros.decision.approach import set_angle
from ballbot_ros.decision.situation import Knowledge
from ballbot_ros.decision.values import Decision, Motion


class Pilot:
    """Turns decisions and motion into set angles for law (11)."""

    def __init__(self, knowledge: Knowledge):
        """Start with the pendulum hanging down."""
        self._knowledge = knowledge

    def reset(self) -> None:
        """Forget what was learned on the way."""

    def angle(self, decision: Decision, motion: Motion) -> float:
        """
        Return the set angle of the pendulum [rad].

        Absolute, positive to speed up.
        """
        return set_angle(decision, motion.speed, self._knowledge.robot, self._knowledge.tuning)
