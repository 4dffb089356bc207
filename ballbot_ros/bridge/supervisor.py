# SPDX-License-Identifier: Apache-2.0
"""
Supervision of the motor torque: fresh commands within limits, or zero.

All times are of one steady clock and passed in, so that tests need no sleep.

After a command timeout, `on_timeout` selects the torque during `damping_time`: zero (``coast``),
against the rate of the joint (``brake``), or against the absolute rate of the pendulum
(``settle``).  `studies.command_loss` computes the motion of the ball on slopes and level ground;
docs/hardware_bridge.md has the results.
"""
from collections import Counter
from enum import Enum
import math
from typing import NamedTuple, Optional, Tuple

from ballbot_ros.bridge.hardware_file import Limits
from ballbot_ros.control.command_gate import CommandGate
from ballbot_ros.drives.contract import RUNAWAY
from ballbot_ros.errors import RefusedError

# Time without a nonzero command before the e-stop may be released [s].
COMMAND_GAP = 0.5
# Torque below this counts as zero [N m].
ZERO_TORQUE = 1e-6
RUNAWAY_TIME = 0.02  # longest time above `RUNAWAY` times the speed limit [s]


class StopReason(str, Enum):
    """Code of the cause of an e-stop; messages and diagnostics contain the values."""

    START = 'start'  # before the first release
    REQUESTED = 'requested'  # by a person or a node
    DEACTIVATED = 'deactivated'
    CLOSED = 'closed'
    # Faults of the motor, see `motor_state.TRANSITIONS`; the values are names of counters, too.
    NOT_ARMED = 'not_armed'  # the drive did not confirm a request to arm
    SILENT = 'silent'  # no reply while armed; the drive may have restarted
    UNCONFIRMED = 'unconfirmed'  # a reply without a confirmed armed status
    DISARMED_BY_DRIVE = 'disarmed_by_drive'
    HAZARD = 'hazards'  # another sender commands the drive, or its settings have changed
    LOST = 'links_lost'  # the link failed, or replies timed out
    HELD_UP = 'held_up'  # the machine delayed the loop by more than the watchdog of the drive
    # Faults detected by this module, and faults of the battery and the IMU.
    RUNAWAY = 'runaway'
    BATTERY_EMPTY = 'battery_empty'
    IMU_SILENT = 'imu_silent'
    IMU_FROZEN = 'imu_frozen'
    IMU_GRAVITY = 'imu_gravity'
    IMU_TURN_RATE = 'imu_turn_rate'
    # Faults of the estimate, see `EstimateLostError`.
    DIVERGED = 'diverged'
    ENCODER_JUMPS = 'encoder_jumps'
    ENCODER_VELOCITY = 'encoder_velocity'
    JOINT_TORQUE = 'joint_torque'

    @property
    def is_fault(self) -> bool:
        """Return whether it is a fault; else a program or a person requested the e-stop."""
        return self not in (self.START, self.REQUESTED, self.DEACTIVATED, self.CLOSED)


class EStop(NamedTuple):
    """Cause of an engaged e-stop."""

    reason: StopReason
    text: str
    names: Tuple[str, ...] = ()  # of the faults or the changed settings of the drive


class PendulumMotion(NamedTuple):
    """Motion of the robot that the supervisor limits; see `estimation.Estimate`."""

    pendulum_angle: float  # absolute [rad]
    pendulum_rate: float  # absolute [rad/s]
    joint_rate: float  # against the shell [rad/s]


