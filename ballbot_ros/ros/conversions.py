# SPDX-License-Identifier: Apache-2.0
"""Conversions between messages and the values of the layers without ROS."""
import math
from typing import Any, Optional, Sequence, Tuple

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion
from nav_msgs.msg import OccupancyGrid, Odometry
import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import JointState, LaserScan
from std_msgs.msg import Header

from ballbot_ros.control import JointReadings, Mode, SetPoint
from ballbot_ros.decision import (
    Decision, Kind, Motion, Reason, StepObservation, TerrainObservation)
from ballbot_ros.errors import MessageError
from ballbot_ros.estimation import OdometryState
from ballbot_ros.floors import Floor, ranges
from ballbot_ros.msg import (
    BallState, Contact, StepDecision, StepObservation as StepObservationMsg,
    TerrainObservation as TerrainObservationMsg)
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.state import State
from ballbot_ros.physics.simulation.model import Model
from ballbot_ros.plant import FloorPlant, Sensor, Sight, TerrainSight
from ballbot_ros.ros.frames import FRAMES, Frames, LATERAL, LEAN, PENDULUM, SHELL, YAW
from ballbot_ros.steering import LateralState

# Variances of exact values (all zeros would mean unknown) and of unknown values; squares of
# metres, radians, or these per second.
EXACT, UNKNOWN = 1e-12, 1e6
Variances = NDArray[np.float64]

ALL_EXACT = np.eye(6).ravel() * EXACT


def sec_nanosec(seconds: float) -> Tuple[int, int]:
    """Return seconds and nanoseconds of a stamp."""
    return divmod(round(seconds * 1e9), 10**9)


def to_time(seconds: float) -> Time:
    """Return a stamp, rounded to the nanosecond."""
    sec, nanosec = sec_nanosec(seconds)
    return Time(sec=sec, nanosec=nanosec)


def to_seconds(stamp: Time) -> float:
    return stamp.sec + 1e-9 * stamp.nanosec


def exact(message: Any) -> Tuple[int, int]:
    """Return the stamp of a message for exact comparison."""
    return message.header.stamp.sec, message.header.stamp.nanosec


def _joint_value(message: JointState, joint: str, values: Sequence[float], quantity: str
                 ) -> float:
    """Return the entry of a joint; raise `MessageError` if there is not exactly one."""
    if joint not in message.name:
        raise MessageError(
            f'joint {joint!r} is missing; the joints of the message are '
            f'{list(message.name)!s:.200}', 'unknown_joint', joint)
    if message.name.count(joint) > 1:
        raise MessageError(
            f'joint {joint!r} is named {message.name.count(joint)} times: name '
            'it once, with one value', 'duplicate_joint', joint)
    if len(values) != len(message.name):
        raise MessageError(
            f'{quantity} has {len(values)} entries for {len(message.name)} joints',
            'wrong_length', quantity)
    return float(values[message.name.index(joint)])


def command_torque(message: JointState, leans: bool = False) -> float:
    """
    Return the torque of a joint command [N m]; `leans` permits a `lean_set_point` in it.

    Raises `MessageError` with reason ``unknown_joint``, ``duplicate_joint``, ``wrong_length`` or
    ``unsupported``.
    """
    for quantity in ('position', 'velocity'):
        given = [value for number, value in enumerate(getattr(message, quantity))
                 if not math.isnan(value) and not (
                     leans and quantity == 'position'
                     and tuple(message.name[number:number + 1]) == (LEAN,))]
        if given:
            raise MessageError(
                f'{quantity} commands are not followed here, only effort'
                + (f' and the position of {LEAN!r}' if leans else '')
                + f'; leave {quantity} empty or NaN, or send set-points to the controller',
                'unsupported', quantity)
    return _joint_value(message, PENDULUM, message.effort, 'effort')


def lean_set_point(message: JointState) -> float:
    """Return the set-point of the lean in a joint command [rad], 0 if there is none."""
    if LEAN not in message.name:
        return 0.0
    return _joint_value(message, LEAN, message.position, 'position')


