# SPDX-License-Identifier: Apache-2.0
"""The node ``obstacle_decision``: decisions about the step ahead, and set-points."""
from collections import Counter
from functools import partial
import math
import time
from typing import Any, Callable, Dict, List, Optional, Tuple

from builtin_interfaces.msg import Time
from nav_msgs.msg import Odometry
from rclpy.node import Node

from ballbot_ros.control import load_tuning
from ballbot_ros.decision import (
    check_decision, Decider, Decision, Kind, Knowledge, load_curve, Observation, Reason)
from ballbot_ros.errors import MessageError
from ballbot_ros.nodes.obstacle_decision.goals import GoalServers
from ballbot_ros.nodes.obstacle_decision.outcomes import Experience
from ballbot_ros.nodes.obstacle_decision.outputs import DecisionOutputs
from ballbot_ros.nodes.obstacle_decision.settings import DecisionSettings
from ballbot_ros.nodes.obstacle_decision.standstill import Standstill
from ballbot_ros.physics.model.robot import load_robot
from ballbot_ros.ros import diagnostics
from ballbot_ros.ros.conversions import exact, motion, observation, terrain_observation, to_seconds
from ballbot_ros.ros.endpoints import create_subscription, publisher_names
from ballbot_ros.ros.parameters import Commit, declare
from ballbot_ros.ros.run import run
from ballbot_ros.ros.single_publisher import SinglePublisher

# Without an observation for this time, odometry also triggers set-points [s].
LONGEST_SILENCE = 0.025

# Minimum time between two logged changes of the decision [s].
LOG_PERIOD = 1.0

OBSERVATIONS: Dict[str, Callable[[Any], Observation]] = {
    'step_observation': observation, 'terrain_observation': terrain_observation}


def load_knowledge(settings: DecisionSettings) -> Knowledge:
    """Load robot, curve and tuning; raise `ConfigurationError` if they are inconsistent."""
    knowledge = Knowledge(
        load_robot(settings.robot), load_curve(settings.curve, settings.variant),
        settings.margins, load_tuning(settings.control_tuning))
    check_decision(knowledge.robot, knowledge.curve, knowledge.tuning)
    return knowledge


