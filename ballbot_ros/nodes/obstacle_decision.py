# SPDX-License-Identifier: Apache-2.0
"""The node ``obstacle_decision``: what to do about the step ahead, and a set-point for it."""
from collections import Counter, deque
import sys
from typing import Any, Deque, Dict, List, Optional, Tuple

from builtin_interfaces.msg import Time
from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import JointState

from ballbot_ros.decision import (
    check_decision, Decision, Kind, load_curve, load_decision_tuning, Motion, PLANNERS, set_angle,
    StepTracker, Track)
from ballbot_ros.msg import StepDecision, StepObservation
from ballbot_ros.physics.model.robot import load_robot
from ballbot_ros.ros import diagnostics, qos
from ballbot_ros.ros.conversions import (
    decision_message, motion, observation, set_point_message, to_seconds)
from ballbot_ros.ros.endpoints import create_publisher, create_subscription, wait_until_received
from ballbot_ros.ros.parameters import declare
from ballbot_ros.ros.run import run
from ballbot_ros.ros.settings import DecisionSettings

# So many messages are kept while the other topic lags behind.
KEPT = 50


class ObstacleDecision(Node):
    """
    Decides and publishes set-points; see `DecisionSettings` for what can be set.

    An observation is judged with the first odometry that is not older than it, so that the
    answer depends on stamps alone and not on which message happened to arrive first.
    """

    def __init__(self, **kwargs: Any):
        """Check that robot, curve and tuning belong together, then wait."""
        super().__init__('obstacle_decision', **kwargs)
        settings = declare(self, DecisionSettings)
        self._robot = load_robot(settings.robot)
        self._curve = load_curve(settings.curve, settings.variant)
        self._tuning = load_decision_tuning(settings.tuning)
        check_decision(self._robot, self._curve, self._tuning)
        self._decide_on = PLANNERS[settings.planner]
        self._tracker = StepTracker(self._robot, self._tuning)
        self._track: Optional[Track] = None
        self._decision: Optional[Decision] = None
        self._odometry: Deque[Odometry] = deque(maxlen=KEPT)
        self._pending: Deque[StepObservation] = deque(maxlen=KEPT)
        self._counts: Counter = Counter()
        self._answer: Optional[Tuple[StepDecision, JointState]] = None
        self._decisions = create_publisher(self, StepDecision, 'step_decision', qos.LATCHED)
        self._set_points = create_publisher(self, JointState, 'set_point', qos.NEWEST)
        create_subscription(self, StepObservation, 'step_observation', self._on_observation,
                            qos.SHORT)
        create_subscription(self, Odometry, 'odom', self._on_odometry, qos.SHORT)
        self._diagnostics = diagnostics.Diagnostics(self, 'decision', self._health)

    def _on_observation(self, message: StepObservation) -> None:
        if self._answer is not None and _key(message) == _key(self._answer[0]):
            # The observation is repeated: to decide again might give another answer.
            self._publish()
            return
        self._pending.append(message)
        self._decide_pending()

    def _on_odometry(self, message: Odometry) -> None:
        if self._odometry and _key(message) < _key(self._odometry[-1]):
            self.get_logger().warning('time went back: all observations so far are dropped')
            self._odometry.clear()
            self._pending.clear()
            self._tracker.reset()
            self._track = self._decision = self._answer = None
        self._odometry.append(message)
        self._decide_pending()
        self._check_silence(message)

    def _decide_pending(self) -> None:
        """Decide on each observation for which there is odometry."""
        while self._pending:
            seen = self._pending[0]
            after = [item for item in self._odometry if _key(item) >= _key(seen)]
            if not after:
                return
            self._pending.popleft()
            now = motion(after[0])
            self._track = self._tracker.update(observation(seen), now.position)
            self._decide(seen.header.stamp, now)

    def _check_silence(self, message: Odometry) -> None:
        """Decide again when observations have timed out while odometry goes on."""
        if self._pending or self._decision is None or self._track is None:
            return
        silence = to_seconds(message.header.stamp) - self._track.stamp
        if silence > self._tuning.observation_timeout:
            self._decide(message.header.stamp, motion(message))

    def _decide(self, stamp: Time, now: Motion) -> None:
        """Publish a decision and the set-point that follows from it."""
        before = self._decision
        self._decision = decision = self._decide_on(
            self._track, now, before, robot=self._robot, curve=self._curve,
            tuning=self._tuning)
        self._counts[decision.kind.value] += 1
        angle = set_angle(decision, now.speed, self._robot, self._tuning)
        # Stamped with the observation: in lockstep this names the period that it is for.
        self._answer = decision_message(stamp, decision), set_point_message(stamp, angle)
        self._publish()
        if before is None or (before.kind, before.reason) != (decision.kind, decision.reason):
            self.get_logger().info(f'{decision.kind.name}: {decision.explanation}')

    def _publish(self) -> None:
        """Publish the newest decision and its set-point."""
        if self._answer is not None:
            self._decisions.publish(self._answer[0])
            self._set_points.publish(self._answer[1])

    def make_safe(self) -> None:
        """Let the pendulum down."""
        if self._decision is not None and self._odometry:
            self._set_points.publish(
                set_point_message(self._odometry[-1].header.stamp, 0.0))
            wait_until_received(self._set_points)

    def _health(self) -> Tuple[bytes, str, dict]:
        """Return level, message and numbers for /diagnostics."""
        values: Dict[str, object] = {
            f'decided_{kind}': number for kind, number in self._counts.items()}
        if self._decision is None:
            return diagnostics.WARN, 'waiting for step_observation and odom', values
        values['set_speed'] = f'{self._decision.set_speed:.3f}'
        rejected = self._track is not None and self._track.rejection is not None
        level = diagnostics.WARN if rejected or self._decision.kind is Kind.STOP \
            else diagnostics.OK
        return level, self._decision.explanation, values


def _key(message: Any) -> Tuple[int, int]:
    """Return a stamp for exact comparison."""
    return message.header.stamp.sec, message.header.stamp.nanosec


def main(args: Optional[List[str]] = None) -> int:
    """Run the node."""
    return run(ObstacleDecision, args)


if __name__ == '__main__':
    sys.exit(main())
