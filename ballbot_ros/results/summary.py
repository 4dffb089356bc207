# SPDX-License-Identifier: Apache-2.0
"""Summary of a run: extremes, contacts, steps, accuracy, warnings, and a text report."""
from dataclasses import asdict, dataclass
import math
from textwrap import wrap
from typing import Any, Iterator, Optional

import numpy as np

from ballbot_ros.physics.model.robot import (
    angle_warnings, height_warnings, implausible, PENETRATION_MAX, speed_warnings)
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.simulation.scene import Scene
from ballbot_ros.physics.simulation.trajectory import Trajectory
from ballbot_ros.results.faces import FaceMeeting, rising_faces, watch_faces
from ballbot_ros.results.resolved import resolved
from ballbot_ros.table import table


@dataclass(frozen=True)
class Summary:
    """
    Key numbers of a run, all in SI units; angles in rad.

    With an accuracy, steps, evaluations and events are totals over all integrations; without one,
    `accuracy`, `error_estimate` and `horizon` are None.
    """

    name: str  # of the scene
    robot: str
    complete: bool  # the run has the duration of the scene
    duration: float  # simulated [s]
    samples: int  # stored
    steps: int  # taken by the solver
    evaluations: int  # right-hand sides computed
    events: int  # located events of the contact law
    accuracy: Optional[float]  # requested largest error of position [m]
    error_estimate: Optional[float]  # estimated error of position [m]
    horizon: Optional[float]  # time up to which the estimate is valid [s]
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
    flight_fraction: float  # fraction of the time without any contact
    landings: int  # contacts after a flight; more than one is bouncing
    faces: tuple[FaceMeeting, ...]  # each rising face of the terrain
    energy_in_play: float  # reference energy of the run [J]
    energy_residual: Optional[float]  # relative energy balance error; None: nothing moved
    wall_time: Optional[float]  # of the run [s]
    real_time_factor: Optional[float]  # simulated time over wall time
    warnings: tuple[str, ...]  # results that need attention

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain values for JSON; a number that is not finite is None."""
        content: dict[str, Any] = plain(asdict(self))
        return content


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
    """Return the summary of a run with its wall time [s]; the output step has no effect."""
    robot, scene = trajectory.model.robot, trajectory.scene
    samples = len(trajectory)
    requested = samples if scene is None else 1 + math.ceil(
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
        complete=samples == requested, duration=duration,
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
        warnings=tuple(find_warnings(trajectory, requested, relative, found.highest['penetration'],
                                     found.sliding_fraction)))


class Extremes:
    """Extremes, flight, landings and sliding of a run, accumulated from its pieces."""

    def __init__(self, slip_threshold: float):
        self._slip_threshold = slip_threshold
        self.highest: dict[str, float] = {}  # largest magnitudes by column, and of the speed
        self.lowest_speed, self.landings = math.inf, 0
        self._samples = self._flying = self._sliding = 0

    def take(self, piece: Trajectory) -> None:
        """Process the next part of the run."""
        speed = np.hypot(piece['velocity_x'], piece['velocity_y'])
        self.lowest_speed = min(self.lowest_speed, float(np.min(speed)))
        self._keep('speed', speed)
        for name in ('surface_normal_force', 'edge_normal_force', 'penetration',
                     'pendulum_angle', 'pendulum_torque'):
            self._keep(name, piece[name])
        flying = piece['penetration'] == 0.0
        self.landings += int(np.count_nonzero(flying[:-1] & ~flying[1:]))
        # A piece begins with the last sample of the previous one.
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
        """Return the fraction of the time without any contact."""
        return self._flying / self._samples

    @property
    def sliding_fraction(self) -> float:
        """Return the fraction of the time in contact with full sliding."""
        return self._sliding / max(self._samples - self._flying, 1)


def _largest(values: Array) -> float:
    return float(np.max(np.abs(values)))


# Relative energy balance error above which a smaller step is needed.
RESIDUAL_MAX = 1e-5

TOP_DEG = 180.0  # pendulum angle above the centre of the ball

# Fraction of the time in contact with full sliding above which the ball never rolled.
SLIDING_MAX = 0.9


def find_warnings(trajectory: Trajectory, expected: int, residual: Optional[float], depth: float,
                  sliding: float) -> Iterator[str]:
    """
    Yield one sentence for each result that needs attention.

    A complete run has the `expected` samples.  `residual` is the energy balance error relative to
    the reference energy, `depth` the largest penetration [m], `sliding` the fraction of the time
    in contact with full sliding.
    """
    model, assured = trajectory.model, trajectory.assurance
    robot, solver = model.robot, model.solver_in_use
    if trajectory.scene is not None:
        yield from scene_warnings(trajectory.scene)
    finer = solver.finer if assured is None else 'a smaller accuracy'
    if assured is not None and not assured.complete:
        yield (f'the motion is chaotic: the accuracy of {assured.accuracy:g} m holds up to '
               f'{assured.horizon:.4g} s, and no tolerance extends this time')
    if len(trajectory) < expected:
        yield (f'the run ended early: {len(trajectory)} of {expected} samples, up to '
               f'{trajectory["time"][-1]:g} s')
    if not np.isfinite(trajectory.rows).all():
        yield f'some numbers are not finite; use {finer}'
    elif residual is not None and not residual <= RESIDUAL_MAX:
        yield (f'the energy balance error is {residual:.1e} relative to the reference energy '
               f'(good: at most {RESIDUAL_MAX:.0e}); use {finer}')
    if depth > PENETRATION_MAX * robot.ball_radius:
        yield (f'the ball sank {1e3 * depth:.3g} mm into the ground, more than '
               f'{PENETRATION_MAX:.0%} of its radius; contact_stiffness is too low for this '
               'impact')
    if sliding > SLIDING_MAX:
        yield (f'the ball slid for {sliding:.0%} of its time in contact, so it never '
               'rolled; start it without slip (initial: speed), drive it less or raise '
               'surface_friction')
    still = np.ptp(trajectory.rows[:, 1:9], axis=0).max() < 1e-6
    if still and len(trajectory) > 1:
        yield 'nothing moved: give the scene an initial speed (initial) or an actuation'


def scene_warnings(scene: Scene) -> Iterator[str]:
    """Yield a sentence for each implausible value of a scene or its robot."""
    robot, start = scene.model.robot, scene.initial
    yield from implausible(robot)
    for face in rising_faces(scene.model.terrain, robot.ball_radius):
        yield from height_warnings(robot, float(face[-1, 1] - face[0, 1]),
                                   f'at x = {face[0, 0]:g} m')
    for name in ('speed', 'velocity_x', 'velocity_y'):
        yield from speed_warnings(getattr(start, name) or 0.0, f'initial {name}')
    if abs(start.pendulum_angle_deg) > TOP_DEG:
        yield (f'initial pendulum_angle_deg is {start.pendulum_angle_deg:g}, above the top of '
               f'the ball: {math.remainder(start.pendulum_angle_deg, 360.0):g} is the same angle')
    if scene.actuation.law == 'position':
        yield from angle_warnings(math.degrees(scene.actuation.set_angle))


_WIDTH = 88


def report(summary: Summary) -> str:
    """Return a summary as aligned lines with units."""
    rows = list(_rows(summary))
    width = max(len(label) for label, _ in rows)
    lines = [f'{label:<{width}}  {value}'.rstrip() for label, value in rows]
    if summary.faces:
        lines += ['', table([('step edge at', 'height', 'contact at', 'with speed', 'passed'),
                             *map(_face_row, summary.faces)])]
    for warning in summary.warnings:
        lines += ['', *wrap(f'Warning: {warning}.', _WIDTH, subsequent_indent='         ')]
    return '\n'.join(lines)


def _rows(summary: Summary) -> Iterator[tuple[str, str]]:
    ended = '' if summary.complete else ', ended early'
    yield 'scene', f'{summary.name}, robot {summary.robot}'
    yield 'simulated', (f'{summary.duration:.6g} s, {summary.samples} samples, '
                        f'{summary.steps} steps{ended}')
    yield 'at the end', (f'x = {summary.x:.3f} m, y = {summary.y:.3f} m, '
                         f'{summary.speed:.3f} m/s')
    yield 'speed', f'{summary.lowest_speed:.3f} to {summary.highest_speed:.3f} m/s'
    yield 'largest normal force', (f'{summary.surface_normal_force:.0f} N on surfaces, '
                                   f'{summary.edge_normal_force:.0f} N on edges')
    yield 'largest penetration', f'{1e3 * summary.penetration:.2f} mm'
    if summary.pendulum_angle is not None and summary.pendulum_torque is not None:
        yield 'largest pendulum angle', f'{math.degrees(summary.pendulum_angle):.1f} deg'
        yield 'largest pendulum torque', f'{summary.pendulum_torque:.2f} N m'
    yield 'in flight', (f'{summary.flight_fraction:.1%} of the time, '
                        f'{summary.landings} landing{"s" * (summary.landings != 1)}')
    if summary.energy_residual is not None:
        yield 'energy balance error', (f'{summary.energy_residual:.1e}, relative to '
                                       f'{summary.energy_in_play:.3g} J')
    if summary.accuracy is not None and summary.error_estimate is not None:
        yield 'accuracy', (f'{summary.accuracy:g} m requested, error estimated at '
                           f'{summary.error_estimate:.1e} m up to {summary.horizon:.4g} s')
        yield 'effort', (f'{summary.evaluations} evaluations, {summary.events} events located, '
                         'in all runs')
    if summary.wall_time is not None and summary.real_time_factor is not None:
        yield 'run time', (f'{summary.wall_time:.3g} s, {summary.real_time_factor:.3g} times as '
                           'fast as real time')


def _face_row(face: FaceMeeting) -> tuple[str, ...]:
    place = f'{face.x:.3f} m', f'{1e3 * face.height:.1f} mm'
    if face.touch_time is None or face.touch_speed is None:
        return *place, '-', '-', 'not reached'
    return (*place, f'{face.touch_time:.3f} s', f'{face.touch_speed:.3f} m/s',
            'yes' if face.passed else 'no')
