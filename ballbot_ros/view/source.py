# SPDX-License-Identifier: Apache-2.0
"""
The source of a page: a scene that is simulated, running nodes, or a bag.

The page reads a source at its own rate, from its own threads; a source runs at its own rate and
returns its latest data without waiting.
"""
from abc import ABC, abstractmethod
from bisect import bisect_right
from dataclasses import dataclass
import math
from threading import Event, Lock, Thread
from types import MappingProxyType
from typing import Any, List, Mapping, NamedTuple, Optional, Sequence, Tuple, Union

from ballbot_ros.config.fields import check_value, suggestion
from ballbot_ros.decision.planning.curve import HeightCurve
from ballbot_ros.errors import BallbotError, ConfigurationError
from ballbot_ros.floors.floor import Floor
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.view.frame import Frame

Value = Union[bool, float, str, Tuple[float, float]]

# Every control that a source may have: the type of its value, and its effect.
CONTROLS: Mapping[str, Tuple[type, str]] = MappingProxyType({
    'pause': (bool, 'pause; false resumes at the latest time'),
    'step': (float, 'advance by a time while paused [s]'),
    'reset': (bool, 'start again'),
    'speed': (float, 'simulated seconds per second of wall time'),
    'seek': (float, 'show an earlier time [s]'),
    'scene': (str, 'another scene'),
    'robot': (str, 'another robot'),
    'law': (str, 'control law of the motor'),
    'set_point': (float, 'set-point of the law, in its unit'),
    'yaw_rate': (float, 'yaw rate, within the limit for the speed [rad/s]'),
    'step_height': (float, 'height of the next step ahead [m]'),
    'friction': (float, 'coefficient between ball and ground'),
    'accuracy': (float, 'largest error of position [m]; 0 for the solver of the scene'),
    'e_stop': (bool, 'engage the e-stop; false releases it'),
    'goal': (tuple, 'drive to a position on the floor [m]'),
})


@dataclass(frozen=True)
class Control:
    """A value that can be set, with its range."""

    value: Optional[Value] = None  # in force; None where there is none or it is unknown
    lowest: Optional[float] = None  # range of a number
    highest: Optional[float] = None
    unit: str = ''
    choices: Tuple[str, ...] = ()  # of a text
    refusal: str = ''  # reason against its use at present, and the remedy; empty if it can be used


class Idle(NamedTuple):
    """The reason for rest, and the controls that start a motion, with a label for them."""

    reason: str
    label: str
    remedy: Tuple[Tuple[str, Value], ...]


@dataclass(frozen=True)
class Health:
    """State of a source."""

    running: bool  # whether time advances
    real_time_factor: Optional[float] = None  # measured simulated seconds per second of wall time
    error_estimate: Optional[float] = None  # largest error of position so far [m]
    failure: str = ''  # reason why it cannot continue, one sentence; empty while it can
    notes: Tuple[str, ...] = ()  # remarks for the user, a sentence each
    # Reason for rest, and a remedy; None during motion, and if unknown.
    idle: Optional[Idle] = None


END_TIMEOUT = 10.0  # for the thread of a source to end [s]

# Stored frames; at 50 per second those of ten minutes.
FRAMES_MAX = 30_000


class FrameHistory:
    """
    Frames in the order of time, the oldest dropped; safe for any number of threads.

    At least `most` are kept; up to a tenth more are stored before they are dropped.
    """

    def __init__(self, most: int = FRAMES_MAX):
        self._most = most
        self._lock = Lock()
        self._times: List[float] = []
        self._frames: List[Frame] = []
        self.epoch = 0  # number of restarts

    def add(self, frame: Frame) -> None:
        """Take the next frame; one that is not later than the last begins a new epoch."""
        with self._lock:
            if self._times and frame.time <= self._times[-1]:
                self._forget()
            self._times.append(frame.time)
            self._frames.append(frame)
            if len(self._times) > 1.1 * self._most:
                del self._times[:-self._most], self._frames[:-self._most]

    def forget(self) -> None:
        """Begin a new epoch, without frames."""
        with self._lock:
            self._forget()

    def _forget(self) -> None:
        self._times, self._frames = [], []
        self.epoch += 1

    @property
    def newest(self) -> Optional[Frame]:
        """Return the last frame, None before any."""
        with self._lock:
            return self._frames[-1] if self._frames else None

    @property
    def span(self) -> Tuple[float, float]:
        """Return the times of the first and the last frame, twice 0 before any [s]."""
        with self._lock:
            return (self._times[0], self._times[-1]) if self._times else (0.0, 0.0)

    def at(self, time: float) -> Optional[Frame]:
        """Return the last frame not later than `time` [s], else the first; None before any."""
        with self._lock:
            where = max(0, bisect_right(self._times, time) - 1)
            return self._frames[where] if self._frames else None

    def since(self, time: float) -> Sequence[Frame]:
        """Return the frames later than `time` [s], oldest first."""
        with self._lock:
            return self._frames[bisect_right(self._times, time):]

    def __len__(self) -> int:
        with self._lock:
            return len(self._frames)

    def thin(self) -> None:
        """Drop every other frame."""
        with self._lock:
            del self._times[1::2], self._frames[1::2]


