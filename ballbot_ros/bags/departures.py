# SPDX-License-Identifier: Apache-2.0
"""Deviation of a model from a recording per channel, and the input of `identify`."""
import math
from pathlib import Path
from typing import Any, Dict, List, Mapping, NamedTuple, Tuple

import numpy as np

from ballbot_ros.bags.recorded_run import LATERAL_STATE, RecordedRun
from ballbot_ros.config.files import find_config, is_path, read_yaml
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics import Scene
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.studies.recording import CHANNELS, Recording, replay

# Times, measured and model.
Series = Mapping[str, Tuple[Array, Array, Array]]

UNITS = {**CHANNELS, **LATERAL_STATE, 'pendulum_torque': 'N m', 'motor_work': 'J'}
DEPARTURE_SHARE = 0.05  # of the range of a channel: from there on the model has departed
JOINTS, ODOMETRY = ('ball_angle', 'ball_rate', 'joint_angle', 'joint_rate'), ('x', 'velocity_x')


class Difference(NamedTuple):
    """Deviation of the model from the recording, in the unit of a channel."""

    channel: str
    unit: str
    rms: float
    largest: float  # magnitude
    when: float  # of the largest [s]
    span: float  # of the recording, from its least to its largest value
    departs: float  # when the gap first exceeds `DEPARTURE_SHARE` of the span [s]; NaN for never


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
    Return the columns of a recording as `Recording.of_columns` takes them, from its first state.

    The shell starts at the angle 0, for its turns so far do not matter: the joint starts at the
    absolute angle of the pendulum.  Odometry is interpolated to the stamps of the joint states.

    Raises
    ------
    ConfigurationError
        If there are fewer than 8 joint states with shell and pendulum.

    """
    rows = [(stamp, states[-1]) for stamp, states in sorted(run.joints.items())
            if all(math.isfinite(states[-1].get(name, math.nan)) for name in JOINTS)]
    seen = sorted(run.odometry)
    if seen:  # nothing is known of the place outside
        rows = [row for row in rows if seen[0] <= row[0] <= seen[-1]]
    if len(rows) < 8:
        raise ConfigurationError(
            f'the recording has {len(rows)} joint states of shell and pendulum'
            f'{" during its odometry" if seen else ""}; 8 are needed', 'missing', 'joint_states')
    begin = rows[0][0]
    columns = {'time': np.array([1e-9 * (stamp - begin) for stamp, _ in rows])}
    for name in JOINTS:
        columns[name] = np.array([values[name] for _, values in rows])
    turned = columns['ball_angle'][0]
    columns['ball_angle'] -= turned
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
    """
    Return the torque that was commanded, each up to the time of a row as `Recording` counts it.

    Raises
    ------
    ConfigurationError
        If nothing was commanded.

    """
    if not run.commands:
        raise ConfigurationError(
            'the recording has no joint_commands', 'missing', 'joint_commands')
    begin = min(run.joints)
    stamps = sorted(run.commands)
    times = np.array([1e-9 * (stamp - begin) for stamp in stamps])
    # In force between two rows is what was commanded last at the first of them.
    place = np.searchsorted(times, columns['time'] + 1e-9, side='right') - 1
    values = np.array([run.commands[stamp] for stamp in stamps])
    held = np.where(place >= 0, values[np.maximum(place, 0)], 0.0)
    return np.concatenate([held[:1], held[:-1]])


def scene_content(scene: str, robot: str, columns: Mapping[str, Array],
                  from_scene: bool) -> Dict[str, Any]:
    """
    Return the content of a scene file that starts as a recording does.

    Parameters
    ----------
    scene, robot : str
        Names or files; an empty robot keeps that of the scene.
    columns : mapping
        See `measured_columns`.
    from_scene : bool
        Whether the position counts from where the scene starts: odometry of a real robot begins
        at 0 wherever that is.  Otherwise the x of the recording is that of the scene.

    """
    content = dict(read_yaml(find_config('scenes', scene)))
    robot = robot or str(content.get('robot', ''))
    content['robot'] = str(Path(robot).expanduser().resolve()) if is_path(robot) else robot
    initial = dict(content.get('initial') or {})
    x = float(initial.get('x', 0.0))
    if 'x' in columns:
        if from_scene:
            columns['x'][:] += x - columns['x'][0]
        x = float(columns['x'][0])
    content['initial'] = {
        'x': x, 'speed': float(columns['velocity_x'][0]) if 'velocity_x' in columns else 0.0,
        'pendulum_angle_deg': math.degrees(columns['joint_angle'][0]),
        'pendulum_rate': float(columns['joint_rate'][0] + columns['ball_rate'][0])}
    for law in ('actuation', 'accuracy'):
        content.pop(law, None)
    content['duration'] = float(columns['time'][-1])
    return content


def driven_series(scene: Scene, columns: Mapping[str, Array]) -> Series:
    """
    Return measured and model of all channels, under the torque in the recording.

    Raises
    ------
    ConfigurationError
        If there is no torque.
    SimulationError
        If the model cannot go on.

    """
    recording = Recording.of_columns(columns)
    model = replay(scene, recording, use_torque=True)
    return {name: (times, values, model[name])
            for name, (times, values) in recording.channels.items()}
