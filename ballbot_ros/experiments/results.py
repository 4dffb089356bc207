# SPDX-License-Identifier: Apache-2.0
"""Results of a run of an experiment: numbers, and digests to compare runs."""
from dataclasses import fields, is_dataclass
import hashlib
import json
from pathlib import Path
from typing import Any, Dict, List, NamedTuple, Optional, Tuple

import numpy as np

from ballbot_ros.bags.opener import open_bag
from ballbot_ros.bags.recorded_run import read_run, RecordedRun
from ballbot_ros.physics import Scene, Trajectory
from ballbot_ros.results.digests import digest, LENGTH
from ballbot_ros.results.faces import meet_faces


class TopicDigests(NamedTuple):
    """Digests of messages by topic and stamp [ns]."""

    topics: Dict[str, Dict[int, str]]

    @property
    def digests(self) -> Dict[str, str]:
        """Return a digest of each topic."""
        return {name: hashlib.sha256(''.join(
            f'{stamp}{text}' for stamp, text in sorted(messages.items())).encode()
            ).hexdigest()[:LENGTH] for name, messages in sorted(self.topics.items())}


def read_digests(path: Path, until: int) -> TopicDigests:
    """
    Return the digests of all messages up to a stamp [ns]; repeated messages count once.

    Raises
    ------
    ConfigurationError
        If the bag cannot be read.

    """
    topics: Dict[str, Dict[int, str]] = {}
    with open_bag(path) as bag:
        for topic, message in bag.messages(list(bag.topics)):
            header = getattr(message, 'header', None)
            if header is None:
                continue
            stamp = int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec)
            content = _plain(message)
            if stamp <= until:
                topics.setdefault(topic, {}).setdefault(stamp, digest(content))
    return TopicDigests(topics)


def _plain(value: Any) -> Any:
    """Return a message as mappings, lists and numbers."""
    if is_dataclass(value):
        return {item.name: _plain(getattr(value, item.name)) for item in fields(value)
                if not item.name.startswith('__')}
    if hasattr(value, 'get_fields_and_field_types'):  # of rclpy
        return {name: _plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, (str, bytes, int, float, bool)):
        return value if not isinstance(value, bytes) else value.hex()
    return [_plain(item) for item in (value.tolist() if hasattr(value, 'tolist') else value)]


def first_difference(one: TopicDigests, other: TopicDigests) -> Optional[Tuple[int, str]]:
    """Return the stamp [ns] and the topic of the first message that is not the same."""
    found: List[Tuple[int, str]] = []
    for name in {*one.topics, *other.topics}:
        here, there = one.topics.get(name, {}), other.topics.get(name, {})
        different = [stamp for stamp in {*here, *there} if here.get(stamp) != there.get(stamp)]
        found += [(min(different), name)] if different else []
    return min(found, default=None)


def numbers_of(path: Path, scene: Scene) -> Dict[str, Any]:
    """Return a summary of a run, SI, with its contacts at each step."""
    trajectory = _trajectory(read_run(path), scene)
    speed = np.hypot(trajectory['velocity_x'], trajectory['velocity_y'])
    meetings = meet_faces(trajectory)
    return {
        'x': float(trajectory['x'][-1]), 'speed': float(speed[-1]),
        'highest_speed': float(speed.max()),
        'pendulum_angle': float(np.abs(trajectory['pendulum_angle']).max()),
        'pendulum_torque': float(np.abs(trajectory['pendulum_torque']).max()),
        'motor_work': float(trajectory['motor_work'][-1]),
        'faces_passed': sum(face.passed for face in meetings),
        'touch_times': [face.touch_time for face in meetings],
        'touch_speeds': [face.touch_speed for face in meetings]}


def _trajectory(run: RecordedRun, scene: Scene) -> Trajectory:
    """Return the recorded ball states as a trajectory."""
    names = ('ball_angle', 'pendulum_angle', 'x', 'y', 'ball_rate', 'pendulum_rate',
             'velocity_x', 'velocity_y')
    rows = np.zeros((len(run.balls), 15))
    for row, (stamp, states) in zip(rows, sorted(run.balls.items())):
        values = states[-1]
        row[0], row[1:9] = 1e-9 * stamp, [values[name] for name in names]
        row[13:] = values['motor_work'], values['pendulum_torque']
    return Trajectory(scene.model, rows)


def as_json(content: Any) -> str:
    """Return text for a file."""
    return json.dumps(content, indent=2, allow_nan=False) + '\n'
