# SPDX-License-Identifier: Apache-2.0
"""The run of one robot in a bag: states, commands and set-points by their stamps."""
from dataclasses import dataclass, field
import math
from pathlib import Path
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Tuple, Union

import numpy as np

from ballbot_ros.bags.opener import Bag, open_bag
from ballbot_ros.config.fields import suggestion
from ballbot_ros.control import Mode, SetPoint
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics import State, Trajectory
from ballbot_ros.physics.simulation.model import Model

Values = Dict[str, float]
# Fields of a ball_state that determine the further motion, and the motor torque.
BALL_STATE = ('x', 'y', 'ball_angle', 'pendulum_angle', 'velocity_x', 'velocity_y', 'ball_rate',
              'pendulum_rate', 'pendulum_torque', 'motor_work')
# Further fields of a ball_state, for a steered robot, with their units.
LATERAL_STATE = {
    'position_x': 'm', 'position_y': 'm', 'heading': 'rad', 'yaw_rate': 'rad/s',
    'lean': 'rad', 'lean_rate': 'rad/s', 'tilt': 'rad', 'tilt_rate': 'rad/s'}

# Topics with the state of a robot, and the types of their messages.
STATE_TYPES = {'joint_states': 'JointState', 'ball_state': 'BallState'}

# Names of angle and rate of each joint.
JOINT_VALUES = {
    'shell': ('ball_angle', 'ball_rate'), 'pendulum': ('joint_angle', 'joint_rate'),
    'lean': ('lean', 'lean_rate'), 'tilt': ('tilt', 'tilt_rate'), 'yaw': ('heading', 'yaw_rate')}


@dataclass(frozen=True, eq=False)
class RecordedRun:
    """A run, by stamp [ns]."""

    # Angles, rates and torque as on ``joint_states``.  One per stamp; more if the simulation was
    # reset at that time.
    joints: Dict[int, List[Values]] = field(default_factory=dict)
    # As on ``ball_state``; empty for a real robot.
    balls: Dict[int, List[Values]] = field(default_factory=dict)
    odometry: Dict[int, Values] = field(default_factory=dict)
    # Torque [N m] that answers the joint state of that stamp.
    commands: Dict[int, float] = field(default_factory=dict)
    # Set-point of the lean in the same command, for a steered robot [rad].
    leans: Dict[int, float] = field(default_factory=dict)
    # As sent; set-points from ``cmd_vel`` have `Mode.SPEED`.
    set_points: List[SetPoint] = field(default_factory=list)
    metadata: Mapping[str, str] = field(default_factory=dict)  # of the bag

    @property
    def stamps(self) -> List[int]:
        """Return the stamps of the joint states [ns]."""
        return sorted(self.joints)


def read_run(path: Path, namespace: Optional[str] = None) -> RecordedRun:
    """
    Return the run of a robot in a bag, which `namespace` selects if there are several.

    Raises `ConfigurationError` if the bag cannot be read, or has no joint states, or has several
    robots and no `namespace` is given.
    """
    with open_bag(path) as bag:
        where = robot_namespace(path, bag, namespace)
        run = RecordedRun(metadata=bag.metadata)
        handlers = {f'{where}/{name}': found for name, found in _handlers(run).items()}
        wanted = [topic for topic, kind in bag.topics.items()
                  if topic in handlers and kind.endswith(handlers[topic][0])]
        for topic, message in bag.messages(wanted):
            handlers[topic][1](message)
    if not run.joints:
        raise ConfigurationError(
            f'{path}: {where}/joint_states is empty: nothing to replay', 'missing', 'joint_states')
    return run


def robot_namespace(path: Path, bag: Bag, namespace: Optional[str] = None,
                    states: Sequence[str] = ('joint_states',)) -> str:
    """
    Return the namespace of the robot to read, without a slash at its end.

    Parameters
    ----------
    path : Path
        Of the bag, for error messages.
    bag : Bag
    namespace : str, optional
        Selects one of several robots.
    states : sequence of str
        Keys of `STATE_TYPES`; a robot publishes at least one of these topics.

    Raises
    ------
    ConfigurationError
        With reason ``wrong_kind`` if the bag has no robot, ``ambiguous`` for several robots
        without a namespace, ``unknown_name`` for a namespace without a robot.

    """
    found = sorted({topic.rpartition('/')[0] for topic, kind in bag.topics.items() if any(
        topic.endswith(f'/{name}') and kind.endswith(f'/{STATE_TYPES[name]}')
        for name in states)})
    if not found:
        raise ConfigurationError(
            f'{path}: has no {" or ".join(states)}, so it is not a recording of a ball robot; it '
            'has ' + (', '.join(sorted(bag.topics)) or 'nothing'), 'wrong_kind', states[0])
    names = [name or '/' for name in found]
    if namespace is None:
        if len(found) > 1:
            raise ConfigurationError(
                f'{path}: has {len(found)} robots; name one: --namespace {" or ".join(names)}',
                'ambiguous', '--namespace')
        return found[0]
    wanted = f'/{namespace.strip("/")}' if namespace.strip('/') else ''
    if wanted not in found:
        raise ConfigurationError(
            f'{path}: has no robot {namespace!r}{suggestion(namespace, names)}',
            'unknown_name', '--namespace')
    return wanted


