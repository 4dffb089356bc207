# SPDX-License-Identifier: Apache-2.0
"""A scene as a source: a thread simulates it in real time, slower or faster."""
import math
from pathlib import Path
from threading import Lock
from time import monotonic
from types import MappingProxyType
from typing import Mapping, Optional, Tuple

from ballbot_ros.compile_notice import compiling
from ballbot_ros.config.files import shipped_files
from ballbot_ros.errors import ConfigurationError, SimulationError
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.physics.simulation.scene import load_scene
from ballbot_ros.physics.simulation.solver import LARGEST
from ballbot_ros.plant import Speedometer
from ballbot_ros.view.ground import step_ahead
from ballbot_ros.view.laws import bounds_of, laws_of, UNITS
from ballbot_ros.view.scene_run import SceneRun
from ballbot_ros.view.source import Control, Health, Idle, Source, Value

FRAME_RATE = 100.0  # frames per second of wall time, at most
LAG_MAX = 0.1  # a longer lag behind the wall clock is dropped, not caught up [s]
CONTROL_TIMEOUT = 10.0  # for a control to take effect [s]
LOCK_PAUSE, PAUSED_PERIOD = 1e-3, 0.02  # waits for controls between frames and while paused [s]
LOOP_PAUSE = 1.5  # wall time between the end of the scene and its repetition [s]
REST_SPEED, REST_TIME = 1e-3, 1.0  # at rest: slower than this [m/s], for this long [s]
TIME_SCALE_MIN, TIME_SCALE_MAX = 0.05, 4.0  # simulated seconds per second of wall time
HIGHEST_STEP, HIGHEST_FRICTION, LONGEST_STRIDE = 0.15, 1.2, 5.0  # [m], [1], [s]
DRIVE_SPEED = 0.5  # speed offered by the page for a robot at rest [m/s]


