# SPDX-License-Identifier: Apache-2.0
"""A recorded run as something to look at; needs no ROS installation."""
from dataclasses import replace
from pathlib import Path
from threading import Event, Thread
from types import MappingProxyType
from typing import Mapping, Optional, Sequence, Tuple

from ballbot_ros.decision.planning.curve import HeightCurve
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.view.assembly import FrameAssembly
from ballbot_ros.view.bag_reading import BagReading
from ballbot_ros.view.frame import Frame
from ballbot_ros.view.frame_history import FrameHistory, MOST
from ballbot_ros.view.playback import Playback
from ballbot_ros.view.robot_named import scene_named
from ballbot_ros.view.source import checked, Control, Health, Value

# Frames a second at most: what states the robot comes up to 500 times a second.
RATE = 100.0
SLOWEST, FASTEST = 0.05, 20.0  # playback


class BagSource:
    """
    Plays the frames of a bag.

    A thread reads the bag; what has been read can be looked at already.

    Parameters
    ----------
    path : Path
        Folder of a bag, or a file ending in .mcap.
    namespace : str
        Of the robot, where the bag has several.
    robot : str
        Name or file of the robot; empty for what the bag says.
    paused : bool
        Whether to wait for ``pause`` to be lifted.

    Raises
    ------
    ConfigurationError
        For what is no bag of a robot, and for a bag of several where none is named.

    """

    def __init__(self, path: Path, namespace: str = '', robot: str = '', paused: bool = False):
        """Open the bag."""
        self._bag = BagReading(path, namespace)
        said = scene_named(self._bag.parameters, robot)
        self._notes = said.notes
        self._assembly = FrameAssembly(said.robot, said.terrain)
        self._curve = said.curve
        self._history = FrameHistory()
        self._playback = Playback(lambda: self._history.span)
        self._playback.pause(paused)
        self._thread: Optional[Thread] = None
        self._ending = Event()
        self._done, self._failure = 0.0, ''

    @property
    def title(self) -> str:
        """Return which bag this is."""
        path = self._bag.path.resolve()
        return f'Bag {path.parent.name}/{path.name}'

    @property
    def robot(self) -> Robot:
        """Return the robot."""
        return self._assembly.robot

    @property
    def terrain(self) -> Optional[Terrain]:
        """Return the ground, as the bag or its sensors say."""
        return self._assembly.terrain

    @property
    def curve(self) -> Optional[HeightCurve]:
        """Return the curve of this robot, None where none comes with the package."""
        return self._curve

    @property
    def epoch(self) -> int:
        """Return how often time began again in the bag."""
        return self._history.epoch

    @property
    def shown(self) -> Optional[Frame]:
        """Return the frame at the place of the playback."""
        return self._history.at(self._playback.place)

    @property
    def span(self) -> Tuple[float, float]:
        """Return first and last time read so far [s]."""
        return self._history.span

    @property
    def health(self) -> Health:
        """Return whether it plays, and how far the bag has been read."""
        reading = () if self._done >= 1.0 or self._failure else (
            f'Reading the bag: {100.0 * self._done:.0f} %.',)
        runs = self._history.epoch + 1
        last = () if runs == 1 else (
            f'Time begins {runs} times in this bag, as after ~/reset: this is the last run.',)
        playing = not self._playback.paused
        return Health(playing, self._playback.speed if playing else None,
                      failure=self._failure, notes=(*self._notes, *last, *reading))

    @property
    def controls(self) -> Mapping[str, Control]:
        """Return pause, step, reset, speed and seek."""
        begin, end = self._history.span
        return MappingProxyType({
            'pause': Control(self._playback.paused),
            'step': Control(None, 1e-3, 10.0, 's'),
            'reset': Control(None),
            'speed': Control(self._playback.speed, SLOWEST, FASTEST),
            'seek': Control(self._playback.place, begin, end, 's')})

    def history(self, since: float) -> Sequence[Frame]:
        """Return the frames read so far that are later than a time [s]."""
        return self._history.since(since)

    def apply(self, name: str, value: Value) -> None:
        """
        Use a control.

        Raises
        ------
        ConfigurationError
            With nothing changed.

        """
        value = checked(self.controls, name, value)
        if name == 'pause':
            self._playback.pause(bool(value))
        elif name == 'step':
            self._playback.seek(self._playback.place + float(value))
        elif name == 'reset':
            self._playback.restart()
        elif name == 'speed':
            self._playback.set_speed(float(value))
        else:
            self._playback.seek(float(value))

    def start(self) -> None:
        """Read, and play from the begin."""
        self._thread = Thread(target=self._read, name='bag', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the reading."""
        self._ending.set()
        if self._thread is not None:
            self._thread.join(10.0)

    def _read(self) -> None:
        """Make frames of all messages, not more than the history keeps; time begins at 0."""
        origin: Optional[float] = None
        newest = 0.0
        try:
            for topic, message, self._done in self._bag.messages(1.0 / RATE, int(0.9 * MOST)):
                if self._ending.is_set():
                    return
                frame = self._assembly.take(topic, message)
                if frame is None:
                    continue
                if origin is None:
                    origin = frame.time
                time = frame.time - origin
                if time < newest:  # a reset, while it was recorded
                    self._assembly.restart()
                newest = time
                self._history.add(replace(frame, time=time))
        except ConfigurationError as error:
            self._failure = str(error)
        self._done = 1.0
