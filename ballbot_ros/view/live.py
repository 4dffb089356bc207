# SPDX-License-Identifier: Apache-2.0
"""Running nodes as something to look at and to drive: a simulator or a bridge."""
from dataclasses import replace
import math
from time import monotonic
from types import MappingProxyType
from typing import Any, Dict, List, Mapping, Optional, Protocol, Sequence, Tuple

from ballbot_ros.decision.planning.curve import HeightCurve
from ballbot_ros.errors import BallbotError, ConfigurationError
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.plant import Speedometer
from ballbot_ros.ros.spectator import Presence, Spectator
from ballbot_ros.view.assembly import FrameAssembly
from ballbot_ros.view.frame import Frame
from ballbot_ros.view.frame_history import FrameHistory
from ballbot_ros.view.robot_named import scene_named
from ballbot_ros.view.source import checked, Control, Health, Value

# Law -> the largest set-point and its unit.
LAWS: Mapping[str, Tuple[float, str]] = MappingProxyType({
    'free': (0.0, ''), 'speed': (1.5, 'm/s'), 'position': (90.0, 'deg')})

SILENT = 1.0  # without a frame for longer, nothing comes [s]
EPOCH = 1e6  # a clock that says more counts from 1970 [s]


class GraphLink(Protocol):
    """What a live source needs of a `Spectator`, which says what each of them does."""

    presence: Presence

    @property
    def holding(self) -> bool: ...

    def start(self) -> None: ...
    def close(self) -> None: ...
    def attend(self) -> None: ...
    def ask_again(self) -> None: ...
    def trigger(self, service: str) -> str: ...
    def step(self, periods: int) -> None: ...
    def hold_speed(self, speed: float) -> None: ...
    def hold_angle(self, angle: float) -> None: ...
    def let_go(self) -> None: ...


