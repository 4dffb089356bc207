# SPDX-License-Identifier: Apache-2.0
"""A bag as a source; no ROS installation is needed."""
from dataclasses import replace
from pathlib import Path
from threading import Lock
from time import monotonic
from types import MappingProxyType
from typing import Callable, Mapping, Optional

from ballbot_ros.bags.metadata import BagMetadata
from ballbot_ros.bags.opener import custom_data, open_bag
from ballbot_ros.bags.recorded_run import robot_namespace, STATE_TYPES
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.view.assembly import MessageSource, TOPICS
from ballbot_ros.view.frame import Frame
from ballbot_ros.view.source import Control, FRAMES_MAX, Health

FRAME_RATE = 100.0  # frames per second, at most: bags have up to 500 states per second
PLAYBACK_RATE_MIN, PLAYBACK_RATE_MAX = 0.05, 20.0  # seconds played per second


class Playback:
    """
    A playback time that advances at a set speed, from a start to an end that may grow.

    The time is computed at each query, not by a thread.  The class is thread-safe.  `span` returns
    start and end [s], and `clock` the wall time [s].
    """

    def __init__(self, span: Callable[[], tuple[float, float]],
                 clock: Callable[[], float] = monotonic):
        self._span, self._clock = span, clock
        self._lock = Lock()
        self._from, self._since = span()[0], clock()
        self.speed, self._paused = 1.0, False  # seconds played per second of the clock

    @property
    def place(self) -> float:
        """Return the time to show [s]."""
        with self._lock:
            return self._place()

    @property
    def paused(self) -> bool:
        with self._lock:
            return self._paused or self._place() >= self._span()[1]

    def pause(self, paused: bool) -> None:
        """Pause or play; at the end, play from the start again."""
        with self._lock:
            place, (start, end) = self._place(), self._span()
            self._move_to(start if not paused and place >= end else place)
            self._paused = paused

    def seek(self, place: float) -> None:
        """Pause at a time [s]."""
        with self._lock:
            self._move_to(place)
            self._paused = True

    def restart(self) -> None:
        """Return to the start; keep playing or paused."""
        with self._lock:
            self._move_to(self._span()[0])

    def set_speed(self, speed: float) -> None:
        with self._lock:
            self._move_to(self._place())
            self.speed = speed

    def _place(self) -> float:
        start, end = self._span()
        elapsed = 0.0 if self._paused else self.speed * (self._clock() - self._since)
        return min(max(self._from + elapsed, start), end)

    def _move_to(self, place: float) -> None:
        self._from, self._since = place, self._clock()


class BagSource(MessageSource):
    """
    Plays the frames of a bag: a folder, or a file ending in .mcap.

    A thread reads the bag; the part already read can be shown.  The robot defaults to that of the
    bag; `namespace` selects one of several.  Raises `ConfigurationError` for a bag that cannot be
    read, and as `robot_namespace` does.
    """

    def __init__(self, path: Path, namespace: str = '', robot: str = '', paused: bool = False):
        # The demo creates a folder with a bag for each scene.
        self._path = path / 'bag' if (path / 'bag' / 'metadata.yaml').is_file() else path
        with open_bag(self._path) as bag:
            where = robot_namespace(path, bag, namespace or None, tuple(STATE_TYPES))
            true_state = f'{where}/ball_state' in bag.topics
            self._topics = [f'{where}/{name}' for name in TOPICS
                            if not (name == 'joint_states' and true_state)]
            texts = bag.metadata
        if self._path.is_file():
            try:
                texts = custom_data(self._path.parent)
            except ConfigurationError:
                pass  # of another bag, perhaps; this metadata is optional
        made = BagMetadata.read(texts)
        super().__init__({**made.decision, **made.parameters}, robot)
        self._playback = Playback(lambda: self.history.span)
        self._playback.pause(paused)
        self._reading, self._failure = True, ''

    @property
    def title(self) -> str:
        path = self._path.resolve()
        return f'Bag {path.parent.name}/{path.name}'

    @property
    def shown(self) -> Optional[Frame]:
        return self.history.at(self._playback.place)

    @property
    def health(self) -> Health:
        reading = ('Reading the bag.',) if self._reading else ()
        runs = self.history.epoch + 1
        last = () if runs == 1 else (
            f'This bag contains {runs} runs, because time restarts, as after ~/reset: '
            'this is the last one.',)
        playing = not self._playback.paused
        return Health(playing, self._playback.speed if playing else None,
                      failure=self._failure, notes=(*self._notes, *last, *reading))

    @property
    def controls(self) -> Mapping[str, Control]:
        begin, end = self.history.span
        return MappingProxyType({
            'pause': Control(self._playback.paused),
            'step': Control(None, 1e-3, 10.0, 's'),
            'reset': Control(None),
            'speed': Control(self._playback.speed, PLAYBACK_RATE_MIN, PLAYBACK_RATE_MAX),
            'seek': Control(self._playback.place, begin, end, 's')})

    def _set_pause(self, paused: bool) -> None:
        self._playback.pause(paused)

    def _set_step(self, seconds: float) -> None:
        self._playback.seek(self._playback.place + seconds)

    def _set_reset(self, _: bool) -> None:
        self._playback.restart()

    def _set_speed(self, speed: float) -> None:
        self._playback.set_speed(speed)

    def _set_seek(self, time: float) -> None:
        self._playback.seek(time)

    def _live(self) -> None:
        """Create frames from all messages, thinned evenly to fit the history; time starts at 0."""
        origin: Optional[float] = None
        newest, spacing = 0.0, 1.0 / FRAME_RATE
        try:
            with open_bag(self._path) as bag:
                for topic, message in bag.messages(self._topics):
                    if self._ending.is_set():
                        return
                    frame = self._assembly.take(topic.rsplit('/', 1)[-1], message)
                    if frame is None:
                        continue
                    if origin is None:
                        origin = frame.time
                    time = frame.time - origin
                    if time < newest:  # a reset during the recording
                        self._assembly.restart()
                    elif self.history.newest and time - newest < 0.9 * spacing:
                        continue
                    newest = time
                    self.history.add(replace(frame, time=time))
                    if len(self.history) >= FRAMES_MAX:
                        self.history.thin()
                        spacing *= 2.0
        except ConfigurationError as error:
            self._failure = str(error)
        self._reading = False