class SceneSource(Source):
    """
    Simulates a scene, by name or file, and keeps its frames; paused at first.

    The scene repeats after its duration until a control changes robot, ground, law or solver; then
    it continues indefinitely.  Controls act between two frames.  Raises `ConfigurationError` for a
    scene that cannot be read.
    """

    def __init__(self, name: str):
        super().__init__()
        self._name = self._first_name = name
        self._run = SceneRun(load_scene(name))
        self._robot_name = self._run.robot.name
        self._paused, self._speed = True, 1.0
        self._repeats = True
        self._moved_at = 0.0  # last time of motion [s]
        self._failure = ''
        self._speedometer = Speedometer()
        self._lock = Lock()
        self._resumed = True  # the wall time of the run counts from the present frame
        self._begin()

    # For the page; from any thread.

    @property
    def title(self) -> str:
        return f'Scene {Path(self._name).stem}'

    @property
    def robot(self) -> Robot:
        return self._run.robot

    @property
    def terrain(self) -> Terrain:
        return self._run.model.terrain

    @property
    def health(self) -> Health:
        run, notes = self._run, []
        if compiling():
            notes.append('Compiling for this machine, which takes some seconds the first time.')
        if run.accuracy_lost_at < math.inf:
            notes.append(f'The accuracy of {run.accuracy:g} m holds up to '
                         f't = {run.accuracy_lost_at:.2f} s '
                         'only: the motion is chaotic.')
        factor = self._speedometer.factor
        running = not self._paused
        return Health(running, factor if running and math.isfinite(factor) else None,
                      run.error_estimate, self._failure, tuple(notes), self._idle)

    @property
    def _idle(self) -> Optional[Idle]:
        run = self._run
        if self._paused or self._failure or run.state.time - self._moved_at < REST_TIME:
            return None
        if run.e_stop:
            return Idle('The e-stop is engaged.', 'Release the e-stop', (('e_stop', False),))
        if run.law.law == 'free':
            reason = 'The robot is at rest, and the law "free" gives no torque.'
        elif run.law.set_point == 0.0:
            reason = 'The robot is at rest, and the set-point is 0.'
        else:
            reason = 'The robot is at rest.'
        if not run.robot.has_pendulum:
            return Idle(f'{reason} This robot has no motor.', 'Reset', (('reset', True),))
        return Idle(reason, f'Drive at {DRIVE_SPEED:g} m/s',
                    (('law', 'speed'), ('set_point', DRIVE_SPEED)))

    @property
    def controls(self) -> Mapping[str, Control]:
        run = self._run
        ahead = step_ahead(run.model.terrain, run.state.x, run.robot.ball_radius)
        return {**self._controls, 'step_height': Control(
            ahead.height if ahead else 0.0, -HIGHEST_STEP, HIGHEST_STEP, 'm')}

    def _use(self, name: str, value: Value) -> None:
        if not self._lock.acquire(timeout=CONTROL_TIMEOUT):
            raise ConfigurationError(
                f'{name}: the simulation has not responded for {CONTROL_TIMEOUT:g} s; it is '
                'compiling, or the accuracy is too high for this machine', 'unavailable', name)
        try:
            # `SceneRun` implements the controls that do not concern this thread.
            use = getattr(self, f'_set_{name}', None) or getattr(self._run, f'set_{name}')
            use(value)
            if name in ('robot', 'law', 'set_point', 'step_height', 'friction', 'accuracy',
                        'e_stop'):
                self._repeats = False
            self._describe()
            self._resumed = True
        finally:
            self._lock.release()

    def _live(self) -> None:
        """Simulate in real time; the lock is free between frames."""
        origin = begin = wait = 0.0
        while not self._ending.wait(max(wait, LOCK_PAUSE)):
            with self._lock:
                now, time = monotonic(), self._run.state.time
                due = origin + (time - begin) / self._speed
                ended = self._repeats and time >= self._run.scene.run.duration
                if self._resumed or self._paused or due < now - LAG_MAX and not ended:
                    origin, begin, due, self._resumed = now, time, now, False
                if self._paused or ended:
                    wait = PAUSED_PERIOD
                    if ended and now > due + LOOP_PAUSE:
                        self._set_reset(True)
                        self._resumed = True
                else:
                    self._simulate(max(1, round(self._speed / FRAME_RATE / self._run.period)))
                    self._speedometer.note(self._run.state.time, monotonic())
                    wait = origin + (self._run.state.time - begin) / self._speed - monotonic()

    def _simulate(self, periods: int) -> None:
        """Simulate a frame; a run that cannot continue is paused."""
        try:
            self._run.advance(periods)
        except SimulationError as error:
            self._failure, self._paused = f'{error}; press reset', True
            self._describe()
            return
        state = self._run.state
        if math.hypot(state.velocity_x, state.velocity_y) > REST_SPEED:
            self._moved_at = state.time
        self.history.add(self._run.frame())

    def _begin(self) -> None:
        """Show the start of the scene, whose time 0 starts a new epoch."""
        self._failure, self._sought = '', None
        self._moved_at = self._run.state.time
        self.history.add(self._run.frame())
        self._describe()

    def _set_pause(self, value: bool) -> None:
        if not value and self._failure:
            raise ConfigurationError(self._failure, 'unavailable', 'pause')
        self._paused = value
        if not value:
            self._sought = None
            self._speedometer = Speedometer()

    def _set_step(self, seconds: float) -> None:
        if not self._paused:
            raise ConfigurationError(
                'step advances a paused run; pause it first', 'unavailable', 'step')
        self._sought = None
        for _ in range(max(1, round(seconds / self._run.period))):
            self._simulate(1)
            if self._failure:
                break

    def _set_reset(self, _: bool) -> None:
        self._run.reset()
        self._begin()

    def _set_speed(self, value: float) -> None:
        self._speed = value
        self._speedometer = Speedometer()

    def _set_seek(self, value: float) -> None:
        self._paused, self._sought = True, value

    def _set_scene(self, name: str) -> None:
        run = SceneRun(load_scene(name))
        run.e_stop = self._run.e_stop
        self._run, self._name, self._robot_name = run, name, run.robot.name
        self._repeats = True
        self._begin()

    def _set_robot(self, name: str) -> None:
        self._run.set_robot(name)
        self._robot_name = name
        self._begin()

    def _set_set_point(self, value: float) -> None:
        self._run.set_law(set_point=value)

    def _set_e_stop(self, value: bool) -> None:
        self._run.e_stop = value
        self._run.law.begin(self._run.state)

    def _describe(self) -> None:
        run, law = self._run, self._run.law.law
        self.curve = run.curve()
        self._controls: Mapping[str, Control] = MappingProxyType({
            'pause': Control(self._paused),
            'step': Control(lowest=run.period, highest=LONGEST_STRIDE, unit='s'),
            'reset': Control(),
            'speed': Control(self._speed, TIME_SCALE_MIN, TIME_SCALE_MAX),
            'seek': Control(lowest=self.history.span[0], unit='s'),
            'scene': Control(self._name, choices=_names('scenes', self._first_name)),
            'robot': Control(self._robot_name, choices=_names('robots', self._robot_name)),
            'law': Control(law, choices=laws_of(run.robot)),
            'set_point': Control(refusal='a free pendulum has no set-point; choose another law')
            if law == 'free' else Control(
                run.law.set_point, *bounds_of(run.robot, law), unit=UNITS[law]),
            'friction': Control(run.robot.surface_friction, 0.0, HIGHEST_FRICTION),
            'accuracy': Control(run.accuracy or 0.0, 0.0, LARGEST, 'm'),
            'e_stop': Control(run.e_stop)})


def _names(kind: str, own: str) -> Tuple[str, ...]:
    """Return the user's file, if any, then the names of the shipped files."""
    shipped = tuple(file.stem for file in shipped_files(kind))
    return shipped if own in shipped else (own, *shipped)
