# SPDX-License-Identifier: Apache-2.0
"""The complete decision without ROS: observations and odometry in, decision and set angle out."""
from dataclasses import replace
from typing import Callable, NamedTuple, Optional, Union

from ballbot_ros.decision.execution.attempts import AttemptWatch
from ballbot_ros.decision.execution.goals import GoalEnd, Goals
from ballbot_ros.decision.execution.memory import Memory
from ballbot_ros.decision.execution.pilot import Pilot
from ballbot_ros.decision.learning.learner import Learner
from ballbot_ros.decision.learning.outcomes import Outcome
from ballbot_ros.decision.perception import GroundFusion, Observation
from ballbot_ros.decision.planning.planners import PLANNERS
from ballbot_ros.decision.planning.safety_filter import with_safety_filter
from ballbot_ros.decision.planning.situation import Knowledge, Planner, Situation
from ballbot_ros.decision.values import (
    Decision, Motion, Profile, StepObservation, TerrainObservation, UNSEEN)

# Attempts that are simulated for learning from earlier outcomes.
LEARNING_ROLLOUTS_PER_DECISION = 16


class Answer(NamedTuple):
    """
    Result of a decision.

    Attributes
    ----------
    stamp : float
        Time of the motion [s].
    decision : Decision
    set_angle : float
        Set angle of the pendulum for law (11) [rad].

    """

    stamp: float
    decision: Decision
    set_angle: float


class Decider:
    """
    Estimates the terrain from observations and odometry, and decides.

    Observations are fused at the ball position at their stamp; decisions use the latest
    odometry.  The result depends on stamps alone, not on arrival times.

    Parameters
    ----------
    knowledge : Knowledge
    planner : str or callable
        One of `PLANNERS`, or a factory with the same signature.
    frame : str
        Required frame of terrain polylines.

    Attributes
    ----------
    knowledge : Knowledge
        The present one, see `prepare`.
    goals : Goals
        Limits how far decisions are executed; no limit without a goal.
    motion : Motion or None
        The newest odometry.
    planned, decision : Decision or None
        The last decision, before and after the limits of a goal.
    outcome : Outcome or None
        Set if the last call of `decide` ended an attempt.
    end : GoalEnd or None
        Set if the last call of `decide` ended a goal.

    """

    knowledge: Knowledge
    _plan: Planner

    def __init__(self, knowledge: Knowledge,
                 planner: Union[str, Callable[[Knowledge], Planner]] = 'cubic',
                 frame: str = 'base_link'):
        self._learner = Learner(knowledge.initial_particles)
        self._maker = PLANNERS[planner] if isinstance(planner, str) else planner
        self._fusion = GroundFusion(knowledge.robot, knowledge.tuning, frame)
        self._pilot = Pilot(knowledge)
        self._memory = Memory(knowledge.tuning, knowledge.robot.ball_radius)
        self._watch = AttemptWatch(knowledge.robot)
        self.goals = Goals()
        self.prepare(knowledge)()
        self.reset()

    def reset(self) -> None:
        """Discard the state, after a jump in time or position."""
        self._fusion.reset()
        self._pilot.reset()
        self._memory.reset()
        self._watch.reset()
        self.motion: Optional[Motion] = None
        self.outcome: Optional[Outcome] = None
        self.planned: Optional[Decision] = None
        self.decision: Optional[Decision] = None
        self.end: Optional[GoalEnd] = None

    def prepare(self, knowledge: Knowledge) -> Callable[[], None]:
        """
        Prepare another curve, tuning or controller; return the function that activates it.

        The terrain estimate, the particles and the slope estimate are kept; plans are discarded.
        The robot and the fixed parameters of the tuning must not change.
        """
        knowledge = replace(knowledge, particles=self._learner.particles)
        plan = with_safety_filter(self._maker(knowledge), knowledge)

        def activate() -> None:
            self.knowledge, self._plan = knowledge, plan
            self._pilot.follow(knowledge)
            self._fusion.follow(knowledge.tuning, knowledge.braking.steepest)
        return activate

    @property
    def profile(self) -> Optional[Profile]:
        """Return the estimated terrain ahead, None before the first observation."""
        return self._fusion.profile

    @property
    def free_from(self) -> float:
        """Return the farthest position behind to which the ball may roll back [m]."""
        return self._memory.free_from

    def observe(self, observation: Observation) -> None:
        """Add an observation; it is fused with the first odometry that is not older."""
        self._fusion.observe(observation)

    def move(self, motion: Motion) -> None:
        """Add odometry, not older than the last."""
        self.motion = motion
        self._fusion.move(motion)

    def decide(self) -> Answer:
        """
        Return the decision for the newest odometry; `move` must have been called.

        Sensor data never raise an exception.
        """
        if self.motion is None:
            raise RuntimeError('decide was called before move')
        self._fusion.fuse()
        attempt = self._watch.attempt
        motion = self._pilot.estimate(
            self.motion, None if attempt is None else attempt.face.position)
        memory, profile = self._memory, self._fusion.at(motion) or UNSEEN
        memory.move(motion, profile)
        situation = Situation(motion, profile, tuple(memory.failures), memory.free_from,
                              memory.obstruction, self._learner.particles)
        self.planned = planned = self._plan(situation, self.planned)
        self.decision = decision = self.goals.constrain(planned, motion)
        self.outcome = self._watch.update(motion, profile, decision)
        if self.outcome is not None:
            memory.take(self.outcome)
            self._learner.take(self.outcome)
        self._learner.advance(LEARNING_ROLLOUTS_PER_DECISION)
        memory.watch(motion, decision, self._pilot.at_emergency_lean)
        self.end = self.goals.update(planned, motion, self.outcome)
        return Answer(motion.stamp, decision, self._pilot.angle(
            decision, replace(motion, slope=situation.slope)))


def warm_up(knowledge: Knowledge, planner: str) -> None:
    """
    Compile all kernels of the decision, and run them once, before their first use.

    The run is a simulated approach to a step, with an outcome.
    """
    rehearsal = Decider(knowledge, planner)
    floor = tuple(0.02 * number - 0.2 for number in range(100))
    for number in range(3):
        now = 0.02 * number
        rehearsal.observe(StepObservation(now, True, 1.0, 0.01, 0.01, 0.001))
        rehearsal.observe(TerrainObservation(
            now, floor, tuple(-knowledge.robot.ball_radius + 0.01 * (x > 1.0) for x in floor),
            (), floor[0], floor[-1]))
        rehearsal.move(Motion(now, 0.0, 0.3))
        rehearsal.decide()
    knowledge.braking.speed_within(1.0, 0.0)
    rehearsal._learner.take(Outcome(
        stamp=0.0, result='over', face=1, position=1.0, height=0.01, height_sd=0.001,
        touch_speed=0.6, touch_angle=0.0, held_angle=0.0, slope=0.0, distance=1.0, robot=''))
    rehearsal._learner.advance(1)
