# SPDX-License-Identifier: Apache-2.0
"""
The source of a page: a simulated scene or floor, running nodes, or a bag.

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

# Control that a source may have -> the type of its value, and its effect.
CONTROLS: Mapping[str, Tuple[type, str]] = MappingProxyType({
    'pause': (bool, 'pause; false resumes at the latest time'),
    'step': (float, 'advance by a time while paused [s]'),
    'reset': (bool, 'restart'),
    'speed': (float, 'simulated seconds per second of wall time'),
    'seek': (float, 'show an earlier time [s]'),
    'scene': (str, 'restart with another scene'),
    'robot': (str, 'restart with another robot'),
    'law': (str, 'control law of the motor'),
    'set_point': (float, 'set-point of the law, in its unit'),
    'yaw_rate': (float, 'yaw rate, within the limit for the speed [rad/s]'),
    'step_height': (float, 'height of the next step ahead [m]'),
    'friction': (float, 'coefficient of friction between ball and ground'),
    'accuracy': (float, 'largest position error [m]; 0 for the solver of the scene'),
    'e_stop': (bool, 'engage the e-stop; false releases it'),
    'goal': (tuple, 'drive to a position on the floor [m]'),
})


@dataclass(frozen=True)
class Control:
    """A value that can be set, with its range."""

    value: Optional[Value] = None  # present value; None if there is none or it is unknown
    lowest: Optional[float] = None  # range of a number
    highest: Optional[float] = None
    unit: str = ''
    choices: Tuple[str, ...] = ()  # allowed texts
    refusal: str = ''  # why it is unavailable at present, and the remedy; empty if available


class Idle(NamedTuple):
    """The reason why the robot is at rest, and the controls that start it, with a label."""

    reason: str
    label: str
    remedy: Tuple[Tuple[str, Value], ...]


@dataclass(frozen=True)
class Health:
    """State of a source."""

    running: bool  # whether time advances
    real_time_factor: Optional[float] = None  # measured simulated seconds per second of wall time
    error_estimate: Optional[float] = None  # largest position error so far [m]
    failure: str = ''  # reason why it cannot continue, one sentence; empty while it can
    notes: Tuple[str, ...] = ()  # remarks for the user, one sentence each
    # Why the robot is at rest, and a remedy; None during motion, and if unknown.
    idle: Optional[Idle] = None


END_TIMEOUT = 10.0  # for the thread of a source to end [s]

# Stored frames: ten minutes at 50 frames per second.
FRAMES_MAX = 30_000


class FrameHistory:
    """
    Thread-safe history of the latest frames, in chronological order.

    At least the last `most` are kept; older ones are dropped in blocks of a tenth of that.
    """

    def __init__(self, most: int = FRAMES_MAX):
        self._most = most
        self._lock = Lock()
        self._frames: List[Frame] = []
        self.epoch = 0  # number of restarts: frames of another epoch belong to another run

    def add(self, frame: Frame) -> None:
        """Add a frame; one that is not later than the last frame starts a new epoch."""
        with self._lock:
            if self._frames and frame.time <= self._frames[-1].time:
                self._forget()
            self._frames.append(frame)
            if len(self._frames) > 1.1 * self._most:
                del self._frames[:-self._most]

    def forget(self) -> None:
        """Start a new epoch, without frames."""
        with self._lock:
            self._forget()

    def _forget(self) -> None:
        self._frames = []
        self.epoch += 1

    def _after(self, time: float) -> int:
        """Return the index of the first frame later than `time` [s]."""
        return bisect_right(self._frames, time, key=lambda frame: frame.time)

    @property
    def newest(self) -> Optional[Frame]:
        """Return the last frame, None if there is none."""
        with self._lock:
            return self._frames[-1] if self._frames else None

    @property
    def span(self) -> Tuple[float, float]:
        """Return the times of the first and the last frame [s]; both 0 if there is none."""
        with self._lock:
            return (self._frames[0].time, self._frames[-1].time) if self._frames else (0.0, 0.0)

    def at(self, time: float) -> Optional[Frame]:
        """Return the last frame not later than `time` [s], else the first; None without any."""
        with self._lock:
            return self._frames[max(0, self._after(time) - 1)] if self._frames else None

    def since(self, time: float) -> Sequence[Frame]:
        """Return the frames later than `time` [s], oldest first."""
        with self._lock:
            return self._frames[self._after(time):]

    def __len__(self) -> int:
        with self._lock:
            return len(self._frames)

    def thin(self) -> None:
        """Drop every other frame."""
        with self._lock:
            del self._frames[1::2]


class Source(ABC):
    """
    A robot on its ground, as a sequence of frames.

    All methods may be called from any thread, at any time between `start` and `close`.  A subclass
    implements a control NAME in its method ``_set_NAME``.
    """

    def __init__(self) -> None:
        self.history = FrameHistory()
        self._sought: Optional[float] = None  # time to show instead of the latest [s]
        self._ending = Event()
        self._thread: Optional[Thread] = None
        self.curve: Optional[HeightCurve] = None  # height curve of the robot
        self.floor: Optional[Floor] = None
        self.start_pose = (0.0, 0.0, 0.0)  # on the floor, see `Frame.place` [m], [rad]

    @property
    @abstractmethod
    def title(self) -> str:
        """Return the displayed name, for instance ``Scene doorstep``."""

    @property
    @abstractmethod
    def robot(self) -> Robot:
        """Return the robot, a new object after each change."""

    @property
    def terrain(self) -> Optional[Terrain]:
        """Return the ground, a new object after each change; None if unknown or on a floor."""
        return None

    @property
    @abstractmethod
    def health(self) -> Health:
        """Return the state of the source."""

    @property
    @abstractmethod
    def controls(self) -> Mapping[str, Control]:
        """Return the controls of this source by their names in `CONTROLS`."""

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
    def shown(self) -> Optional[Frame]:
        """Return the frame to show: the latest, or that of the selected time; None if none."""
        return self.history.newest if self._sought is None else self.history.at(self._sought)

    def apply(self, name: str, value: Value) -> None:
        """
        Apply a value to a control; `controls` and `health` show effects that take longer.

        Raises `ConfigurationError` for a control that this source does not have or that is not
        available now, and for a value that is not allowed; then nothing changes.
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
    # A slider rounds its value, which must not make the ends of the range invalid.
    ends = [end for end in (control.lowest, control.highest) if end is not None]
    if isinstance(value, float):
        value = next((end for end in ends if math.isclose(value, end, abs_tol=1e-9)), value)
    checked_value: Value = check_value(name, value, {
        'kind': kind, 'choices': control.choices, 'unit': control.unit or '1', 'above': -math.inf,
        'minimum': -math.inf if control.lowest is None else control.lowest,
        'maximum': math.inf if control.highest is None else control.highest}, '')
    return checked_value
