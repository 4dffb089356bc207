# SPDX-License-Identifier: Apache-2.0
"""The whole decision without ROS: observations and odometry in, decision and set angle out."""
from bisect import bisect_left
from collections import deque
from typing import Callable, Deque, NamedTuple, Optional, Union

from ballbot_ros.decision.guard import guarded
from ballbot_ros.decision.perception import Observation, ProfileTracker
from ballbot_ros.decision.pilot import Pilot
from ballbot_ros.decision.planners import PLANNERS
from ballbot_ros.decision.profile import Profile
from ballbot_ros.decision.situation import Knowledge, Planner, Situation
from ballbot_ros.decision.values import Decision, Motion

# So many odometry messages and observations are kept while the other lags behind.
KEPT = 100


class Answer(NamedTuple):
    """
    What to do now.

    Attributes
    ----------
    stamp : float
        Of the motion that is answered [s].
    decision : Decision
    set_angle : float
        Of the pendulum, for law (11) [rad].

    """

    stamp: float
    decision: Decision
    set_angle: float


class Decider:
    """
    Keeps what is known from one message to the next, and decides.

    Observations are fused at the position that the ball had when they were made; decisions are
    made for the newest odometry.  The answer depends on stamps alone, not on when a message
    happened to arrive.

    Parameters
    ----------
    knowledge : Knowledge
    planner : str or callable
        One of `PLANNERS`, or what makes a planner of knowledge as those do.

    """

    def __init__(self, knowledge: Knowledge,
                 planner: Union[str, Callable[[Knowledge], Planner]] = 'cubic'):
        """Start with nothing seen."""
        self._knowledge = knowledge
        maker = PLANNERS[planner] if isinstance(planner, str) else planner
        self._plan = guarded(maker(knowledge), knowledge)
        self._tracker = ProfileTracker(knowledge.robot, knowledge.tuning)
        self._pilot = Pilot(knowledge)
        self.reset()

    def reset(self) -> None:
        """Forget all, for a jump of time or place."""
        self._tracker.reset()
        self._pilot.reset()
        self._motions: Deque[Motion] = deque(maxlen=KEPT)
        self._pending: Deque[Observation] = deque(maxlen=KEPT)
        self._profile: Optional[Profile] = None
        self._decision: Optional[Decision] = None

    @property
    def profile(self) -> Optional[Profile]:
        """Return the ground ahead as it is believed to be, None before the first observation."""
        return self._profile

    @property
    def decision(self) -> Optional[Decision]:
        """Return the last decision."""
        return self._decision

    def observe(self, observation: Observation) -> None:
        """Take an observation; it is fused when there is odometry that is not older."""
        self._pending.append(observation)

    def move(self, motion: Motion) -> None:
        """Take odometry, not older than the last."""
        self._motions.append(motion)

    def fuse(self) -> Optional[float]:
        """Fuse observations for which there is odometry; return the stamp of the last one [s]."""
        stamp = None
        while self._pending and self._motions \
                and self._motions[-1].stamp >= self._pending[0].stamp:
            observation = self._pending.popleft()
            self._profile = self._tracker.update(
                observation, self._position_at(observation.stamp))
            stamp = observation.stamp
        return stamp

    def decide(self) -> Answer:
        """
        Return what to do, at the newest odometry; `move` must have been called.

        Nothing is raised for anything that a sensor says.
        """
        self.fuse()
        motion = self._motions[-1]
        situation = Situation(self._pilot.feel(motion), self._profile)
        self._decision = decision = self._plan(situation, self._decision)
        return Answer(motion.stamp, decision, self._pilot.angle(decision, motion))

    def _position_at(self, stamp: float) -> float:
        """Return the position at a time that odometry covers, or the nearest to it [m]."""
        motions = self._motions
        after = bisect_left(motions, stamp, key=lambda item: item.stamp)
        if after == 0:
            return motions[0].position
        if after == len(motions):
            return motions[-1].position
        early, late = motions[after - 1], motions[after]
        part = (stamp - early.stamp) / (late.stamp - early.stamp)
        return early.position + part * (late.position - early.position)
