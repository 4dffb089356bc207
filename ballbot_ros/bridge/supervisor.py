# SPDX-License-Identifier: Apache-2.0
"""
What the motor may do: fresh commands within limits, or nothing.

All times are of one steady clock and passed in, so that nothing here needs to sleep to be
tested.

When commands have timed out, `on_timeout` says what takes their place until `damping_time` is
over: nothing (``coast``), torque against the rate of the joint (``brake``), or torque against the
absolute rate of the pendulum (``settle``).  What a ball does then, on a slope and on the level, is
computed by `studies.command_loss` and stands in docs/hardware_bridge.md.
"""
from collections import Counter
import math
from typing import NamedTuple, Optional

from ballbot_ros.bridge.hardware_file import Limits
from ballbot_ros.control.command_gate import CommandGate
from ballbot_ros.errors import RefusedError

# The e-stop is not reset while commands other than zero have arrived this recently [s].
QUIET = 0.5
# Torque below this is none [N m].
NOTHING = 1e-6
# Faster than this part of the speed limit for so long [s], and limiting does not help any more.
RUNAWAY, RUNAWAY_TIME = 1.5, 0.02


class PendulumMotion(NamedTuple):
    """What the supervisor must know of the robot; see `estimation.Estimate`."""

    pendulum_angle: float  # absolute [rad]
    pendulum_rate: float  # absolute [rad/s]
    joint_rate: float  # against the shell [rad/s]


class Supervisor:
    """
    Decides the torque of each moment.

    Parameters
    ----------
    limits : Limits
    period : float
        Between two decisions at most [s]; the timeout is kept in spite of it.

    Attributes
    ----------
    torque, asked : float
        Decided last, and what was wanted before the limits [N m].
    derating : float
        Part of the torque limit that heat and battery leave; set by the owner.
    e_stop : str
        Why the e-stop is engaged; empty when it is not.
    counts : Counter
        ``timeouts``, ``limited_torque``, ``limited_rate``, ``limited_angle``,
        ``limited_speed``, ``e_stops``.
    gate : CommandGate
        With the command in force, and the counts of those accepted and refused.

    """

    def __init__(self, limits: Limits, period: float):
        """Start with the e-stop engaged."""
        self._limits, self._period = limits, period
        # What arrives just after a decision is acted on a period later.
        self.gate = CommandGate(max(limits.command_timeout - period, 0.5 * period))
        self._pushed = -math.inf  # when a command other than zero last came
        self.torque = self.asked = 0.0
        self.derating = 1.0
        self._decided: Optional[float] = None
        self._fast_since = math.inf
        self._since: Optional[float] = None  # when commands timed out
        self.e_stop = 'engaged at start'
        self.counts: Counter[str] = Counter()

    @property
    def commanded(self) -> bool:
        """Return whether there is a command in force, be it zero."""
        return self.gate.stamp is not None and self._since is None

    @property
    def timed_out(self) -> bool:
        """Return whether commands came and have timed out."""
        return self._since is not None

    def offer(self, torque: float, stamp: float, now: float) -> None:
        """Take a command of a torque at the pendulum, as `CommandGate.offer` does."""
        self.overhear(torque, now)
        self.gate.offer(torque, stamp, now)

    def overhear(self, torque: float, now: float) -> None:
        """Take note that a torque was asked for, followed or not."""
        if math.isfinite(torque) and abs(torque) > NOTHING:
            self._pushed = now

    def trigger(self, reason: str) -> None:
        """Engage the e-stop; the first reason stays."""
        if not self.e_stop:
            self.counts['e_stops'] += 1
            self.e_stop = reason
        self.quiet()

    def reset(self, now: float, inhibit: str = '') -> None:
        """Release the e-stop; raise `RefusedError` with what inhibits it, or if commands push."""
        if inhibit:
            raise RefusedError(f'the e-stop stays engaged: {inhibit}')
        if now - self._pushed < QUIET:
            raise RefusedError(
                'the e-stop stays engaged: commands other than zero are arriving, and the robot '
                f'would jump; let the controller command zero (no set-point) for {QUIET:g} s')
        self.e_stop = ''
        self.quiet()

    def quiet(self) -> None:
        """Forget the command in force and the torque: the motor has no power."""
        self.gate.clear()
        self.torque = self.asked = 0.0
        self._decided = self._since = None

    def decide(self, now: float, motion: Optional[PendulumMotion]) -> float:
        """Return the torque from now on [N m]: none while the motion is not known (None)."""
        wanted = self.asked = self._wanted(now, motion)
        if self.e_stop or motion is None or wanted == 0.0:
            torque = 0.0  # a cut to zero is never slowed down
        else:
            torque = self._within(wanted, now, motion)
        self.torque, self._decided = torque, now
        return torque

    def _wanted(self, now: float, motion: Optional[PendulumMotion]) -> float:
        """Return what is commanded, or what takes its place."""
        if not self.gate.expired(now):
            self._since = None
            return self.gate.torque(now)
        if self._since is None:
            self._since = now
            self.counts['timeouts'] += 1
        limits = self._limits
        if motion is None or limits.on_timeout == 'coast' \
                or now - self._since > limits.damping_time:
            return 0.0
        rate = motion.joint_rate if limits.on_timeout == 'brake' else motion.pendulum_rate
        return -limits.damping * rate

    def _within(self, wanted: float, now: float, motion: PendulumMotion) -> float:
        """Return the torque cut to all limits."""
        limits = self._limits
        fast = abs(motion.joint_rate) > RUNAWAY * limits.speed_limit
        self._fast_since = min(self._fast_since, now) if fast else math.inf
        if fast and now - self._fast_since >= RUNAWAY_TIME:
            self.trigger(
                f'runaway: the joint turns at {motion.joint_rate:.1f} rad/s and speed_limit is '
                f'{limits.speed_limit:g} rad/s')
            return 0.0
        torque = self._cut('torque', wanted, limits.torque_limit * self.derating)
        before = self.torque
        for what, place, limit in (
                ('limited_angle', motion.pendulum_angle, limits.angle_limit),
                ('limited_speed', motion.joint_rate, limits.speed_limit)):
            if abs(place) > limit:
                if torque * place > 0.0:
                    self.counts[what] += 1
                    return 0.0
                if before * place > 0.0:  # torque back begins at zero, and not at what was out
                    before = 0.0
        elapsed = self._period if self._decided is None else min(
            max(now - self._decided, 0.0), limits.command_timeout)
        return before + self._cut('rate', torque - before, limits.torque_rate_limit * elapsed)

    def _cut(self, what: str, value: float, limit: float) -> float:
        if abs(value) <= limit:
            return value
        self.counts[f'limited_{what}'] += 1
        return math.copysign(limit, value)