class Supervisor:
    """
    Limits the torque in each period.

    Parameters
    ----------
    period : float
        Longest time between two decisions [s]; the timeout includes it.

    Attributes
    ----------
    torque, requested : float
        The last decision, and its value before the limits [N m].
    derating : float
        Fraction of the torque limit that heat and battery permit; set by the owner.
    e_stop : EStop or None
        Cause of the engaged e-stop; None while it is released.
    counts : Counter
        ``timeouts``, ``limited_torque``, ``limited_rate``, ``limited_angle``,
        ``limited_speed``, ``e_stops``.
    gate : CommandGate
        Holds the active command, and the counts of accepted and refused commands.

    """

    def __init__(self, limits: Limits, period: float):
        self._limits, self._period = limits, period
        # A command that arrives just after a decision takes effect a period later.
        self.gate = CommandGate(max(limits.command_timeout - period, 0.5 * period))
        self._pushed = -math.inf  # time of the last nonzero command
        self.torque = self.requested = 0.0
        self.derating = 1.0
        self._decided: Optional[float] = None
        self._fast_since = math.inf
        self._since: Optional[float] = None  # time of the command timeout
        self.e_stop: Optional[EStop] = EStop(StopReason.START, 'engaged at start')
        self.counts: Counter[str] = Counter()

    @property
    def commanded(self) -> bool:
        """Return whether a command is active, zero included."""
        return self.gate.stamp is not None and self._since is None

    @property
    def timed_out(self) -> bool:
        """Return whether the commands have timed out."""
        return self._since is not None

    def offer(self, torque: float, stamp: float, now: float) -> None:
        """Accept a torque command at the pendulum, as `CommandGate.offer` does."""
        self.record_request(torque, now)
        self.gate.offer(torque, stamp, now)

    def record_request(self, torque: float, now: float) -> None:
        """Record a torque request, accepted or not."""
        if math.isfinite(torque) and abs(torque) > ZERO_TORQUE:
            self._pushed = now

    def trigger(self, cause: EStop) -> None:
        """Engage the e-stop; the first cause is kept."""
        if self.e_stop is None:
            self.counts['e_stops'] += 1
            self.e_stop = cause
        self.quiet()

    def reset(self, now: float, inhibit: str = '', field: str = '') -> None:
        """
        Release the e-stop; raise `RefusedError` if inhibited, or after a recent nonzero command.

        `field` names the inhibiting condition.
        """
        if inhibit:
            raise RefusedError(f'the e-stop remains engaged: {inhibit}', 'standing', field)
        if now - self._pushed < COMMAND_GAP:
            raise RefusedError(
                'the e-stop remains engaged: nonzero commands are arriving, and the robot '
                'would jump; let the controller command zero (no set-point) for '
                f'{COMMAND_GAP:g} s',
                'refused', 'set_point')
        self.release()

    def release(self) -> None:
        """Release the e-stop without the checks of `reset`, which another axis has passed."""
        self.e_stop = None
        self.quiet()

    def quiet(self) -> None:
        """Drop the active command and the torque: the motor has no power."""
        self.gate.clear()
        self.torque = self.requested = 0.0
        self._decided = self._since = None

    def decide(self, now: float, motion: Optional[PendulumMotion]) -> float:
        """Return the torque until the next decision [N m]; zero for an unknown motion (None)."""
        wanted = self.requested = self._wanted(now, motion)
        if self.e_stop or motion is None or wanted == 0.0:
            torque = 0.0  # no rate limit for zero torque
        else:
            torque = self._within(wanted, now, motion)
        self.torque, self._decided = torque, now
        return torque

    def _wanted(self, now: float, motion: Optional[PendulumMotion]) -> float:
        """Return the commanded torque, or the torque of `on_timeout`."""
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
        limits = self._limits
        fast = abs(motion.joint_rate) > RUNAWAY * limits.speed_limit
        self._fast_since = min(self._fast_since, now) if fast else math.inf
        if fast and now - self._fast_since >= RUNAWAY_TIME:
            self.trigger(EStop(
                StopReason.RUNAWAY, f'runaway: the joint rotates at {motion.joint_rate:.1f} rad/s,'
                f' but speed_limit is {limits.speed_limit:g} rad/s'))
            return 0.0
        torque = self._cut('torque', wanted, limits.torque_limit * self.derating)
        before = self.torque
        for what, value, limit in (
                ('limited_angle', motion.pendulum_angle, limits.angle_limit),
                ('limited_speed', motion.joint_rate, limits.speed_limit)):
            if abs(value) > limit:
                if torque * value > 0.0:
                    self.counts[what] += 1
                    return 0.0
                if before * value > 0.0:  # returning torque starts at zero
                    before = 0.0
        elapsed = self._period if self._decided is None else min(
            max(now - self._decided, 0.0), limits.command_timeout)
        return before + self._cut('rate', torque - before, limits.torque_rate_limit * elapsed)

    def _cut(self, what: str, value: float, limit: float) -> float:
        if abs(value) <= limit:
            return value
        self.counts[f'limited_{what}'] += 1
        return math.copysign(limit, value)
