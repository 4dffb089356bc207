# SPDX-License-Identifier: Apache-2.0
"""A scene as something to look at: it runs in a thread of its own, by the clock on the wall."""
from concurrent.futures import Future, TimeoutError as TooLong
from dataclasses import replace
import math
from pathlib import Path
from queue import Empty, Queue
from threading import Thread
from time import monotonic
from types import MappingProxyType
from typing import Callable, Mapping, Optional, Sequence, Tuple

from ballbot_ros.decision.planning.curve import HeightCurve
from ballbot_ros.errors import BallbotError, ConfigurationError, SimulationError
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.physics.simulation.scene import load_scene
from ballbot_ros.plant import Speedometer
from ballbot_ros.view.frame import Frame
from ballbot_ros.view.frame_history import FrameHistory
from ballbot_ros.view.ground import step_ahead
from ballbot_ros.view.scene_controls import controls_of, FileChoice
from ballbot_ros.view.scene_run import SceneRun
from ballbot_ros.view.source import checked, Control, Health, Value

FRAME_RATE = 100.0  # frames per second on the wall, at most
LATE = 0.1  # behind by more, time is given up instead of caught up [s]
PATIENCE = 10.0  # for a change to be made [s]


class SceneSource:
    """
    Runs a scene and keeps its frames.

    Controls act between two frames, in the thread that simulates; whoever uses one waits for that
    thread only, never the other way round.

    Parameters
    ----------
    name : str
        Of a scene, or its file.
    paused : bool
        Whether to wait for ``pause`` to be lifted before time goes on.

    Raises
    ------
    ConfigurationError
        For a scene that cannot be read.

    """

    def __init__(self, name: str, paused: bool = False):
        """Read the scene and stand at its start."""
        self._name = self._first_name = name
        self._run = SceneRun(load_scene(name))
        self._robot_name = self._run.robot.name
        self._history = FrameHistory()
        self._paused, self._speed = paused, 1.0
        self._sought: Optional[float] = None
        self._failure = ''
        self._speedometer = Speedometer()
        self._jobs: 'Queue[Optional[Tuple[Callable[[], None], Future[None]]]]' = Queue()
        self._thread: Optional[Thread] = None
        self._closed = False
        self._begin()

    # What the page asks; from any thread.

    @property
    def title(self) -> str:
        """Return which scene this is."""
        return f'Scene {Path(self._name).stem}'

    @property
    def robot(self) -> Robot:
        """Return the robot."""
        return self._run.robot

    @property
    def terrain(self) -> Terrain:
        """Return the ground."""
        return self._run.model.terrain

    @property
    def curve(self) -> Optional[HeightCurve]:
        """Return the height curve for robot and law."""
        return self._curve

    @property
    def epoch(self) -> int:
        """Return how often all began again."""
        return self._history.epoch

    @property
    def shown(self) -> Optional[Frame]:
        """Return the frame to look at."""
        return self._history.newest if self._sought is None else self._history.at(self._sought)

    @property
    def span(self) -> Tuple[float, float]:
        """Return the times that can be looked at [s]."""
        return self._history.span

    @property
    def health(self) -> Health:
        """Return how the run is doing."""
        run, notes = self._run, []
        if run.lost_at < math.inf:
            notes.append(f'The accuracy of {run.accuracy:g} m holds up to t = {run.lost_at:.2f} s '
                         'only: the motion is chaotic.')
        factor = self._speedometer.factor
        running = not self._paused
        return Health(running, factor if running and math.isfinite(factor) else None,
                      run.error_estimate, self._failure, tuple(notes))

    @property
    def controls(self) -> Mapping[str, Control]:
        """Return what can be set, and how it stands."""
        run, known = self._run, dict(self._controls)
        ahead = step_ahead(run.model.terrain, run.state.x, run.robot.ball_radius)
        known['step_height'] = replace(
            known['step_height'], value=ahead.height if ahead else 0.0)
        return known

    def history(self, since: float) -> Sequence[Frame]:
        """Return the frames later than a time [s]."""
        return self._history.since(since)

    def apply(self, name: str, value: Value) -> None:
        """
        Use a control.

        Raises
        ------
        ConfigurationError
            With nothing changed.

        """
        value = checked(self._controls, name, value)
        if self._thread is None or self._closed:
            self._do(name, value)
            return
        done: 'Future[None]' = Future()
        self._jobs.put((lambda: self._do(name, value), done))
        try:
            done.result(PATIENCE)
        except TooLong:
            raise ConfigurationError(
                f'{name}: the simulation has not answered for {PATIENCE:g} s; it is compiling, or '
                'the accuracy is too high for this machine') from None

    def start(self) -> None:
        """Let the thread run."""
        self._thread = Thread(target=self._live, name='scene', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._closed = True
        if self._thread is not None:
            self._jobs.put(None)
            self._thread.join(PATIENCE)

    # What the thread does.

    def _live(self) -> None:
        """Simulate by the clock on the wall, and do what is asked for in between."""
        origin, begin = monotonic(), self._run.state.time
        while not self._closed:
            ahead = origin + (self._run.state.time - begin) / self._speed - monotonic()
            if self._paused or ahead > 0.0:
                if self._await_job(0.1 if self._paused else ahead) or self._paused:
                    origin, begin = monotonic(), self._run.state.time
                continue
            if ahead < -LATE:
                origin, begin = monotonic(), self._run.state.time
            if self._await_job(0.0):
                origin, begin = monotonic(), self._run.state.time
                continue
            self._go_on(self._periods())
            self._speedometer.note(self._run.state.time, monotonic())

    def _await_job(self, patience: float) -> bool:
        """Do what is asked for within a time [s]; return whether something was."""
        try:
            job = self._jobs.get(timeout=patience) if patience > 0.0 else self._jobs.get_nowait()
        except Empty:
            return False
        if job is not None:
            act, done = job
            try:
                act()
                done.set_result(None)
            except BallbotError as error:
                done.set_exception(error)
        return True

    def _periods(self) -> int:
        """Return how many periods make a frame at the present speed."""
        return max(1, round(self._speed / FRAME_RATE / self._run.period))

    def _go_on(self, periods: int) -> None:
        """Simulate a frame; a run that cannot go on is paused."""
        try:
            self._run.advance(periods)
        except SimulationError as error:
            self._failure, self._paused = f'{error}; press reset', True
            self._describe()
            return
        self._history.add(self._run.frame())

    def _do(self, name: str, value: Value) -> None:
        """Use a control, whose value has been checked."""
        getattr(self, f'_set_{name}')(value)
        self._describe()

    def _begin(self) -> None:
        """Stand at the start, with no frame but the first."""
        self._history.forget()
        self._failure, self._sought = '', None
        self._history.add(self._run.frame())
        self._describe()

    def _set_pause(self, value: bool) -> None:
        if not value and self._failure:
            raise ConfigurationError(self._failure)
        self._paused = value
        if not value:
            self._sought = None
            self._speedometer = Speedometer()

    def _set_step(self, seconds: float) -> None:
        if not self._paused:
            raise ConfigurationError('step goes on by one moment of a paused run; pause it first')
        self._sought = None
        for _ in range(max(1, round(seconds / self._run.period))):
            self._go_on(1)
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
        self._begin()

    def _set_robot(self, name: str) -> None:
        self._run.set_robot(name)
        self._robot_name = name
        self._begin()

    def _set_law(self, name: str) -> None:
        self._run.set_law(law=name)

    def _set_set_point(self, value: float) -> None:
        self._run.set_law(set_point=value)

    def _set_step_height(self, value: float) -> None:
        self._run.set_step_height(value)

    def _set_friction(self, value: float) -> None:
        self._run.set_friction(value)

    def _set_accuracy(self, value: float) -> None:
        self._run.set_accuracy(value)

    def _set_e_stop(self, value: bool) -> None:
        self._run.e_stop = value
        self._run.law.begin(self._run.state)

    def _describe(self) -> None:
        """Note what can be set now, and the curve that goes with it."""
        self._curve = self._run.curve()
        self._controls: Mapping[str, Control] = MappingProxyType(controls_of(
            self._run, self._paused, self._speed, self._history.span[0],
            FileChoice(self._name, self._first_name),
            FileChoice(self._robot_name, self._robot_name)))
