# SPDX-License-Identifier: Apache-2.0
"""The messages of the motor bridge, and the clock of their stamps."""
import logging
import math
import threading
import time
from typing import Dict, Optional, Sequence

from geometry_msgs.msg import Vector3
from rclpy.node import Node
from sensor_msgs.msg import Imu
from std_msgs.msg import Bool, Header

from ballbot_ros.bridge.motor_state import MotorState
from ballbot_ros.bridge.session import Report, Session
from ballbot_ros.bridge.supervisor import EStop
from ballbot_ros.clock import steady_time
from ballbot_ros.control import Mode
from ballbot_ros.errors import MessageError
from ballbot_ros.estimation import Estimate, ImuReading
from ballbot_ros.msg import MotorStatus
from ballbot_ros.ros.conversions import to_seconds, to_time
from ballbot_ros.ros.endpoints import create_publisher, wait_until_received
from ballbot_ros.ros.frames import FRAMES
from ballbot_ros.ros.message_bytes import AnyImu, JointStateBytes

# A child of the logger `bridge`, whose records are deferred: the motor loop reads this clock, too.
LOG = logging.getLogger('ballbot_ros.bridge.clocks')

# REP 145: first element of the covariance of a quantity that the IMU does not measure.
NOT_REPORTED = -1.0
# Longest time between the readings of the two clocks [s]: a sample that takes longer, because the
# process was preempted, is dropped.  The offset follows changes above this value.
LONGEST_SAMPLE = 0.002
CLOCK_STEP = 0.1  # a larger jump means that the clock was set [s]
# Fields of motor_status that are NaN once the loop has ended.
NUMBERS = ('set_value', 'pendulum_angle', 'pendulum_angle_sd', 'pendulum_rate_sd', 'current',
           'bus_voltage', 'bus_current', 'temperature', 'motor_temperature')
# Time between samples of the offset [s]; shorter than every timeout that depends on it.
SAMPLE_PERIOD = 0.02


class Clocks:
    """
    Converts between stamps (system time) and the steady clock of all timeouts.

    The offset is sampled every `SAMPLE_PERIOD` and kept unless it changes by more than
    `LONGEST_SAMPLE`, so that stamps stay in order.  It follows a system clock that is set, and
    logs this.  Hardware has no simulated time: the bridge refuses `use_sim_time`.
    """

    def __init__(self) -> None:
        self._offset = math.inf
        self._sample_at = 0.0

    @property
    def _ahead(self) -> float:
        now = steady_time()
        if now >= self._sample_at:
            self._sample(now)
        return self._offset

    def _sample(self, now: float) -> None:
        """Sample the offset; a sample that took too long is repeated with the next call."""
        stamp = time.time()
        after = steady_time()
        if after - now > LONGEST_SAMPLE and math.isfinite(self._offset):
            return  # this process was preempted between the readings
        self._sample_at = after + SAMPLE_PERIOD
        offset = stamp - 0.5 * (now + after)
        change = offset - self._offset
        if abs(change) > LONGEST_SAMPLE:
            if CLOCK_STEP < abs(change) < math.inf:
                LOG.warning(
                    f'the system clock was set by {change:+.3f} s: stamps follow it, timeouts do '
                    'not depend on it')
            self._offset = offset

    def steady(self, stamp: float) -> float:
        """Return the time of a stamp on the steady clock [s]."""
        return stamp - self._ahead

    def stamp(self, steady: float) -> float:
        """Return the stamp of a time of the steady clock [s]."""
        return steady + self._ahead


def imu_reading(message: AnyImu, clocks: Clocks) -> ImuReading:
    """
    Return the data of an IMU message for the estimate; see `estimation.imu` for the axes.

    Raises `MessageError` with reason ``not_reported`` or ``not_finite``.
    """
    for what in ('angular_velocity', 'linear_acceleration'):
        if getattr(message, f'{what}_covariance')[0] == NOT_REPORTED:
            raise MessageError(f'the IMU reports no {what}, and both are needed',
                               'not_reported', what)
    stamp = to_seconds(message.header.stamp)
    return ImuReading(
        clocks.steady(stamp) if stamp else steady_time(), -message.angular_velocity.y,
        message.linear_acceleration.x, message.linear_acceleration.z)


def imu_message(stamp: float, turn_rate: Sequence[float], force: Sequence[float],
                frame: str = FRAMES.imu) -> Imu:
    """Return an IMU message without orientation; the vectors have the axes of the frame."""
    message = Imu(header=Header(stamp=to_time(stamp), frame_id=frame),
                  angular_velocity=Vector3(**dict(zip('xyz', turn_rate))),
                  linear_acceleration=Vector3(**dict(zip('xyz', force))))
    message.orientation_covariance[0] = NOT_REPORTED
    return message


class Turns:
    """Schedules a periodic action whose period need not be a multiple of the calling period."""

    def __init__(self, period: float):
        self.period, self._due = period, -math.inf

    def is_due(self, now: float) -> bool:
        """Return whether the action is due, and schedule the next one if so."""
        # A quarter of a period early is on time: estimates arrive irregularly.
        if now < self._due - 0.25 * self.period:
            return False
        # The next period starts at the due time, to keep the average rate, and after a pause
        # now, to avoid a burst.
        due = self._due + self.period
        self._due = due if due > now else now + self.period
        return True