def joint_values(message: Any) -> Dict[str, float]:
    """Return angles, rates and torque of a sensor_msgs/JointState."""
    values = {}
    for place, joint in enumerate(message.name):
        names = JOINT_VALUES.get(joint)
        if names is None:
            continue
        for name, numbers in zip(names, (message.position, message.velocity)):
            if place < len(numbers):
                values[name] = float(numbers[place])
        if joint == 'pendulum' and place < len(message.effort):
            values['pendulum_torque'] = float(message.effort[place])
    return values


def stamp_of(message: Any) -> int:
    """Return the stamp of a message with a header [ns]."""
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


def _handlers(run: RecordedRun) -> Dict[
        str, Tuple[Union[str, Tuple[str, ...]], Callable[[Any], object]]]:
    """Return message type and handler by the last part of the topic."""
    def state(kept: Dict[int, List[Values]], stamp: int, values: Values) -> None:
        known = kept.setdefault(stamp, [])
        if not known or not same(known[-1], values):  # a repeated one counts once
            known.append(values)

    def command(message: Any) -> None:
        torque = joint_values(message).get('pendulum_torque', math.nan)
        if math.isfinite(torque):
            # The first one counts; a terminated controller sends a final one with zero torque.
            run.commands.setdefault(stamp_of(message), torque)
            run.leans.setdefault(stamp_of(message), joint_values(message).get('lean', 0.0))

    def set_at(message: Any) -> float:
        """Return the time of a set-point [s]; without a stamp, that of the last joint states."""
        own = stamp_of(message) if hasattr(message, 'header') else 0
        return 1e-9 * (own or next(reversed(run.joints), 0))

    def speed(message: Any) -> None:
        twist = getattr(message, 'twist', message)
        run.set_points.append(SetPoint(Mode.SPEED, float(twist.linear.x), set_at(message),
                                       float(twist.angular.z)))

    return {
        'joint_states': (STATE_TYPES['joint_states'], lambda message: state(
            run.joints, stamp_of(message), joint_values(message))),
        'ball_state': (STATE_TYPES['ball_state'], lambda message: state(
            run.balls, stamp_of(message), {
                name: float(getattr(message, name))
                for name in (*BALL_STATE, *LATERAL_STATE)})),
        'odom': ('Odometry', lambda message: run.odometry.setdefault(stamp_of(message), {
            'x': float(message.pose.pose.position.x),
            'velocity_x': float(message.twist.twist.linear.x)})),
        'joint_commands': ('JointState', command),
        'set_point': ('JointState', lambda message: run.set_points.append(
            _set_point(message, set_at(message)))),
        'cmd_vel': (('TwistStamped', 'Twist'), speed)}


def same(one: Mapping[str, float], other: Mapping[str, float]) -> bool:
    """Return whether the values of two states are bit-identical."""
    return {name: value.hex() for name, value in one.items()} \
        == {name: value.hex() for name, value in other.items()}


def recorded_trajectory(model: Model, states: Sequence[Tuple[float, Mapping[str, float]]]
                        ) -> Trajectory:
    """Return ball states with their times [s] as a trajectory; unrecorded columns are 0."""
    return Trajectory(model, np.array([
        (*State(time, **{name: value for name, value in values.items() if name in State._fields}),
         values['pendulum_torque']) for time, values in states]))


def _set_point(message: Any, stamp: float) -> SetPoint:
    """Return the request of a set-point: an angle or a rate with a yaw rate, or no torque."""
    values = joint_values(message)
    for mode, name in ((Mode.HOLD, 'joint_angle'), (Mode.DRIVE, 'joint_rate')):
        if math.isfinite(values.get(name, math.nan)):
            return SetPoint(mode, values[name], stamp, values.get('yaw_rate', 0.0))
    return SetPoint(Mode.IDLE, 0.0, stamp)
