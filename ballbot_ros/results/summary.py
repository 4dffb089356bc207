# SPDX-License-Identifier: Apache-2.0
"""Summary of a run: extremes, contacts, steps, accuracy and warnings."""
from dataclasses import asdict, dataclass
import json
import math
from typing import Any, Optional

import numpy as np

from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.simulation.trajectory import Trajectory
from ballbot_ros.results.faces import FaceMeeting, watch_faces
from ballbot_ros.results.resolved import resolved
from ballbot_ros.results.warn import find_warnings


@dataclass(frozen=True)
class Summary:
    """
    A run in a few numbers, all SI; angles in rad.

    With an accuracy, steps, evaluations and events are those of all its runs; without one,
    `accuracy`, `error_estimate` and `horizon` are None.
    """

    name: str  # of the scene
    robot: str
    complete: bool  # the run lasted as long as the scene asks for
    duration: float  # simulated [s]
    samples: int  # kept
    steps: int  # taken by the solver
    evaluations: int  # right-hand sides computed
    events: int  # located events of the contact law
    accuracy: Optional[float]  # requested largest error of position [m]
    error_estimate: Optional[float]  # the error estimated [m]
    horizon: Optional[float]  # time up to which it holds [s]
    x: float  # of the centre at the end [m]
    y: float
    speed: float  # of the centre at the end [m/s]
    highest_speed: float  # of the centre [m/s]
    lowest_speed: float
    surface_normal_force: float  # largest [N]
    edge_normal_force: float
    penetration: float  # largest [m]
    pendulum_angle: Optional[float]  # largest magnitude [rad]; None without a pendulum
    pendulum_torque: Optional[float]  # largest magnitude [N m]; None without a pendulum
    flight_fraction: float  # part of the time without any contact
    landings: int  # contacts after a flight; more than one is bouncing
    faces: tuple[FaceMeeting, ...]  # each rising face of the terrain
    energy_in_play: float  # reference energy of the run [J]
    energy_residual: Optional[float]  # relative energy balance error; None: nothing moved
    wall_time: Optional[float]  # of the run [s]
    real_time_factor: Optional[float]  # simulated time over that
    warnings: tuple[str, ...]  # results that need attention

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain values for JSON; a number that is not finite is None."""
        content: dict[str, Any] = plain(asdict(self))
        return content

    def to_json(self) -> str:
        """Return the summary as a JSON object; see `to_dict`."""
        return json.dumps(self.to_dict(), indent=2, allow_nan=False)


def plain(value: Any) -> Any:
    """Return a value as JSON types; a number that is not finite is None."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def summarise(trajectory: Trajectory, wall_time: Optional[float] = None) -> Summary:
    """
    Return the summary of a complete or partial run with its wall time [s].

    Extremes and contacts do not depend on the output step of the run.
    """
    robot, scene = trajectory.model.robot, trajectory.scene
    samples = len(trajectory)
    asked = samples if scene is None else 1 + math.ceil(
        scene.run.duration / scene.run.output_step - 1e-9)
    time = trajectory['time']
    duration = float(time[-1] - time[0])
    # The squares of diverged states overflow.
    with np.errstate(over='ignore', invalid='ignore'):
        in_play = trajectory.energy_in_play
        residual = _largest(trajectory.energy_residual)
        found, faces = Extremes(robot.slip_threshold), watch_faces(trajectory)
        for piece in resolved(trajectory):
            found.take(piece)
            for face in faces:
                face.take(piece)
    assured = trajectory.assurance
    relative = residual / in_play if in_play > 0.0 else None
    pendulum = robot.has_pendulum
    return Summary(
        name=scene.name if scene is not None else '', robot=robot.name,
        complete=samples == asked, duration=duration,
        samples=samples, steps=trajectory.effort.steps,
        evaluations=trajectory.effort.evaluations, events=trajectory.effort.events,
        accuracy=assured and assured.accuracy, error_estimate=assured and assured.estimate,
        horizon=assured and assured.horizon,
        x=float(trajectory['x'][-1]), y=float(trajectory['y'][-1]), speed=math.hypot(
            trajectory['velocity_x'][-1], trajectory['velocity_y'][-1]),
        highest_speed=found.highest['speed'], lowest_speed=found.lowest_speed,
        surface_normal_force=found.highest['surface_normal_force'],
        edge_normal_force=found.highest['edge_normal_force'],
        penetration=found.highest['penetration'],
        pendulum_angle=found.highest['pendulum_angle'] if pendulum else None,
        pendulum_torque=found.highest['pendulum_torque'] if pendulum else None,
        flight_fraction=found.flight_fraction, landings=found.landings,
        faces=tuple(face.result for face in faces), energy_in_play=in_play,
        energy_residual=relative, wall_time=wall_time,
        real_time_factor=duration / wall_time if wall_time else None,
        warnings=tuple(find_warnings(trajectory, asked, relative, found.highest['penetration'],
                                     found.sliding_fraction)))


class Extremes:
    """
    Extremes of a run and how often the ball flew, landed and slid, from its pieces.

    Attributes
    ----------
    highest : dict of str to float
        Largest magnitudes by column, and of the speed.
    lowest_speed : float
    landings : int

    """

    def __init__(self, slip_threshold: float):
        self._slip_threshold = slip_threshold
        self.highest: dict[str, float] = {}
        self.lowest_speed, self.landings = math.inf, 0
        self._samples = self._flying = self._sliding = 0

    def take(self, piece: Trajectory) -> None:
        """Take the next part of the run."""
        speed = np.hypot(piece['velocity_x'], piece['velocity_y'])
        self.lowest_speed = min(self.lowest_speed, float(np.min(speed)))
        self._keep('speed', speed)
        for name in ('surface_normal_force', 'edge_normal_force', 'penetration',
                     'pendulum_angle', 'pendulum_torque'):
            self._keep(name, piece[name])
        flying = piece['penetration'] == 0.0
        self.landings += int(np.count_nonzero(flying[:-1] & ~flying[1:]))
        # A piece begins with the last sample of the one before.
        new = slice(1 if self._samples else 0, None)
        self._samples += len(flying[new])
        self._flying += int(np.count_nonzero(flying[new]))
        slip = np.abs(piece['slip_velocity'][new]) >= self._slip_threshold
        self._sliding += int(np.count_nonzero(slip & ~flying[new]))

    def _keep(self, name: str, values: Array) -> None:
        # np.maximum keeps NaN, so that divergence stays visible.
        self.highest[name] = float(np.maximum(self.highest.get(name, 0.0), _largest(values)))

    @property
    def flight_fraction(self) -> float:
        """Return the part of the time without any contact."""
        return self._flying / self._samples

    @property
    def sliding_fraction(self) -> float:
        """Return the part of the time in contact with full sliding."""
        return self._sliding / max(self._samples - self._flying, 1)


def _largest(values: Array) -> float:
    """Return the largest magnitude."""
    return float(np.max(np.abs(values)))
