# SPDX-License-Identifier: Apache-2.0
"""The time of another simulator: in one graph one makes it, and all others follow."""
import math
from typing import Optional

from rclpy.node import Node
from rosgraph_msgs.msg import Clock

from ballbot_ros.plant import Plant
from ballbot_ros.ros.conversions import to_seconds
from ballbot_ros.ros.endpoints import create_subscription

# What is behind by more than this is given up, and time jumps [s].
LONGEST_LAG = 1.0
# Stamps are rounded to the nanosecond, which is less than this part of any period.
ROUNDING = 1e-4
PATIENCE = 3.0  # with a clock that does not come [s of wall time]


class FollowedClock:
    """
    Says how many control periods are due by /clock; stands where a `Pace` does.

    The plant takes its time from the first message, is never ahead of the newest one, and follows
    it also where it jumps: its stamps are of the one time of the graph.

    Parameters
    ----------
    node : Node
    plant : Plant
    most : int
        Periods per call.

    Attributes
    ----------
    dropped : int
        Periods given up so far.

    """

    def __init__(self, node: Node, plant: Plant, most: int = 50):
        """Wait for the clock."""
        self._plant, self._most, self._logger = plant, most, node.get_logger()
        self._clock: Optional[float] = None
        self._joined = False
        self._asked: Optional[float] = None
        self.dropped = 0
        create_subscription(node, '/clock', self._on_clock)

    def restart(self, now: float) -> None:
        """Take the time from the clock again, after a pause for instance."""
        self._joined = False

    def due(self, now: float) -> int:
        """Return how many periods to run at `now` [s of wall time]."""
        if self._clock is None:
            self._wait(now)
            return 0
        there = math.floor(self._clock / self._plant.period + ROUNDING)
        behind = there - self._plant.periods
        if not self._joined or not 0 <= behind * self._plant.period <= LONGEST_LAG:
            if self._joined:
                self.dropped += max(0, behind)
                self._logger.warning(
                    f'/clock is at {self._clock:.3f} s and this simulator at '
                    f'{self._plant.time:.3f} s: its time jumps there', throttle_duration_sec=1.0)
            self._plant.periods, self._joined = there, True
            return 0
        return min(behind, self._most)

    def _on_clock(self, message: Clock) -> None:
        self._clock = to_seconds(message.clock)

    def _wait(self, now: float) -> None:
        if self._asked is None:
            self._asked = now
        if now - self._asked > PATIENCE:
            self._logger.warning(
                'no /clock, and publish_clock is false: time stands still; start the simulator '
                'that publishes it', throttle_duration_sec=10.0)
