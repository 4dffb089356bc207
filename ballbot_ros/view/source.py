# SPDX-License-Identifier: Apache-2.0
"""
What the page asks of whatever it shows: a scene that runs, running nodes, or a bag.

The page asks at its own rate, from its own threads; a source runs at its own pace and answers at
once, from what it has.
"""
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Mapping, Optional, Protocol, Sequence, Tuple, Union

from ballbot_ros.config.fields import suggestion
from ballbot_ros.decision.planning.curve import HeightCurve
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.view.frame import Frame

Value = Union[bool, float, str]

# Every control that a source may have: the kind of its value, and what it does.  A source has the
# same control under the same name, or does not have it.
CONTROLS: Mapping[str, Tuple[type, str]] = MappingProxyType({
    'pause': (bool, 'hold time; false lets it go on, from the newest moment'),
    'step': (float, 'go on by so many seconds while paused'),
    'reset': (bool, 'begin again'),
    'speed': (float, 'seconds of the robot per second of the clock on the wall'),
    'seek': (float, 'show an earlier moment [s]'),
    'scene': (str, 'another scene'),
    'robot': (str, 'another robot'),
    'law': (str, 'what the motor follows'),
    'set_point': (float, 'what the law is to hold; its unit is that of the law'),
    'step_height': (float, 'height of the next step ahead [m]'),
    'friction': (float, 'coefficient between ball and ground'),
    'accuracy': (float, 'largest error of position [m]; 0 for the solver of the scene'),
    'e_stop': (bool, 'engage the e-stop; false releases it'),
})


@dataclass(frozen=True)
class Control:
    """
    What can be set, its range, and how it stands.

    Attributes
    ----------
    value : bool, float, str or None
        In force; None where there is none, or nobody knows.
    lowest, highest : float or None
        Range of a number.
    unit : str
    choices : tuple of str
        Of a text.
    refusal : str
        Why it cannot be used now; empty where it can.

    """

    value: Optional[Value] = None
    lowest: Optional[float] = None
    highest: Optional[float] = None
    unit: str = ''
    choices: Tuple[str, ...] = ()
    refusal: str = ''


@dataclass(frozen=True)
class Health:
    """
    How a source is doing.

    Attributes
    ----------
    running : bool
        Whether time goes on.
    real_time_factor : float or None
        Seconds of the robot per second of the clock on the wall, as measured.
    error_estimate : float or None
        Largest error of position so far [m].
    failure : str
        Why it cannot go on, one sentence; empty while it can.
    notes : tuple of str
        What a person should know, a sentence each.

    """

    running: bool
    real_time_factor: Optional[float] = None
    error_estimate: Optional[float] = None
    failure: str = ''
    notes: Tuple[str, ...] = ()


class Source(Protocol):
    """
    A robot on a ground, moment by moment.

    All methods may be called from any thread, at any time between `start` and `close`, and none
    waits for anything.
    """

    @property
    def title(self) -> str:
        """Return what is shown, for instance ``scene doorstep``."""

    @property
    def robot(self) -> Robot:
        """Return the robot; another object where it has changed."""

    @property
    def terrain(self) -> Optional[Terrain]:
        """Return the ground, another object where it has changed; None where nobody knows."""

    @property
    def curve(self) -> Optional[HeightCurve]:
        """Return the height curve that goes with the robot; None where there is none."""

    @property
    def epoch(self) -> int:
        """Return how often all began again: frames of another epoch belong to another run."""

    @property
    def shown(self) -> Optional[Frame]:
        """Return the frame to look at: the newest, or that which was sought; None before any."""

    @property
    def span(self) -> Tuple[float, float]:
        """Return the first and the last time there are frames of, twice 0 before any [s]."""

    @property
    def health(self) -> Health:
        """Return how the source is doing."""

    @property
    def controls(self) -> Mapping[str, Control]:
        """Return what this source can do, by names of `CONTROLS`."""

    def history(self, since: float) -> Sequence[Frame]:
        """Return the frames of this epoch later than a time [s], oldest first."""

    def apply(self, name: str, value: Value) -> None:
        """
        Use a control; what takes longer happens later, and shows in `controls` and `health`.

        Raises
        ------
        ConfigurationError
            For a control that this source does not have, or cannot use now, and for a value
            that is not allowed; nothing has changed then.

        """

    def start(self) -> None:
        """Begin."""

    def close(self) -> None:
        """End, once and for all."""


def checked(controls: Mapping[str, Control], name: str, value: Any) -> Value:
    """
    Return the value for a control of a source, in the kind that it has.

    Raises
    ------
    ConfigurationError
        Naming control, value and what is allowed.

    """
    if name not in controls:
        raise ConfigurationError(
            f'{name!r} cannot be set here{suggestion(name, controls)}')
    control, kind = controls[name], CONTROLS[name][0]
    if control.refusal:
        raise ConfigurationError(f'{name}: {control.refusal}')
    if kind is bool:
        if not isinstance(value, bool):
            raise ConfigurationError(f'{name} must be true or false, got {value!r}')
        return value
    if kind is str:
        if value not in control.choices:
            raise ConfigurationError(
                f'{name} must be one of {", ".join(control.choices)}, got {value!r}')
        return str(value)
    return _number(control, name, value)


def _number(control: Control, name: str, value: Any) -> float:
    """Return a number within the range of a control."""
    unit = f' {control.unit}' if control.unit else ''
    parts = [f'{words} {bound:g}' for words, bound in (
        ('at least', control.lowest), ('at most', control.highest)) if bound is not None]
    number = (float(value) if isinstance(value, (int, float)) and not isinstance(value, bool)
              else float('nan'))
    low = float('-inf') if control.lowest is None else control.lowest
    high = float('inf') if control.highest is None else control.highest
    # A slider rounds; its ends must not be refused for that.
    slack = 1e-9 * max(1.0, abs(number))
    if not low - slack <= number <= high + slack or abs(number) == float('inf'):
        raise ConfigurationError(
            f'{name} must be {" and ".join(parts) or "a finite number"}{unit}, got {value!r}')
    return min(max(number, low), high)
