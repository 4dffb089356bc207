# SPDX-License-Identifier: Apache-2.0
"""
When something goes out on the line: values that are asked with the time and give the next one.

All times are of one steady clock [s].
"""
import math
from typing import NamedTuple

# One torque goes out per period on average, and at most one of them so many periods early.
EARLY = 1.5
# A period may have no command, for the answers of the controller wander: torque is repeated where
# none has gone out for so many periods, and then in each until there is a command again.
REPEAT = 1.5
# So many periods pass between two decisions about the torque at most.
DECIDED = REPEAT + 1.0
# Between two attempts to arm a drive that could not, where the file says `rearm` [s].
ARM_AGAIN = 0.3
# After a drive has taken the power off by itself, and may be armed again: the pause is `ARM_AGAIN`
# at first and twice the last one each time, up to this one; under power for so long, and the count
# begins anew [s].
LONGEST_PAUSE, HELD = 20.0, 10.0
# Between two repetitions of a stop that is not confirmed yet [s].
STOP_AGAIN = 0.01


class Periods(NamedTuple):
    """The periods of a loop: when the next one begins, and how many were missed."""

    period: float
    due: float
    late: int = 0

    def next(self, now: float) -> 'Periods':
        """Return the periods after a tick; where that is late, they go on from now."""
        period, due, late = self
        due += period
        # Made anew, here and below: `_replace` takes longer than the decision.
        return Periods(period, due, late) if due >= now else Periods(period, now, late + 1)


class Pacer(NamedTuple):
    """When a torque, a stop and an attempt to arm may go out, and when they must."""

    period: float
    waiting: bool = False  # a command that has not gone out
    repeating: bool = False
    torque_sent: float = -math.inf
    next_torque: float = -math.inf  # that the share of the line allows
    stop_sent: float = -math.inf
    next_arm: float = -math.inf
    pause: float = 0.0  # before `next_arm`

    def commanded(self) -> 'Pacer':
        """Take note of a command: if there is no room now, it goes out with the next tick."""
        return self if self.waiting else Pacer(self.period, True, *self[2:])

    def has_room(self, now: float) -> bool:
        """Return whether a torque may go out between two ticks."""
        return now >= self.next_torque - EARLY * self.period

    def is_torque_due(self, now: float) -> bool:
        """Return whether a tick is to send a torque."""
        return (self.waiting or self.repeating
                or now - self.torque_sent >= REPEAT * self.period)

    def sent_torque(self, now: float) -> 'Pacer':
        """Take note of a torque that goes out: that of a command, or one more time the last."""
        due = self.next_torque if self.next_torque > now else now
        return Pacer(self.period, False, not self.waiting, now, due + self.period, *self[5:])

    def is_stop_due(self, now: float) -> bool:
        """Return whether a stop that is not confirmed is to be repeated."""
        return now - self.stop_sent >= STOP_AGAIN

    def sent_stop(self, now: float) -> 'Pacer':
        """Take note of a stop that goes out; a command that waited does not any more."""
        return self._replace(waiting=False, stop_sent=now)

    def may_arm(self, now: float) -> bool:
        """Return whether arming may be tried."""
        return now >= self.next_arm

    def not_armed(self, now: float) -> 'Pacer':
        """Take note of a drive that could not be armed."""
        return self._replace(next_arm=now + ARM_AGAIN)

    def tripped(self, now: float, since: float) -> 'Pacer':
        """Take note of power lost that was there since then: one that trips each time rests."""
        before = self.pause if now - since < HELD else 0.0
        pause = min(max(ARM_AGAIN, 2.0 * before), LONGEST_PAUSE)
        return self._replace(next_arm=now + pause, pause=pause)