def lateral_readings(message: JointState, robot: Robot) -> Optional[LateralState]:
    """
    Return the lateral state in a joint state, None for a robot that drives straight.

    Raises `MessageError` if a joint is missing, the lengths differ or a number is not finite.
    """
    if robot.steering is None or LEAN not in message.name:
        return None
    numbers = [_joint_value(message, joint, getattr(message, quantity), quantity)
               for joint in LATERAL for quantity in ('position', 'velocity')]
    if not all(map(math.isfinite, numbers)):
        raise MessageError(
            f'position and velocity of {", ".join(LATERAL)} must be finite, got '
            f'{numbers}', 'not_finite', 'position')
    lean, lean_rate, tilt, tilt_rate, heading, yaw_rate = numbers
    return LateralState(lean, lean_rate, tilt, tilt_rate, yaw_rate, heading)


def readings(message: JointState) -> JointReadings:
    """Return the joint readings; raise `MessageError` if one is missing or not finite."""
    return JointReadings(
        to_seconds(message.header.stamp),
        _joint_value(message, SHELL, message.position, 'position'),
        _joint_value(message, PENDULUM, message.position, 'position'),
        _joint_value(message, SHELL, message.velocity, 'velocity'),
        _joint_value(message, PENDULUM, message.velocity, 'velocity'))


def set_point(message: JointState, steers: bool) -> SetPoint:
    """
    Return the set-point of a joint state.

    A position of the joint ``pendulum`` is an absolute pendulum angle for law (11), a
    velocity a joint rate for law (12); a message with neither means no torque.  NaN counts as not
    given if the other one is a number, else it is refused.  A velocity of the joint ``yaw`` is an
    additional yaw rate.

    Raises `MessageError` if both are given, the joint is missing or a number is not finite; with
    the reason ``other_axes`` for a yaw rate of a robot that does not steer.
    """
    stamp = to_seconds(message.header.stamp)
    given = {}
    for mode, quantity in ((Mode.HOLD, 'position'), (Mode.DRIVE, 'velocity')):
        values = getattr(message, quantity)
        if len(values):
            given[mode] = _joint_value(message, PENDULUM, values, quantity)
    meant = {mode: value for mode, value in given.items() if not math.isnan(value)}
    if len(meant) > 1:
        raise MessageError(
            'a set-point is a position, for law (11), or a velocity, for law '
            '(12), not both; leave one empty', 'contradictory', 'position')
    if given and not meant:
        raise MessageError(
            'the set-point is NaN; for no torque leave position and velocity empty',
            'not_finite', 'position')
    yaw_rate = 0.0
    if YAW in message.name:
        yaw_rate = _joint_value(message, YAW, message.velocity, 'velocity')
        if yaw_rate and not steers:
            raise MessageError(
                f'the velocity of {YAW!r} is {yaw_rate:.3g} rad/s, and this robot drives straight '
                f'ahead only; leave {YAW!r} out', 'other_axes', 'velocity')
    for mode, value in meant.items():
        return SetPoint(mode, value, stamp, yaw_rate)
    return SetPoint(Mode.IDLE, 0.0, stamp)


def set_point_message(stamp: Time, angle: float, yaw_rate: float = 0.0) -> JointState:
    """Return a set-point: an absolute pendulum angle [rad], and a yaw rate [rad/s]."""
    header = Header(stamp=stamp)
    if not yaw_rate:
        return JointState(header=header, name=[PENDULUM], position=[angle])
    return JointState(header=header, name=[PENDULUM, YAW], position=[angle, math.nan],
                      velocity=[math.nan, yaw_rate])


def odometry_message(state: State, place: Tuple[float, float, float], lateral: LateralState,
                     radius: float, frames: Frames) -> Odometry:
    """
    Return the true pose and velocity of the level, non-rolling frame at the ball centre.

    `place` is x, y and heading in the frame ``odom`` [m], [rad]; `radius` is that of the ball [m].
    """
    message = _odometry(state.time, ALL_EXACT, ALL_EXACT, frames)
    twist = message.twist.twist
    message.pose.pose.position.z = state.y
    twist.linear.x, twist.linear.z = state.velocity_x, state.velocity_y
    _turn(message, place, lateral, radius)
    return message


