# SPDX-License-Identifier: Apache-2.0
"""What happened in a run, in numbers that fit on a screen."""
from dataclasses import asdict, dataclass
import json
import math
from typing import Any, Optional

import numpy as np

from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.simulation.scene import Scene
from ballbot_ros.physics.simulation.trajectory import Trajectory
from ballbot_ros.results.faces import FaceMeeting, meet_faces
from ballbot_ros.results.warn import find_warnings


@dataclass(frozen=True)
class Summary:
    """
    A run in a few numbers, all SI; angles in rad.

    Where an accuracy was asked for, steps, evaluations and events are those of all runs that it
    took; without one, `accuracy`, `error_estimate` and `horizon` are None.
    """

    name: str  # of the scene
    robot: str
    complete: bool  # the run lasted as long as the scene asks for
    duration: float  # simulated [s]
    samples: int  # kept
    steps: int  # taken by the solver
    evaluations: int  # right-hand sides computed
    events: int  # kinks of the contact law located
    accuracy: Optional[float]  # largest error of position asked for [m]
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
    flight_fraction: float  # share of the samples without any contact
    landings: int  # how often contact began again after a flight; more than one is bouncing
    faces: tuple[FaceMeeting, ...]  # each rising face of the terrain
    energy_in_play: float  # energy that moved during the run [J]
    energy_residual: Optional[float]  # what the ledger misses, relative; None: nothing moved
    wall_time: Optional[float]  # what the run took [s]
    real_time_factor: Optional[float]  # simulated time over that
    warnings: tuple[str, ...]  # what a person should know before using the run

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain values for JSON; a number that is not finite is None."""
        content: dict[str, Any] = plain(asdict(self))
        return content

    def to_json(self) -> str:
        """Return the summary as a JSON object; see `to_dict`."""
        return json.dumps(self.to_dict(), indent=2, allow_nan=False)


def plain(value: Any) -> Any:
    """Return a value with only what JSON knows; a number that is not finite is None."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def summarise(trajectory: Trajectory, scene: Scene,
              wall_time: Optional[float] = None) -> Summary:
    """Return what happened in a run of a scene, ended early or not, that took a wall time [s]."""
    robot, run = scene.model.robot, scene.run
    asked = math.ceil(run.duration / run.output_step - 1e-9)
    samples = len(trajectory)
    time = trajectory['time']
    duration = float(time[-1] - time[0])
    # A run that diverged ends in numbers whose squares are out of range.
    with np.errstate(over='ignore', invalid='ignore'):
        speed = np.hypot(trajectory['velocity_x'], trajectory['velocity_y'])
        in_play = trajectory.energy_in_play
        residual = _largest(trajectory.energy_residual)
    flying = trajectory['penetration'] == 0.0

    def pendulum(name: str) -> Optional[float]:
        return _largest(trajectory[name]) if robot.has_pendulum else None

    assured = trajectory.assurance
    relative = residual / in_play if in_play > 0.0 else None
    return Summary(
        name=scene.name, robot=robot.name, complete=samples == asked + 1, duration=duration,
        samples=samples, steps=trajectory.effort.steps,
        evaluations=trajectory.effort.evaluations, events=trajectory.effort.events,
        accuracy=assured and assured.accuracy, error_estimate=assured and assured.estimate,
        horizon=assured and assured.horizon,
        x=float(trajectory['x'][-1]), y=float(trajectory['y'][-1]), speed=float(speed[-1]),
        highest_speed=float(np.max(speed)), lowest_speed=float(np.min(speed)),
        surface_normal_force=float(np.max(trajectory['surface_normal_force'])),
        edge_normal_force=float(np.max(trajectory['edge_normal_force'])),
        penetration=float(np.max(trajectory['penetration'])),
        pendulum_angle=pendulum('pendulum_angle'), pendulum_torque=pendulum('pendulum_torque'),
        flight_fraction=float(np.mean(flying)),
        landings=int(np.count_nonzero(flying[:-1] & ~flying[1:])),
        faces=tuple(meet_faces(trajectory)), energy_in_play=in_play,
        energy_residual=relative, wall_time=wall_time,
        real_time_factor=duration / wall_time if wall_time else None,
        warnings=tuple(find_warnings(trajectory, scene, asked + 1, relative)))


def _largest(values: Array) -> float:
    """Return the largest magnitude."""
    return float(np.max(np.abs(values)))
