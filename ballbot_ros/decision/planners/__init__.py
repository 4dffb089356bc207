# SPDX-License-Identifier: Apache-2.0
"""
How a decision is made: a module for each planner, and the only table of them.

For a further one copy `cubic.py`, change its function `decide`, and add a line to `PLANNERS`:
the parameter `planner` of the node ``obstacle_decision`` then takes its name.
"""
from typing import Mapping, Optional, Protocol

from ballbot_ros.decision.curve import HeightCurve
from ballbot_ros.decision.planners import cubic
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.decision.values import Decision, Motion, Track
from ballbot_ros.physics.model.robot import Robot


class Planner(Protocol):
    """What every planner promises: a pure function of what is known to what to do."""

    def __call__(self, track: Optional[Track], motion: Motion,
                 previous: Optional[Decision], *, robot: Robot, curve: HeightCurve,
                 tuning: DecisionTuning) -> Decision:
        """
        Decide on the step ahead.

        Parameters
        ----------
        track : Track or None
            The tracker's last answer; None if there was none yet.
        motion : Motion
            Now.
        previous : Decision or None
            The last answer of this function: it is all the memory there is.
        robot, curve, tuning
            That belong together; see `check_decision`.

        Returns
        -------
        Decision
            Whatever is not known for certain is answered with STOP and a reason.  Nothing is
            raised for anything that a sensor says.

        """


PLANNERS: Mapping[str, Planner] = {'cubic': cubic.decide}
