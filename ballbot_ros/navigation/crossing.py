# SPDX-License-Identifier: Apache-2.0
"""Set-points for the commands of a navigator; the obstacle decision drives the crossings."""
from typing import Iterable, Optional

from ballbot_ros.control import Mode, SetPoint
from ballbot_ros.decision import CrossGoal, Decider, Ending, Knowledge, Motion, Observation
from ballbot_ros.navigation.execution import Command, CrossingReport


class CrossingDriver:
    """
    Executes the crossings of a route with a `Decider`.

    The decider keeps the learned parameters of the robot between crossings and discards the
    terrain, because the odometry axis is the line of the crossing.

    Parameters
    ----------
    knowledge : Knowledge

    """

    def __init__(self, knowledge: Knowledge):
        self.decider = Decider(knowledge, 'rollout')
        self._goal: Optional[CrossGoal] = None
        self._touched = False
        self._report: Optional[CrossingReport] = None

    def end(self) -> None:
        """End the crossing; the caller stops the ball."""
        if self._goal is not None:
            self._goal = None
            self.decider.goals.end()

    def take_report(self) -> Optional[CrossingReport]:
        """Return and clear the report of a crossing that has ended, None if there is none."""
        report, self._report = self._report, None
        return report

    def set_point(self, command: Command, motion: Motion, observations: Iterable[Observation]
                  ) -> SetPoint:
        """
        Return the set-point of a command.

        Parameters
        ----------
        command : Command
            One that crosses starts or continues a crossing; any other ends it.
        motion : Motion
            Motion along the line of the crossing.
        observations : iterable of Observation
            Terrain observations, used during a crossing.

        """
        if not command.crosses:
            self.end()
            return SetPoint(Mode.SPEED, command.speed, motion.stamp, command.yaw_rate)
        decider = self.decider
        if self._goal is None:
            decider.reset()
            self._goal, self._touched = CrossGoal(motion, 0.0), False
            decider.goals.begin(self._goal)
        decider.move(motion)
        for observation in observations:
            decider.observe(observation)
        answer = decider.decide()
        if decider.outcome is not None or answer.decision.contact_since is not None:
            self._touched = True
        if decider.end is not None:
            end = decider.end
            self._report = CrossingReport(
                end.ending is Ending.CROSSED, end.message, self._goal.height, self._touched)
            self._goal = None
        return SetPoint(Mode.HOLD, answer.set_angle, motion.stamp, command.yaw_rate)
