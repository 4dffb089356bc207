# SPDX-License-Identifier: Apache-2.0
"""
Replay of a recorded run, and its deviation from the recording.

The run of a simulator is repeated state by state.  A real robot is compared with the model under
the recorded torque.
"""
from dataclasses import dataclass, field
import math
from pathlib import Path
from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Tuple, Union

import numpy as np

from ballbot_ros.bags.recorded_run import LATERAL_STATE, RecordedRun, Values
from ballbot_ros.config.files import located, read_config
from ballbot_ros.control import JointReadings, SupervisedController
from ballbot_ros.errors import ConfigurationError, MessageError, SimulationError
from ballbot_ros.physics import Scene
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.plant import Plant
from ballbot_ros.results.units import SI
from ballbot_ros.steering import law as steering_law
from ballbot_ros.studies.recording import Recording, replay


class Commands:
    """
    Each recorded command, in the period whose state it answers.

    Like the other sources of torque, it returns the torque from one stamp to the next [ns], None
    if it is unknown, and the set-point of the lean for a plant that steers [rad].
    """

    what = 'recorded commands, each in the period whose state it answers'

    def __init__(self, run: RecordedRun):
        self._commands, self._leans = run.commands, run.leans

    def torque(self, stamp: int, after: int, plant: Plant) -> Optional[float]:
        return self._commands.get(stamp)

    def lean(self, stamp: int, plant: Plant) -> float:
        return self._leans.get(stamp, 0.0)


class MotorTorques:
    """Torque of the motor according to the joint state at the end of a period."""

    what = 'torques of the motor from joint_states'

    def __init__(self, run: RecordedRun):
        self._joints = run.joints

    def torque(self, stamp: int, after: int, plant: Plant) -> Optional[float]:
        """Return the torque in the first state at the stamp `after`."""
        return self._joints[after][0].get('pendulum_torque', 0.0) \
            if after in self._joints else None

    def lean(self, stamp: int, plant: Plant) -> float:
        """Return the actual lean of the pendulum, because its set-point is unknown."""
        return plant.lateral.lean


class Laws:
    """Onboard control laws, which receive recorded set-points at the times of their stamps."""

    what = 'recorded set-points, applied to the laws on board at the times of their stamps'

    def __init__(self, run: RecordedRun, controller: SupervisedController):
        self._set_points = sorted(run.set_points, key=lambda given: given.stamp, reverse=True)
        self._controller = controller

    def torque(self, stamp: int, after: int, plant: Plant) -> Optional[float]:
        self._controller.take(JointReadings.of(plant.state))
        while self._set_points and self._set_points[-1].stamp <= plant.time + 1e-9:
            given = self._set_points.pop()
            try:
                self._controller.give(given)
            except MessageError:
                pass  # refused in the run, too
        return self._controller.answer() or 0.0

    def lean(self, stamp: int, plant: Plant) -> float:
        robot = plant.model.robot
        return steering_law(robot, plant.lateral, -robot.ball_radius * plant.state.ball_rate,
                            self._controller.set_point.yaw_rate)


Torques = Union[Commands, MotorTorques, Laws]


@dataclass(frozen=True)
class Departure:
    """The first value that differs from the recording."""

    time: float  # [s]
    states: int  # number of states before it, all identical
    channel: str
    recorded: float
    again: float


def plant_values(plant: Plant) -> Values:
    """Return the values of a plant that a bag may hold."""
    state = plant.state
    position_x, position_y, heading = plant.relative_pose
    return {**state._asdict(), 'joint_angle': state.joint_angle, 'joint_rate': state.joint_rate,
            **plant.lateral._asdict(), 'position_x': position_x, 'position_y': position_y,
            'heading': heading, 'pendulum_torque': float(plant.torque)}