class Source(ABC):
    """
    A robot on a ground, frame by frame.

    All methods may be called from any thread, at any time between `start` and `close`.  A control
    NAME is the method ``_set_NAME`` of a subclass.
    """

    def __init__(self) -> None:
        self._history = FrameHistory()
        self._sought: Optional[float] = None  # time to show instead of the latest [s]
        self._ending = Event()
        self._thread: Optional[Thread] = None
        self.curve: Optional[HeightCurve] = None  # of the robot
        self.floor: Optional[Floor] = None
        self.start_pose = (0.0, 0.0, 0.0)  # on the floor, see `Frame.place` [m], [rad]

    @property
    @abstractmethod
    def title(self) -> str:
        """Return the displayed name, for instance ``Scene doorstep``."""

    @property
    @abstractmethod
    def robot(self) -> Robot:
        """Return the robot; another object if it has changed."""

    @property
    def terrain(self) -> Optional[Terrain]:
        """Return the ground, another object if it has changed; None if unknown, and on a floor."""
        return None

    @property
    @abstractmethod
    def health(self) -> Health:
        """Return the state of the source."""

    @property
    @abstractmethod
    def controls(self) -> Mapping[str, Control]:
        """Return the controls of this source, by names of `CONTROLS`."""

    def start(self) -> None:
        """Start `_live` in a thread, also after `close`."""
        self._ending.clear()
        self._thread = Thread(target=self._live, name=type(self).__name__, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._ending.set()
        if self._thread is not None:
            self._thread.join(END_TIMEOUT)

    def _live(self) -> None:
        """Add frames to the history until `_ending` is set."""

    @property
    def epoch(self) -> int:
        """Return the number of restarts: frames of another epoch belong to another run."""
        return self._history.epoch

    @property
    def shown(self) -> Optional[Frame]:
        """Return the frame to show: the latest, or that of the selected time; None before any."""
        return self._history.newest if self._sought is None else self._history.at(self._sought)

    @property
    def span(self) -> Tuple[float, float]:
        """Return the first and the last time of the frames, twice 0 before any [s]."""
        return self._history.span

    def history(self, since: float) -> Sequence[Frame]:
        """Return the frames of this epoch later than a time [s], oldest first."""
        return self._history.since(since)

    def apply(self, name: str, value: Value) -> None:
        """
        Use a control; a longer effect happens later and shows in `controls` and `health`.

        Raises `ConfigurationError` for a control that this source does not have or that cannot be
        used now, and for a value that is not allowed; nothing has changed then.
        """
        value = checked(self.controls, name, value)
        try:
            self._use(name, value)
        except ConfigurationError:
            raise
        except BallbotError as error:
            raise ConfigurationError(f'{name}: {error}', error.reason, name) from error

    def _use(self, name: str, value: Value) -> None:
        getattr(self, f'_set_{name}')(value)


def checked(controls: Mapping[str, Control], name: str, value: Any) -> Value:
    """
    Return the value for a control of a source, converted to its type.

    Raises `ConfigurationError` naming control, value and allowed values.
    """
    if name not in controls:
        raise ConfigurationError(
            f'{name!r} is not a control here{suggestion(name, controls)}', 'unknown_name', name)
    control, kind = controls[name], CONTROLS[name][0]
    if control.refusal:
        raise ConfigurationError(f'{name}: {control.refusal}', 'unavailable', name)
    if kind is tuple:
        if len(value) != 2 or not all(map(math.isfinite, value)):
            raise ConfigurationError(
                f'{name} must be two finite numbers, got {value!r}', 'not_finite', name)
        return float(value[0]), float(value[1])
    # A slider rounds; its ends must not be refused for this.
    ends = [end for end in (control.lowest, control.highest) if end is not None]
    if isinstance(value, float):
        value = next((end for end in ends if math.isclose(value, end, abs_tol=1e-9)), value)
    checked_value: Value = check_value(name, value, {
        'kind': kind, 'choices': control.choices, 'unit': control.unit or '1', 'above': -math.inf,
        'minimum': -math.inf if control.lowest is None else control.lowest,
        'maximum': math.inf if control.highest is None else control.highest}, '')
    return checked_value