class ObstacleDecision(Node):
    """
    Decides and publishes set-points; `DecisionSettings` has its parameters.

    An observation waits for odometry that is at least as new, so that the decision depends only on
    stamps and not on the order of arrival.
    """

    def __init__(self, **kwargs: Any):
        """Check that robot, curve and tuning are consistent, then wait for messages."""
        super().__init__('obstacle_decision', **kwargs)
        settings = declare(self, DecisionSettings, self._prepare)
        knowledge = load_knowledge(settings)
        self._experience = Experience(settings.outcome_log, knowledge, settings.planner,
                                      self.get_logger())
        self._decider = Decider(self._experience.knowledge, settings.planner,
                                settings.terrain_frame)
        self._odometry: Optional[Odometry] = None
        self._observed: Any = None  # the newest observation that waits for odometry
        self._seen: Dict[type, Tuple[int, int]] = {}
        self._counts: Counter = Counter()
        self._logged: Tuple[Any, float] = None, -math.inf  # label and time of a decision
        self._outputs = DecisionOutputs(self, settings, knowledge.robot.ball_radius)
        self._sources = {topic: SinglePublisher(self, topic) for topic in (*OBSERVATIONS, 'odom')}
        for topic in OBSERVATIONS:
            create_subscription(self, topic, partial(self._on_observation, topic))
        create_subscription(self, 'odom', self._on_odometry)
        self._decider.goals.waiting = settings.wait_for_goal
        self._standstill = Standstill(self, self._stand, self._go_on)
        self._goals = GoalServers(self, self._decider, self._standstill)
        self._diagnostics = diagnostics.Diagnostics(
            self, 'decision', self._health, knowledge.robot.name)

    def _prepare(self, wanted: DecisionSettings) -> Commit:
        return self._decider.prepare(load_knowledge(wanted))

    def _refusal(self, topic: str) -> str:
        """Return why messages of a topic are not used, or an empty string."""
        try:
            self._sources[topic].name()
        except MessageError as error:
            self.get_logger().warning(f'{topic} refused: {error}', throttle_duration_sec=1.0)
            return str(error)
        return ''

    def _on_observation(self, topic: str, message: Any) -> None:
        if self._refusal(topic):
            return
        if self._seen.get(type(message)) == exact(message):
            # No new decision for a repeated observation: it could differ.
            if self._observed is None:
                self._outputs.repeat()
            return
        self._seen[type(message)] = exact(message)
        self._decider.observe(OBSERVATIONS[topic](message))
        self._observed = message
        self._decide_pending()

    def _on_odometry(self, message: Odometry) -> None:
        if self._refusal('odom'):
            return
        if self._odometry is not None and exact(message) < exact(self._odometry):
            self.get_logger().warning('time went back: all previous observations are dropped',
                                      throttle_duration_sec=1.0)
            self._reset('time went back')
        self._odometry = message
        self._decider.move(motion(message))
        self._decide_pending()
        # The ball also needs set-points between observations and after the last one.
        if to_seconds(message.header.stamp) - self._outputs.time > LONGEST_SILENCE:
            self._decide(message.header.stamp, message)

    def _reset(self, why: str) -> None:
        self._goals.abort(why)
        self._decider.reset()
        self._outputs.forget()
        self._observed = self._odometry = None
        self._seen.clear()

    def _stand(self) -> None:
        """Discard the decision, so that no plan outlives an e-stop, and command rest."""
        self._reset('the e-stop is engaged')
        self._outputs.rest(Time())

    def _go_on(self) -> bool:
        """Follow the decision without goals; return whether this changes the mode."""
        waiting = self._decider.goals.waiting
        self._decider.goals.go_on()
        return waiting

    def _decide_pending(self) -> None:
        """Decide on the newest observation, if odometry is at least as new."""
        if self._observed is not None and self._odometry is not None \
                and exact(self._odometry) >= exact(self._observed):
            stamp, self._observed = self._observed.header.stamp, None
            self._decide(stamp, self._odometry)

    def _decide(self, stamp: Time, odometry: Odometry) -> None:
        """Publish a decision with the stamp of its observation, and the current set-point."""
        if self._standstill.standing:
            return self._outputs.rest(odometry.header.stamp)
        decision = (answer := self._decider.decide()).decision
        self._experience.keep(self._decider.outcome)
        self._counts[decision.kind.value] += 1
        self._outputs.decide(stamp, answer, odometry)
        self._goals.step()
        self._log_change(decision)

    def _log_change(self, decision: Decision) -> None:
        """Log a decision that differs from the last logged one, at most once per period."""
        label, now = (decision.kind, decision.reason), time.monotonic()
        if label != self._logged[0] and now - self._logged[1] >= LOG_PERIOD:
            self._logged = label, now
            self.get_logger().info(f'{decision.kind.name}: {decision.explanation}')

    def make_safe(self) -> None:
        """End the goal, lower the pendulum and write the outcome log."""
        self._goals.abort('obstacle_decision was ended')
        if self._odometry is not None:
            self._outputs.end(self._odometry.header.stamp)
        self._experience.close()

    def _health(self) -> Tuple[bytes, str, dict]:
        values: Dict[str, object] = {**self._experience.problem, **{
            f'decided_{kind}': number for kind, number in self._counts.items()}}
        if self._standstill.standing:
            return diagnostics.WARN, self._standstill.reason, values
        several = ' '.join(filter(None, map(self._refusal, self._sources)))
        if several:
            return diagnostics.WARN, several, values
        decision, profile = self._decider.decision, self._decider.profile
        if decision is None:
            return diagnostics.WARN, 'waiting for step_observation and odom', values
        values['set_speed'] = f'{decision.set_speed:.3f}'
        rejected = profile is not None and profile.rejection is not None
        level = diagnostics.WARN if rejected or decision.kind is Kind.STOP else diagnostics.OK
        if decision.reason is not Reason.STALE:
            return level, decision.explanation, values
        names = ', '.join(filter(None, (publisher_names(self, topic) for topic in OBSERVATIONS)))
        return level, f'{decision.explanation}; published by {names or "no node"}', values


def main(args: Optional[List[str]] = None) -> int:
    return run(ObstacleDecision, args)