class LiveSource:
    """
    Keeps frames of what nodes publish, and drives them while somebody looks.

    Parameters
    ----------
    namespace : str
        Of the nodes; empty for none.
    robot : str
        Name or file of the robot; empty for what the nodes say.
    link : GraphLink, optional
        In place of a `Spectator`.

    Raises
    ------
    ConfigurationError
        If there is no such robot, or the namespace is none.

    """

    def __init__(self, namespace: str = '', robot: str = '', link: Optional[GraphLink] = None):
        """Know nothing yet."""
        self._namespace, self._robot_name = namespace.strip('/'), robot
        self._said: Dict[str, Dict[str, Any]] = {}
        said = scene_named({}, robot)
        self._assembly, self._curve = FrameAssembly(said.robot), said.curve
        self._notes: Tuple[str, ...] = ()
        self._history = FrameHistory()
        self._speedometer = Speedometer()
        self._origin: Optional[float] = None
        self._frame_at = self._paused_at = -math.inf
        self._sought: Optional[float] = None
        self._law, self._set_point = 'free', 0.0
        self._link: GraphLink = link or Spectator(self._namespace, self.receive, self.learn)

    # What nodes say; from the thread of the link.

    def receive(self, topic: str, message: Any) -> None:
        """Take a message of a topic."""
        frame = self._assembly.take(topic, message)
        if frame is None:
            return
        if self._origin is None:
            self._origin = frame.time if frame.time > EPOCH else 0.0
        frame = replace(frame, time=frame.time - self._origin)
        newest = self._history.newest
        if newest is not None and frame.time <= newest.time:
            if frame.time > newest.time - SILENT:
                return  # repeated in lockstep, or overtaken on its way
            # Perhaps of another simulator, on another scene.
            self._link.ask_again()
            self._assembly.restart()
            self._speedometer = Speedometer()
        self._frame_at = monotonic()
        self._history.add(frame)
        self._speedometer.note(frame.time, self._frame_at)

    def learn(self, node: str, parameters: Mapping[str, Any]) -> None:
        """Take parameters of a node."""
        if self._said.get(node) == parameters:
            return
        self._said[node] = dict(parameters)
        said = scene_named(self._parameters, self._robot_name)
        self._notes, self._curve = said.notes, said.curve
        self._assembly = FrameAssembly(said.robot, said.terrain)

    # What the page asks; from any thread.

    @property
    def title(self) -> str:
        """Return whom this looks at."""
        nodes = [name for name in ('simulator', 'bridge') if name in self._link.presence.nodes]
        where = f' in /{self._namespace}' if self._namespace else ''
        return f'Live: {" and ".join(nodes) or "waiting"}{where}'

    @property
    def robot(self) -> Robot:
        """Return the robot."""
        return self._assembly.robot

    @property
    def terrain(self) -> Optional[Terrain]:
        """Return the ground of the scene, or as far as it was seen."""
        return self._assembly.terrain

    @property
    def curve(self) -> Optional[HeightCurve]:
        """Return the curve of this robot, None where none comes with the package."""
        return self._curve

    @property
    def epoch(self) -> int:
        """Return how often time began again."""
        return self._history.epoch

    @property
    def shown(self) -> Optional[Frame]:
        """Return the newest frame, or that which was sought; who asks is looking."""
        self._link.attend()
        return self._history.newest if self._sought is None else self._history.at(self._sought)

    @property
    def span(self) -> Tuple[float, float]:
        """Return the times there are frames of [s]."""
        return self._history.span

    @property
    def health(self) -> Health:
        """Return whether frames come, and what is waited for."""
        running = self._fresh
        factor = self._speedometer.factor
        return Health(running, factor if running and math.isfinite(factor) else None,
                      notes=(*self._notes, *self._awaited()))

    @property
    def controls(self) -> Mapping[str, Control]:
        """Return the same at all times: what no node here can do has a refusal."""
        presence = self._link.presence
        begin, end = self._history.span
        found = {'pause': Control(self._paused), 'seek': Control(None, begin, end, 's')}
        simulator, bridge = ('' if name in presence.nodes else f'there is no {name} here'
                             for name in ('simulator', 'bridge'))
        found['step'] = Control(None, 1e-3, 10.0, 's', refusal=simulator)
        found['reset'] = Control(None, refusal=simulator)
        law = self._law if self._link.holding else 'free'
        others = ' and '.join(presence.drivers)
        refusal = (f'{others} drives; end it first' if others else '' if presence.followers
                   else 'nobody follows set-points here')
        largest, unit = LAWS[law]
        found['law'] = Control(law, choices=tuple(LAWS), refusal=refusal)
        found['set_point'] = Control(
            self._set_point if law != 'free' else None, -largest, largest, unit,
            refusal=refusal or ('' if law != 'free' else 'choose a law first'))
        newest = self._history.newest
        found['e_stop'] = Control(None if newest is None else newest.e_stop, refusal=bridge)
        return MappingProxyType(found)

    def history(self, since: float) -> Sequence[Frame]:
        """Return the frames later than a time [s]."""
        return self._history.since(since)

    def apply(self, name: str, value: Value) -> None:
        """
        Use a control; waits for the answer of the node.

        Raises
        ------
        ConfigurationError
            With nothing changed, in the words of the node where it refuses.

        """
        value = checked(self.controls, name, value)
        try:
            getattr(self, f'_set_{name}')(value)
        except ConfigurationError:
            raise
        except BallbotError as error:
            raise ConfigurationError(f'{name}: {error}') from error

    def start(self) -> None:
        """Begin to receive."""
        self._link.start()

    def close(self) -> None:
        """Leave the nodes alone."""
        self._link.close()

    @property
    def _fresh(self) -> bool:
        return monotonic() - self._frame_at < SILENT

    @property
    def _paused(self) -> bool:
        """Return whether the page stands: at an earlier moment, or because nothing goes on."""
        return self._sought is not None or not self._fresh or self._paused_at > self._frame_at

    @property
    def _parameters(self) -> Dict[str, Any]:
        """Return what all nodes say, by parameter."""
        return {name: value for said in list(self._said.values())
                for name, value in said.items() if value}

    def _awaited(self) -> List[str]:
        """Return what is waited for, a sentence each."""
        nodes = self._link.presence.nodes
        if self._fresh:
            return []
        if 'simulator' in nodes:
            return ['Nothing comes from the simulator: it starts, is paused, or waits for '
                    'a command.']
        if 'bridge' in nodes:
            return ['Nothing comes from the bridge: it waits for its drive.']
        where = f'in the namespace /{self._namespace}' if self._namespace else 'here'
        return [f'Waiting for a simulator or a bridge {where}; ROS_DOMAIN_ID and namespace must '
                'be theirs.']

    def _set_pause(self, value: bool) -> None:
        simulated = 'simulator' in self._link.presence.nodes
        if simulated:
            self._link.trigger('simulator/pause' if value else 'simulator/resume')
            self._paused_at = monotonic() if value else -math.inf
        newest = self._history.newest
        # A real robot does not stand still for a page: the page stands.
        self._sought = newest.time if value and not simulated and newest is not None else None

    def _set_step(self, seconds: float) -> None:
        self._sought = None
        rate = float(self._parameters.get('control_rate', 500.0))
        self._link.step(max(1, round(seconds * rate)))

    def _set_reset(self, _: bool) -> None:
        self._link.trigger('simulator/reset')
        self._sought = None
        self._history.forget()

    def _set_seek(self, time: float) -> None:
        self._sought = time

    def _set_law(self, law: str) -> None:
        self._law, self._set_point = law, 0.0
        self._hold()

    def _set_set_point(self, value: float) -> None:
        self._set_point = value
        self._hold()

    def _hold(self) -> None:
        """Hold what the law and its set-point say."""
        self._link.attend()
        if self._law == 'speed':
            self._link.hold_speed(self._set_point)
        elif self._law == 'position':
            self._link.hold_angle(math.radians(self._set_point))
        else:
            self._link.let_go()

    def _set_e_stop(self, engaged: bool) -> None:
        if engaged:
            self._law = 'free'
            self._link.let_go()
        self._link.trigger('bridge/engage_e_stop' if engaged else 'bridge/release_e_stop')