@dataclass(eq=False)
class Rerun:
    """A repeated run."""

    what: str  # source of the torque
    states: int = 0  # number of compared states
    identical: int = 0  # number of bit-identical states
    departure: Optional[Departure] = None  # the first one
    applied: int = 0  # periods for which the source had a torque
    filled: int = 0  # periods without one, in which the motor torque was used
    resets: int = 0  # number of resets of the simulation
    ended: str = ''  # reason for an early end; empty without one
    # Values by channel and time [s].
    recorded: Dict[str, Dict[float, float]] = field(default_factory=dict)
    again: Dict[str, Dict[float, float]] = field(default_factory=dict)

    def compare(self, time: float, all_recorded: List[Values], plant: Plant) -> None:
        """Compare a state with its records from one or two topics."""
        again, good = plant_values(plant), True
        for recorded in all_recorded:
            for name, value in recorded.items():
                if value != value:
                    continue  # NaN: a robot without a pendulum
                self.recorded.setdefault(name, {})[time] = value
                self.again.setdefault(name, {})[time] = again[name]
                if value.hex() == again[name].hex():
                    continue
                good = False
                if self.departure is None:
                    self.departure = Departure(time, self.states, name, value, again[name])
        self.states += 1
        self.identical += good


def rerun(plant: Plant, run: RecordedRun, torques: Torques) -> Rerun:
    """
    Rerun a recording on a simulated plant from its start, and compare each recorded state.

    For an unknown torque, the motor torque in the next joint state is used.  Raises
    `ConfigurationError` if stamps are not those of the control rate.
    """
    moments = sorted({*run.joints, *run.balls})
    first, last = (round(stamp * 1e-9 / plant.period) for stamp in (moments[0], moments[-1]))
    grid = [round(number * plant.period * 1e9) for number in range(first, last + 1)]
    if not set(moments) <= set(grid):
        raise ConfigurationError(
            f'the stamps of the recording do not fit a control rate of {1.0 / plant.period:g} Hz: '
            'give the rate of that simulator, --set control_rate=...',
            'inconsistent', 'control_rate')
    plant.periods = first
    plant.reset()
    filler, found = MotorTorques(run), Rerun(torques.what)
    begin = Rerun('')
    begin.compare(plant.time, [*run.joints.get(moments[0], [])[:1],
                               *run.balls.get(moments[0], [])[:1]], plant)
    if first and not begin.identical:
        # A waiting simulator publishes its initial state once, before a later recorder subscribes.
        grid.insert(0, round((first - 1) * plant.period * 1e9))
        plant.periods = first - 1
        plant.reset()
    for place, stamp in enumerate(grid):
        joints, balls = run.joints.get(stamp, []), run.balls.get(stamp, [])
        for turn in range(max(len(joints), len(balls))):
            if turn:
                found.resets += 1
                plant.reset()
            found.compare(plant.time, [*joints[turn:turn + 1], *balls[turn:turn + 1]], plant)
        if stamp == grid[-1]:
            break
        torque = torques.torque(stamp, grid[place + 1], plant)
        if torque is None:
            torque = filler.torque(stamp, grid[place + 1], plant)
            found.filled += 1
            if torque is None:
                found.ended = (
                    f'the bag has neither the command that answers t = {plant.time:.3f} s '
                    'nor the joint state after it')
                break
        else:
            found.applied += 1
        try:
            plant.advance(torque, torques.lean(stamp, plant) if plant.steers else 0.0)
        except SimulationError as error:
            found.ended = str(error)
            break
    return found


# Times, measured values and model values.
Series = Mapping[str, Tuple[Array, Array, Array]]

UNITS = {**SI, **LATERAL_STATE}
DEPARTURE_SHARE = 0.05  # fraction of the range of a channel; a larger difference is a departure
JOINTS, ODOMETRY = ('ball_angle', 'ball_rate', 'joint_angle', 'joint_rate'), ('x', 'velocity_x')


class Difference(NamedTuple):
    """Deviation of the model from the recording, in the unit of a channel."""

    channel: str
    unit: str
    rms: float
    largest: float  # magnitude
    when: float  # of the largest [s]
    span: float  # range of the recorded values
    departs: float  # time at which the gap first exceeds `DEPARTURE_SHARE` [s]; NaN for never


def differences(series: Series) -> List[Difference]:
    """Return the difference of each channel."""
    found = []
    for name, (times, measured, model) in series.items():
        gap = np.abs(model - measured)
        span, worst = float(np.ptp(measured)), int(np.argmax(gap))
        far = np.flatnonzero(gap > DEPARTURE_SHARE * span)
        found.append(Difference(
            name, UNITS[name], float(np.sqrt(np.mean(gap**2))), float(gap[worst]),
            float(times[worst]), span, float(times[far[0]]) if len(far) else math.nan))
    return found


