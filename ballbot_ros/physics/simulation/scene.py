# SPDX-License-Identifier: Apache-2.0
"""Scenes and their files: robot, terrain, initial state, actuation and duration."""
from dataclasses import dataclass, replace
import math
from pathlib import Path
from typing import Any, Callable, Mapping, Optional, Type, Union

from ballbot_ros.config.fields import (
    build, check_value, Checked, expect_mapping, given_values, Problems, quantity, refuse_missing,
    section, T, text)
from ballbot_ros.config.files import read_config
from ballbot_ros.errors import ConfigurationError, SimulationError
from ballbot_ros.physics.model.actuation import Actuation, set_rate_for_speed, SET_VALUES
from ballbot_ros.physics.model.robot import ContactOptions, load_robot, Robot
from ballbot_ros.physics.model.state import State
from ballbot_ros.physics.model.terrain import read_terrain, Terrain
from ballbot_ros.physics.simulation.model import Model
from ballbot_ros.physics.simulation.run import simulate
from ballbot_ros.physics.simulation.solver import ACCURACY, LARGEST, PRESETS, SMALLEST, Solver
from ballbot_ros.physics.simulation.trajectory import Trajectory


@dataclass(frozen=True)
class Initial(Checked):
    """Initial state of a scene: by default on the ground and rolling without slip."""

    x: float = quantity('m', 'x of the ball centre', default=0.0)
    speed: float = quantity('m/s', 'speed of the centre along the ground', default=0.0)
    pendulum_angle_deg: float = quantity('deg', 'absolute pendulum angle', default=0.0)
    pendulum_rate: float = quantity('rad/s', 'absolute pendulum rate', default=0.0)
    y: Optional[float] = quantity('m', 'height of the ball centre', optional=True)
    velocity_x: Optional[float] = quantity(
        'm/s', 'velocity to the right, instead of that of speed', optional=True)
    velocity_y: Optional[float] = quantity(
        'm/s', 'velocity upwards, instead of that of speed', optional=True)
    ball_rate: Optional[float] = quantity(
        'rad/s', 'ball rate, negative for rolling forward, instead of that of speed',
        optional=True)

    def state(self, model: Model) -> State:
        """Return the initial state for a model."""
        angle = math.radians(self.pendulum_angle_deg)
        if self.y is None:
            start = model.at_rest(self.x, self.speed, angle)
        else:
            start = State(x=self.x, y=self.y, pendulum_angle=angle, velocity_x=self.speed,
                          ball_rate=-self.speed / model.robot.ball_radius)
        given = {name: getattr(self, name) for name in ('velocity_x', 'velocity_y', 'ball_rate')
                 if getattr(self, name) is not None}
        return start._replace(pendulum_rate=self.pendulum_rate, **given)


