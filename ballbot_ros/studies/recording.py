# SPDX-License-Identifier: Apache-2.0
"""Measurements of a run, with separate times for each channel."""
from dataclasses import dataclass
from typing import Any, Dict, Mapping, Optional, Tuple

import numpy as np

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics import Model, Scene, simulate, Solver, Trajectory
from ballbot_ros.physics.model.actuation import Actuator, TORQUE
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.simulation.solver import failure
from ballbot_ros.physics.solvers.values import FINISHED, Status

# Channels that can be compared; `results.units.SI` has their units.
CHANNELS = ('x', 'y', 'velocity_x', 'velocity_y', 'ball_angle', 'ball_rate', 'pendulum_angle',
            'pendulum_rate', 'joint_angle', 'joint_rate')
FEWEST_SAMPLES, MOST_SAMPLES = 8, 2000  # per channel; longer channels are decimated
SOLVER = Solver('adaptive', 1e-3, 1e-9)
GRID = 1e-3  # [s]: between samples of the simulation, which are interpolated


@dataclass(frozen=True, eq=False)
class Recording:
    """
    Measurements of a run.

    Raises `ConfigurationError` if a channel is unknown, has too few samples, or its times do not
    increase.
    """

    channels: Mapping[str, Tuple[Array, Array]]  # times [s] count from the start of the scene
    # Times [s] and torques of the pendulum motor [N m]; each torque applies up to its time.
    torque: Optional[Tuple[Array, Array]] = None

    def __post_init__(self) -> None:
        if not self.channels:
            raise ConfigurationError(
                'recording: it has no channel that can be compared; the known channels are '
                + ', '.join(CHANNELS), 'missing', 'channels')
        checked = {}
        for name, (times, values) in self.channels.items():
            if name not in CHANNELS:
                raise ConfigurationError(
                    f'recording: channel {name!r} is unknown; known are ' + ', '.join(CHANNELS),
                    'unknown_name', name)
            times, values = _series(name, times, values)
            stride = -(-len(times) // MOST_SAMPLES)
            checked[name] = times[::stride], values[::stride]
        object.__setattr__(self, 'channels', checked)
        if self.torque is not None:
            object.__setattr__(self, 'torque', _series('pendulum_torque', *self.torque))

    @property
    def duration(self) -> float:
        """Return the time of the last sample [s]."""
        return max(float(times[-1]) for times, _ in self.channels.values())

    def only(self, names: Any) -> 'Recording':
        """Return a recording of some channels; raises `ConfigurationError` for a missing one."""
        missing = [name for name in names if name not in self.channels]
        if missing:
            raise ConfigurationError(
                f'recording: there is no channel {", ".join(missing)}; there are '
                + ', '.join(self.channels), 'unknown_name', missing[0])
        return Recording({name: self.channels[name] for name in names}, self.torque)

    @classmethod
    def of_columns(cls, columns: Mapping[str, Array]) -> 'Recording':
        """Return a recording from the columns of a trajectory file."""
        if 'time' not in columns:
            raise ConfigurationError('recording: there is no column time', 'missing', 'time')
        times = columns['time'] - columns['time'][0]
        torque = columns.get('pendulum_torque')
        return cls({name: (times, columns[name]) for name in CHANNELS if name in columns},
                   None if torque is None else (times, torque))


def _series(name: str, times: Any, values: Any) -> Tuple[Array, Array]:
    moments, numbers = np.array(times, dtype=float), np.array(values, dtype=float)
    if len(moments) != len(numbers) or len(moments) < FEWEST_SAMPLES:
        raise ConfigurationError(
            f'recording: {name} needs at least {FEWEST_SAMPLES} samples, got {len(numbers)}',
            'out_of_range', name)
    for column, series in (('time', moments), (name, numbers)):
        wrong = np.flatnonzero(~np.isfinite(series))
        if len(wrong):
            raise ConfigurationError(
                f'recording: column {column}: {series[wrong[0]]} in sample {wrong[0] + 1}; '
                'remove the sample or the column', 'not_finite', column)
    falls = np.flatnonzero(np.diff(moments) <= 0.0)
    if len(falls):
        row = int(falls[0]) + 2
        raise ConfigurationError(
            f'recording: the times of {name} must increase; sample {row} has '
            f'{moments[row - 1]:g} s after {moments[row - 2]:g} s', 'inconsistent', 'time')
    if moments[0] < 0.0:
        raise ConfigurationError(
            f'recording: the times of {name} must start at 0 s or later, got {moments[0]:g} s',
            'out_of_range', 'time')
    return moments, numbers


def replay(scene: Scene, recording: Recording, use_torque: bool, solver: Solver = SOLVER,
           grid: float = GRID) -> Dict[str, Array]:
    """
    Return the samples of each channel from the simulation of a scene.

    Solver and duration of the scene are not used; samples are interpolated on a grid of time [s].
    With `use_torque`, the recorded torque is applied instead of the law of the scene.

    Raises `ConfigurationError` if there is no torque, `SimulationError` if the run fails, and
    `KeyboardInterrupt` if Ctrl-C has ended the run early.
    """
    model = Model(scene.model.robot, scene.model.terrain, scene.model.options, solver)
    if use_torque:
        rows = _driven(model, scene, recording)
    else:
        rows = simulate(model, scene.initial.state(model), scene.actuation,
                        recording.duration + 2.0 * grid, grid).rows
        if rows[-1, 0] < recording.duration:
            raise KeyboardInterrupt
    columns = Trajectory(model, rows).columns
    known = dict(columns, joint_angle=columns['pendulum_angle'] - columns['ball_angle'],
                 joint_rate=columns['pendulum_rate'] - columns['ball_rate'])
    return {name: np.interp(times, columns['time'], known[name])
            for name, (times, _) in recording.channels.items()}


def _driven(model: Model, scene: Scene, recording: Recording) -> Array:
    """Return rows of a run under the recorded torque, one per sample of the torque."""
    if recording.torque is None:
        raise ConfigurationError(
            'recording: there is no column pendulum_torque to apply', 'missing', 'pendulum_torque')
    state = scene.initial.state(model)
    vector, status = np.array(state[1:]), Status(FINISHED, state.time)
    times, torques = recording.torque
    rows = [[*state, 0.0]]
    for moment, torque in zip(times.tolist(), torques.tolist()):
        if moment <= status.time:
            continue
        status = model.integrator.advance(
            # The torque jumps: the step size is kept, the rates are not.
            Actuator(TORQUE, torque), vector, status._replace(has_mode=False), moment)
        if status.outcome != FINISHED:
            raise failure(status.outcome, status.time, vector, model.solver_in_use)
        rows.append([moment, *vector.tolist(), torque])
    return np.array(rows)