def yawed(heading: float) -> Quaternion:
    """Return the rotation about z by a heading [rad]."""
    return Quaternion(z=math.sin(0.5 * heading), w=math.cos(0.5 * heading))


def _turn(message: Odometry, place: Tuple[float, float, float], lateral: LateralState,
          radius: float) -> None:
    pose, twist = message.pose.pose, message.twist.twist
    pose.position.x, pose.position.y, heading = place
    pose.orientation = yawed(heading)
    twist.linear.y, twist.angular.z = radius * lateral.tilt_rate, lateral.yaw_rate


def estimated_odometry_message(stamp: float, state: OdometryState, radius: float,
                               frames: Frames, place: Optional[Tuple[float, float, float]],
                               lateral: LateralState) -> Odometry:
    """
    Return pose and velocity of the same frame at a ROS time [s], estimated from encoder and IMU.

    `radius` is the height of the centre above the start floor [m]; climbed height is not
    estimated.  `place` is x, y and heading of a robot that steers, by its model [m], [rad]; y and
    heading have the variance `UNKNOWN`.
    """
    pose, twist = (np.diag([variance + EXACT, UNKNOWN, UNKNOWN, EXACT, EXACT, UNKNOWN]).ravel()
                   for variance in (state.position_variance, state.speed_variance))
    message = _odometry(stamp, pose, twist, frames)
    message.pose.pose.position.x = state.position
    message.pose.pose.position.z = radius
    message.twist.twist.linear.x = state.speed
    if place is not None:
        _turn(message, place, lateral, radius)
    return message


def _odometry(stamp: float, pose: Variances, twist: Variances, frames: Frames) -> Odometry:
    """Return odometry with row-major covariances of x, y, z and of rotations about these axes."""
    message = Odometry(header=Header(stamp=to_time(stamp), frame_id=frames.odom),
                       child_frame_id=frames.base)
    message.pose.covariance, message.twist.covariance = pose, twist
    return message


def motion(message: Odometry) -> Motion:
    """Return position and speed along x."""
    return Motion(to_seconds(message.header.stamp), message.pose.pose.position.x,
                  message.twist.twist.linear.x)


def ball_state_message(state: State, torque: float, model: Model, frames: Frames,
                       lateral: LateralState, pose: Tuple[float, float, float]) -> BallState:
    """
    Return the message of a state, with energies and contacts.

    `pose` is x, y and heading in the frame odom [m], [rad].
    """
    position_x, position_y, heading = pose
    energies = model.energies(state)
    pendulum_angle, pendulum_rate, pendulum_torque = (
        state.pendulum_angle, state.pendulum_rate, torque
    ) if model.robot.has_pendulum else 3 * (math.nan,)
    return BallState(
        header=Header(stamp=to_time(state.time), frame_id=frames.odom), x=state.x, y=state.y,
        ball_angle=state.ball_angle, pendulum_angle=pendulum_angle, velocity_x=state.velocity_x,
        velocity_y=state.velocity_y, ball_rate=state.ball_rate, pendulum_rate=pendulum_rate,
        pendulum_torque=pendulum_torque,
        kinetic_energy=energies.kinetic, potential_energy=energies.potential,
        contact_energy=energies.contact, dissipated_energy=state.dissipated_energy,
        motor_work=state.motor_work, position_x=position_x, position_y=position_y,
        heading=heading, yaw_rate=lateral.yaw_rate, lean=lateral.lean,
        lean_rate=lateral.lean_rate, tilt=lateral.tilt, tilt_rate=lateral.tilt_rate,
        contacts=[Contact(**touch._asdict()) for touch in model.touches(state)])


def observation_message(stamp: Time, sight: Sight, sensor: Sensor, frames: Frames
                        ) -> StepObservationMsg:
    return StepObservationMsg(
        header=Header(stamp=stamp, frame_id=frames.base), detected=sight.detected,
        distance=sight.distance, height=sight.height, distance_sd=sensor.distance_sd,
        height_sd=sensor.height_sd)