@dataclass(frozen=True)
class Run(Checked):
    """Duration, sampling and accuracy of a scene."""

    duration: float = quantity('s', 'simulated time', above=0.0, maximum=86400.0)
    output_step: float = quantity('s', 'time between samples', default=1e-3, above=0.0)
    accuracy: Optional[float] = quantity(
        'm', f'largest position error; {ACCURACY:g} if neither this nor a solver is given',
        minimum=SMALLEST, maximum=LARGEST, optional=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.output_step > self.duration:
            raise ConfigurationError(
                f'Run: output_step must be at most the duration of {self.duration:g} s, got '
                f'{self.output_step:g}', 'inconsistent', 'output_step')


@dataclass(frozen=True, kw_only=True)
class SceneFile(Run):
    """The keys of a scene file."""

    robot: str = text('name or file of a robot')
    robot_changes: Any = section('parameters of the robot to replace, by name', default=None)
    terrain: Any = section(
        'pieces of ground from left to right, or its vertices; level if not given', default=None)
    initial: Any = section('initial state', default=None)
    actuation: Any = section('control of the motor', default=None)
    solver: Any = section(
        'the integrator, in place of an accuracy; or the name paper, for that of the paper',
        default=None)
    contact: Any = section('options of the contact law', default=None)


@dataclass(frozen=True, repr=False)
class Scene:
    """
    Everything that a simulation needs.

    Attributes
    ----------
    name : str
    model : Model
        Robot, terrain, contact law and solver.
    initial : Initial
    actuation : Actuation
    run : Run

    """

    name: str
    model: Model
    initial: Initial
    actuation: Actuation
    run: Run

    @property
    def start(self) -> State:
        """Return the state that the scene starts from."""
        return self.initial.state(self.model)

    def simulate(self, duration: Optional[float] = None, *, accuracy: Optional[float] = None,
                 output_step: Optional[float] = None,
                 progress: Optional[Callable[[float], None]] = None) -> Trajectory:
        """
        Run the scene.

        Parameters
        ----------
        duration, accuracy, output_step : float, optional
            Replace those of the scene; see `Run` and `run.simulate`.
        progress : callable, optional
            Called with the simulated time since the start [s].

        Raises
        ------
        SimulationError
            If the run fails; its attribute ``trajectory`` holds the part before the failure.
        ConfigurationError
            If a value is out of range, or steps and durations are inconsistent.

        """
        given = {'duration': duration, 'accuracy': accuracy, 'output_step': output_step}
        run = replace(self.run, **{
            name: value for name, value in given.items() if value is not None})
        scene = replace(self, run=run)
        try:
            trajectory = simulate(self.model, self.start, self.actuation, run.duration,
                                  run.output_step, accuracy=run.accuracy, progress=progress)
        except SimulationError as error:
            if error.trajectory is not None:
                error.trajectory = replace(error.trajectory, scene=scene)
            raise
        return replace(trajectory, scene=scene)

    def __repr__(self) -> str:
        """Return its name and main properties, without all parameters."""
        return (f'Scene({self.name!r}, {self.model.robot!r}, {self.actuation!r}, '
                f'{self.run.duration:g} s)')


# Keys of scene files in place of fields of `Actuation`, in other units: the declaration of a key,
# that field, and its value for a robot.
HUMAN: dict[str, tuple[Any, str, Callable[[Robot, float], float]]] = {
    'set_angle_deg': (quantity('deg', 'reference of the pendulum angle, in place of set_angle'),
                      'set_angle', lambda _, degrees: math.radians(degrees)),
    'set_speed': (quantity('m/s', 'speed at which the ball rolls, in place of set_rate'),
                  'set_rate', set_rate_for_speed)}


def load_scene(name_or_path: Union[str, Path, Scene],
               robot: Union[str, Path, Robot, None] = None,
               solver: Optional[Solver] = None) -> Scene:
    """
    Read a scene of the package by name, or a custom file.

    Parameters
    ----------
    name_or_path : str or Path
        A `Scene` is returned unchanged.
    robot : str, Path or Robot, optional
        Replaces the robot of the scene: name, file, or the robot itself.
    solver : Solver, optional
        Replaces the solver, or the accuracy, of the scene.

    Raises
    ------
    ConfigurationError
        Naming file, section, field, value and allowed range.

    """
    if isinstance(name_or_path, Scene):
        scene = name_or_path
        if robot is not None:
            scene = replace(scene, model=replace(scene.model, robot=load_robot(robot)))
    else:
        path, content = read_config('scenes', name_or_path)
        if robot is not None:
            content = {**content, 'robot': robot}
        scene = read_scene(content, str(path), Path(path).stem)
    if solver is None:
        return scene
    return replace(scene, model=replace(scene.model, solver=solver),
                   run=replace(scene.run, accuracy=None))


def read_scene(content: Mapping[str, Any], where: str, name: str) -> Scene:
    """
    Return the scene that a mapping describes, as in the files of ``config/scenes``.

    `where` is the location for error messages.
    """
    problems = Problems()
    with problems.collected():
        refuse_missing([(SceneFile, content, where)])
    terrain, contact = Terrain.flat(), ContactOptions()
    solver: Optional[Solver] = None
    initial, actuation = Initial(), Actuation()
    robot: Optional[Robot] = None
    if 'robot' in content:
        with problems.collected():
            robot = _read_robot(content, where)
    with problems.collected():
        if 'terrain' in content:
            terrain = read_terrain(content['terrain'], f'{where}: terrain')
    with problems.collected():
        contact = _section(ContactOptions, content, 'contact', where)
    with problems.collected():
        solver = _read_solver(content, f'{where}: solver')
    with problems.collected():
        initial = _section(Initial, content, 'initial', where)
    with problems.collected():
        timing = given_values(Run, content, where)
    if robot is not None:
        with problems.collected():
            actuation = _read_actuation(
                content.get('actuation', {}), robot, f'{where}: actuation')
    problems.refuse()
    assert robot is not None  # else refused
    return Scene(name, Model(robot, terrain, contact, solver), initial, actuation,
                 build(Run, timing, where))


def _read_robot(content: Mapping[str, Any], where: str) -> Robot:
    if not isinstance(content['robot'], (str, Path, Robot)):
        raise ConfigurationError(
            f'{where}: robot must be the name or the file of a robot, got {content["robot"]!r}',
            'wrong_type', 'robot')
    try:
        robot = load_robot(content['robot'])
    except ConfigurationError as error:
        raise error.at(f'{where}: robot') from error
    place = f'{where}: robot_changes'
    changes = content.get('robot_changes') or {}
    return robot.replace(place, **expect_mapping(changes, place)) if changes else robot


def _read_solver(content: Mapping[str, Any], where: str) -> Optional[Solver]:
    """Return the solver of a scene, by name or by fields; None if it has none."""
    if 'solver' not in content:
        return None
    section = content['solver']
    if content.get('accuracy') is not None:
        raise ConfigurationError(
            f'{where}: has no effect with an accuracy ({content["accuracy"]} m), which selects '
            'the solver; leave out one of them', 'inconsistent', 'solver')
    if not isinstance(section, str):
        return Solver.from_mapping(section, where)
    if section not in PRESETS:
        raise ConfigurationError(
            f'{where}: must be one of {", ".join(PRESETS)}, or a mapping, got {section!r}',
            'not_a_choice', 'solver')
    return PRESETS[section]


def _section(cls: Type[T], content: Mapping[str, Any], key: str, where: str) -> T:
    return cls.from_mapping(content.get(key, {}), f'{where}: {key}')


def _read_actuation(section: Any, robot: Robot, where: str) -> Actuation:
    """Return the actuation, with its angle in degrees and its speed in m/s converted."""
    entries = dict(expect_mapping(section, where))
    if 'set_angle' in entries:
        raise ConfigurationError(
            f'{where}: set_angle is not accepted here; give set_angle_deg', 'unknown_name',
            'set_angle')
    for name, (declared, target, convert) in HUMAN.items():
        if name not in entries:
            continue
        if target in entries:
            raise ConfigurationError(
                f'{where}: give either {name} or {target}, not both', 'inconsistent', name)
        entries[target] = convert(
            robot, check_value(name, entries.pop(name), declared.metadata, where))
    for name, law in SET_VALUES.items():
        if name in entries and entries.get('law', 'free') != law:
            raise ConfigurationError(
                f'{where}: {name} belongs to law {law}, and the law here is '
                f'{entries.get("law", "free")}, which would ignore it; write law: {law}',
                'inconsistent', name)
    actuation = Actuation.from_mapping(entries, where)
    try:
        actuation.actuator(robot)  # refuses an unsupported one before the run
    except ConfigurationError as error:
        raise error.at(where) from None
    return actuation