class MotorOutputs:
    """
    Publishes joint_states and motor_status, from one thread at a time, and e_stop, from any.

    `status_rate` is in Hz; `joint_state_period` is in s, 0 to publish each estimate.
    """

    def __init__(self, node: Node, clocks: Clocks, status_rate: float,
                 joint_state_period: float = 0.0, frame: str = FRAMES.base):
        self._clocks = clocks
        self.publish_at(status_rate, joint_state_period)
        self._joints = create_publisher(node, 'joint_states')
        self._frame, self._joint_states = frame, JointStateBytes(frame)
        self._status = create_publisher(node, 'motor_status')
        self._e_stop = create_publisher(node, 'e_stop')
        self._published: Optional[bool] = None
        self.engaged_at = -math.inf  # time at which an engaged e-stop was last published [s]
        self._reporting = threading.Lock()
        self._state = ''
        self._estimate: Optional[Estimate] = None
        self.publish_e_stop(True)

    def publish_at(self, status_rate: float, joint_state_period: float) -> None:
        """Change the rates; the parameters are those of the class."""
        self._status_turns, self._joint_turns = Turns(1.0 / status_rate), Turns(joint_state_period)

    def publish_e_stop(self, engaged: bool) -> None:
        """Publish whether the e-stop is engaged, if that has changed."""
        with self._reporting:  # the loop and the executor both call this
            if engaged is not self._published:
                self._published = engaged
                if engaged:
                    self.engaged_at = steady_time()
                self._e_stop.publish(Bool(data=engaged))

    def publish(self, report: Report) -> None:
        """Publish the results of a period of the loop."""
        estimate = report.estimate
        if estimate is not None:
            self._estimate = estimate
            if self._joint_turns.is_due(estimate.stamp):
                self._joints.publish(self._joint_states.of(
                    self._clocks.stamp(estimate.stamp), estimate.readings, report.torque))
        self.publish_e_stop(bool(report.e_stop))
        state = state_of(report)
        if self._status_turns.is_due(report.time) or state != self._state:
            self._state = state
            self._status.publish(self._motor_status(report, state))

    def publish_end(self, state: str, session: Session) -> None:
        """Publish the end of the loop and the state of the motor; wait for delivery."""
        e_stop, unconfirmed = session.supervisor.e_stop, session.control.unconfirmed
        self.publish_e_stop(bool(e_stop))
        self._state = state
        self._status.publish(MotorStatus(
            header=self._header(steady_time()), state=state, **_cause(e_stop), derating=1.0,
            warnings=[unconfirmed] if unconfirmed else [],
            control=_control(session.law),
            **dict.fromkeys(NUMBERS, math.nan)))
        wait_until_received(self._status)

    def _header(self, steady: float) -> Header:
        return Header(stamp=to_time(self._clocks.stamp(steady)), frame_id=self._frame)

    def _motor_status(self, report: Report, state: str) -> MotorStatus:
        estimate, drive, law = self._estimate, report.telemetry, report.set_point
        return MotorStatus(
            header=self._header(report.time), state=state, **_cause(report.e_stop),
            torque=report.torque,
            pendulum_angle=estimate.readings.pendulum_angle if estimate else math.nan,
            pendulum_angle_sd=estimate.angle_sd if estimate else math.nan,
            pendulum_rate_sd=estimate.rate_sd if estimate else math.nan,
            current=or_nan(drive.current), bus_voltage=or_nan(drive.bus_voltage),
            bus_current=or_nan(drive.bus_current),
            set_value=math.nan if law is None or law.mode is Mode.IDLE else law.value,
            control=_control(law),
            law='' if law is None else law.mode.value, derating=report.condition.part,
            warnings=(*drive.warnings, *report.condition.warnings),
            temperature=or_nan(drive.temperature),
            motor_temperature=or_nan(drive.motor_temperature), faults=drive.faults)


def state_of(report: Report) -> str:
    if report.state is MotorState.DISCONNECTED:
        return MotorStatus.STATE_LOST
    if report.state is MotorState.STOPPING:
        return MotorStatus.STATE_STOPPING
    if report.e_stop:
        return MotorStatus.STATE_E_STOP
    if report.state is MotorState.DISARMED:
        return MotorStatus.STATE_OFF
    if report.needs_imu:
        return MotorStatus.STATE_NO_IMU
    if report.timed_out:
        return MotorStatus.STATE_TIMED_OUT
    return MotorStatus.STATE_FOLLOWING if report.commanded else MotorStatus.STATE_WAITING


def _control(law: Optional[object]) -> str:
    """Return the source of the torque; `law` is None without laws on board."""
    return str(MotorStatus.CONTROL_DIRECT if law is None else MotorStatus.CONTROL_ONBOARD)


def _cause(e_stop: Optional[EStop]) -> Dict[str, str]:
    return {} if e_stop is None else {'e_stop': e_stop.text, 'e_stop_reason': e_stop.reason.value}


def or_nan(value: Optional[float]) -> float:
    """Return a value for a message, NaN if it is not reported."""
    return math.nan if value is None else value
