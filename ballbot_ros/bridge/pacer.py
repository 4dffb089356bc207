# SPDX-License-Identifier: Apache-2.0
"""
Rate limits of the link: immutable states that each event at a time replaces with the next.

All times are of one steady clock [s].
"""
import math
from typing import NamedTuple

# The link carries one torque per period on average, at most one of them this early [periods].
EARLY = 1.5
# The reply time of the controller varies, so a period may have no command: after this time without
# a torque [periods] the last one is repeated in each period until the next command.
REPEAT = 1.5
# Longest time between two decisions about the torque [periods].
DECIDED = REPEAT + 1.0
# Time between two attempts to arm a drive with `rearm` [s].
ARM_AGAIN = 0.3
# Pause after a drive disarmed by itself [s]: `ARM_AGAIN` at first, doubled each time up to
# LONGEST_PAUSE; reset after the drive was armed for HELD.
LONGEST_PAUSE, HELD = 20.0, 10.0
# Time between two repetitions of an unconfirmed stop [s].
STOP_AGAIN = 0.01


class Periods(NamedTuple):
    """The periods of a loop: start of the next one, and number of missed ones."""

    period: float
    due: float
    late: int = 0

    def next(self, now: float) -> 'Periods':
        """Return the periods after a tick; after a delayed tick they continue from now."""
        period, due, late = self
        due += period
        # The constructor, here and below: `_replace` takes longer than the decision.
        return Periods(period, due, late) if due >= now else Periods(period, now, late + 1)


class Pacer(NamedTuple):
    """Earliest and latest times of the next torque, stop and attempt to arm."""

    period: float
    waiting: bool = False  # a command that was not sent
    repeating: bool = False
    torque_sent: float = -math.inf
    next_torque: float = -math.inf  # by the average rate of the link
    stop_sent: float = -math.inf
    next_arm: float = -math.inf
    pause: float = 0.0  # before `next_arm`

    def commanded(self) -> 'Pacer':
        """Record a command; if the rate limit delays it, the next tick sends it."""
        return self if self.waiting else Pacer(self.period, True, *self[2:])

    def has_room(self, now: float) -> bool:
        """Return whether a torque may be sent between two ticks."""
        return now >= self.next_torque - EARLY * self.period

    def is_torque_due(self, now: float) -> bool:
        """Return whether a tick must send a torque."""
        return (self.waiting or self.repeating
                or now - self.torque_sent >= REPEAT * self.period)

    def sent_torque(self, now: float) -> 'Pacer':
        """Record a sent torque, new or repeated."""
        due = self.next_torque if self.next_torque > now else now
        return Pacer(self.period, False, not self.waiting, now, due + self.period, *self[5:])

    def is_stop_due(self, now: float) -> bool:
        """Return whether to repeat an unconfirmed stop."""
        return now - self.stop_sent >= STOP_AGAIN

    def sent_stop(self, now: float) -> 'Pacer':
        """Record a sent stop and drop the waiting command."""
        return self._replace(waiting=False, stop_sent=now)

    def may_arm(self, now: float) -> bool:
        """Return whether an attempt to arm is allowed."""
        return now >= self.next_arm

    def not_armed(self, now: float) -> 'Pacer':
        """Record a failed attempt to arm."""
        return self._replace(next_arm=now + ARM_AGAIN)

    def tripped(self, now: float, since: float) -> 'Pacer':
        """Record that the drive disarmed by itself; repeated trips lengthen the pause."""
        before = self.pause if now - since < HELD else 0.0
        pause = min(max(ARM_AGAIN, 2.0 * before), LONGEST_PAUSE)
        return self._replace(next_arm=now + pause, pause=pause)