def observation(message: StepObservationMsg) -> StepObservation:
    """Return the unchecked observation of a message; the decision checks it."""
    return StepObservation(
        to_seconds(message.header.stamp), message.detected, message.distance, message.height,
        message.distance_sd, message.height_sd)


def terrain_message(stamp: Time, sight: TerrainSight, frames: Frames) -> TerrainObservationMsg:
    return TerrainObservationMsg(
        header=Header(stamp=stamp, frame_id=frames.base), x=sight.x, z=sight.z, z_sd=sight.z_sd,
        x_min=sight.x_min, x_max=sight.x_max)


def terrain_observation(message: TerrainObservationMsg) -> TerrainObservation:
    """Return the unchecked observation of a message; the decision checks it."""
    return TerrainObservation(
        to_seconds(message.header.stamp), tuple(message.x), tuple(message.z),
        tuple(message.z_sd), message.x_min, message.x_max, message.header.frame_id)


def scan_message(stamp: Time, plant: FloorPlant, beams: int, reach: float, noise: Variances,
                 frames: Frames) -> LaserScan:
    """
    Return the distances to walls over a full circle, counter-clockwise from straight behind.

    They are limited to `reach` [m]; `noise` has an error for each beam [m].
    """
    step = 2.0 * math.pi / beams
    angles = -math.pi + step * np.arange(beams)
    x, y, heading = plant.pose
    distances = ranges(plant.floor, (x, y), (heading + angles).tolist(), reach)
    return LaserScan(
        header=Header(stamp=stamp, frame_id=frames.base), angle_min=-math.pi,
        angle_max=-math.pi + step * (beams - 1), angle_increment=step, range_min=0.0,
        range_max=reach, ranges=np.maximum(distances + noise, 0.0).astype(np.float32))


# Occupancy in a message by the value of a cell, see `floors.floor`.
_OCCUPANCY = np.array([0, -1, 100], np.int8)


def map_message(floor: Floor, frames: Frames) -> OccupancyGrid:
    """Return the walls of a floor, as map_server publishes them."""
    rows, columns = floor.cells.shape
    message = OccupancyGrid(
        header=Header(frame_id=frames.map), data=_OCCUPANCY[floor.cells].ravel())
    message.info.resolution = floor.resolution
    message.info.width, message.info.height = columns, rows
    message.info.origin.position.x, message.info.origin.position.y = floor.origin
    return message


_KINDS = {kind: getattr(StepDecision, f'DECISION_{kind.name}') for kind in Kind}
DECISION_NAMES = {number: kind.name.replace('_', ' ') for kind, number in _KINDS.items()}
_REASONS = {reason: getattr(StepDecision, f'REASON_{reason.name}') for reason in Reason}


def decision_message(stamp: Time, decision: Decision, position: float = math.nan,
                     frame: str = FRAMES.base) -> StepDecision:
    """Return a decision as a message, with its distances from a position [m] in a frame."""
    outlook, plan = decision.outlook, decision.plan
    crossing = plan if decision.kind in (Kind.CROSS, Kind.BACK_OFF) else None
    return StepDecision(
        header=Header(stamp=stamp, frame_id=frame), decision=_KINDS[decision.kind],
        reason=_REASONS[Reason(decision.reason)], speed=decision.set_speed,
        required_speed=decision.required_speed, reachable_speed=decision.reachable_speed,
        height=0.0 if math.isnan(decision.height) else decision.height,
        height_margin=decision.height_margin, distance=decision.distance,
        explanation=decision.explanation, plan=plan.strategy.value,
        probability=outlook.probability, probability_stuck=outlook.stuck,
        probability_falls=outlook.falls, required_probability=outlook.required,
        touch_speed=outlook.touch_speed, height_limit=outlook.height_limit,
        braking_room=outlook.braking_room, start_distance=math.nan if crossing is None else
        position - crossing.start if math.isfinite(crossing.start) else 0.0,
        swing_distance=math.nan if crossing is None else crossing.swing_position - position,
        swing_angle=plan.swing_angle if math.isfinite(plan.swing_position) else math.nan,
        attempts=outlook.attempts, others=list(outlook.others))