def measured_columns(run: RecordedRun) -> Dict[str, Array]:
    """
    Return the columns of a recording for `Recording.of_columns`, from its first state.

    The shell starts at the angle 0, as its earlier turns have no effect; the joint starts at the
    absolute angle of the pendulum.  Odometry is interpolated to the stamps of the joint states.

    Raises `ConfigurationError` if fewer than 8 joint states contain the shell and, if the robot
    has one, the pendulum.
    """
    names = JOINTS if any('joint_angle' in states[-1] for states in run.joints.values()) \
        else JOINTS[:2]
    rows = [(stamp, states[-1]) for stamp, states in sorted(run.joints.items())
            if all(math.isfinite(states[-1].get(name, math.nan)) for name in names)]
    seen = sorted(run.odometry)
    if seen:  # before and after it the position is unknown
        rows = [row for row in rows if seen[0] <= row[0] <= seen[-1]]
    if len(rows) < 8:
        raise ConfigurationError(
            f'the recording has {len(rows)} complete joint states'
            f'{" during its odometry" if seen else ""}; 8 are needed', 'missing', 'joint_states')
    begin = rows[0][0]
    columns = {'time': np.array([1e-9 * (stamp - begin) for stamp, _ in rows])}
    for name in names:
        columns[name] = np.array([values[name] for _, values in rows])
    turned = columns['ball_angle'][0]
    columns['ball_angle'] -= turned
    if 'joint_angle' in columns:
        columns['joint_angle'] += turned
    for name in ODOMETRY if seen else ():
        columns[name] = np.interp(
            columns['time'], [1e-9 * (stamp - begin) for stamp in seen],
            [run.odometry[stamp][name] for stamp in seen])
    torque = np.array([values.get('pendulum_torque', math.nan) for _, values in rows])
    if np.isfinite(torque).all():
        columns['pendulum_torque'] = torque
    return columns


def commanded_torque(run: RecordedRun, columns: Mapping[str, Array]) -> Array:
    """Return the commanded torque up to each row; `ConfigurationError` without commands."""
    if not run.commands:
        raise ConfigurationError(
            'the recording has no joint_commands', 'missing', 'joint_commands')
    begin = min(run.joints)
    stamps = sorted(run.commands)
    times = np.array([1e-9 * (stamp - begin) for stamp in stamps])
    # Between two rows the last command at the first of them applies.
    place = np.searchsorted(times, columns['time'] + 1e-9, side='right') - 1
    values = np.array([run.commands[stamp] for stamp in stamps])
    held = np.where(place >= 0, values[np.maximum(place, 0)], 0.0)
    return np.concatenate([held[:1], held[:-1]])


def scene_content(scene: str, robot: str, columns: Mapping[str, Array]) -> Dict[str, Any]:
    """
    Return the content of a scene file that starts as a recording does.

    Scene and robot are names or files; an empty robot keeps that of the scene.  The x of the
    columns is moved to the start of the scene, because odometry always starts at 0.
    """
    content = dict(read_config('scenes', scene)[1])
    robot = robot or str(content.get('robot', ''))
    content['robot'] = located(robot, Path.cwd())
    initial = dict(content.get('initial') or {})
    x = float(initial.get('x', 0.0))
    if 'x' in columns:
        columns['x'][:] += x - columns['x'][0]
    content['initial'] = {
        'x': x, 'speed': float(columns['velocity_x'][0]) if 'velocity_x' in columns else 0.0}
    if 'joint_angle' in columns:
        content['initial'].update(
            pendulum_angle_deg=math.degrees(columns['joint_angle'][0]),
            pendulum_rate=float(columns['joint_rate'][0] + columns['ball_rate'][0]))
    for law in ('actuation', 'accuracy'):
        content.pop(law, None)
    content['duration'] = float(columns['time'][-1])
    return content


def driven_series(scene: Scene, columns: Mapping[str, Array]) -> Series:
    """
    Return measured and modelled values of all channels, under the recorded torque.

    Raises `ConfigurationError` if there is no torque, `SimulationError` if the model fails.
    """
    recording = Recording.of_columns(columns)
    model = replay(scene, recording, use_torque=True)
    return {name: (times, values, model[name])
            for name, (times, values) in recording.channels.items()}
