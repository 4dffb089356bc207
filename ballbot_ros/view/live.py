# SPDX-License-Identifier: Apache-2.0
"""Running nodes as a source: a simulator or a bridge."""
from dataclasses import replace
import math
from time import monotonic
from types import MappingProxyType
from typing import Any, Dict, List, Mapping, Optional, Tuple

from ballbot_ros.plant import Speedometer
from ballbot_ros.ros.spectator import Spectator
from ballbot_ros.view.assembly import MessageSource
from ballbot_ros.view.frame import Frame
from ballbot_ros.view.laws import SET_SPEED_MAX, UNITS
from ballbot_ros.view.source import Control, Health, Idle

# Law -> the largest set-point, in its unit of `UNITS`.
LAWS: Mapping[str, float] = MappingProxyType(
    {'free': 0.0, 'speed': SET_SPEED_MAX, 'position': 90.0})

FRAME_TIMEOUT = 1.0  # after the last frame, when the source counts as stopped [s]
WALL_CLOCK = 1e6  # later times are wall times, counted from 1970 [s]


class LiveSource(MessageSource):
    """
    Keeps frames from topics of nodes, and publishes set-points while a page is open.

    `robot`, a name or file, defaults to that of the nodes; `link` is the connection to the nodes.
    Raises `ConfigurationError` if there is no such robot, or the namespace is invalid.
    """

    def __init__(self, namespace: str = '', robot: str = '', link: Optional[Spectator] = None):
        super().__init__({}, robot)
        self._namespace, self._robot_name = namespace.strip('/'), robot
        self._described: Dict[str, Dict[str, Any]] = {}
        self._notes = ()
        self._speedometer = Speedometer()
        self._origin: Optional[float] = None
        self._frame_at = self._paused_at = -math.inf
        self._law, self._set_point = 'free', 0.0
        self._link = link or Spectator(self._namespace, self.receive, self.learn)

    # Messages and parameters of nodes; from the thread of the link.

    def receive(self, topic: str, message: Any) -> None:
        frame = self._assembly.take(topic, message)
        if frame is None:
            return
        if self._origin is None:
            self._origin = frame.time if frame.time > WALL_CLOCK else 0.0
        frame = replace(frame, time=frame.time - self._origin)
        newest = self.history.newest
        if newest is not None and frame.time <= newest.time:
            if frame.time > newest.time - FRAME_TIMEOUT:
                return  # repeated in lockstep, or out of order
            # The frame may come from another simulator with another scene.
            self._link.ask_again()
            self._assembly.restart()
            self._speedometer = Speedometer()
        self._frame_at = monotonic()
        self.history.add(frame)
        self._speedometer.note(frame.time, self._frame_at)

    def learn(self, node: str, parameters: Mapping[str, Any]) -> None:
        if self._described.get(node) != parameters:
            self._described[node] = dict(parameters)
            self._describe(self._parameters, self._robot_name)

    # For the page; from any thread.

    @property
    def title(self) -> str:
        nodes = [name for name in ('simulator', 'bridge') if name in self._link.presence.nodes]
        where = f' in /{self._namespace}' if self._namespace else ''
        return f'Live: {" and ".join(nodes) or "waiting"}{where}'

    @property
    def shown(self) -> Optional[Frame]:
        """Return the frame to show, and renew the held set-point."""
        self._link.attend()
        return super().shown

    @property
    def health(self) -> Health:
        """Return whether frames arrive and, if not, the missing conditions."""
        running = self._fresh
        factor = self._speedometer.factor
        paused = self._paused_at > self._frame_at and 'simulator' in self._link.presence.nodes
        return Health(running, factor if running and math.isfinite(factor) else None,
                      notes=(*self._notes, *self._awaited()),
                      idle=Idle('The simulator is paused.', 'Run', (('pause', False),))
                      if paused else None)

    @property
    def controls(self) -> Mapping[str, Control]:
        """Return all controls at all times: a control without its node has a refusal."""
        presence = self._link.presence
        start, end = self.history.span
        found = {'pause': Control(self._paused), 'seek': Control(None, start, end, 's')}
        simulator, bridge = ('' if name in presence.nodes else f'no node {name} is running'
                             for name in ('simulator', 'bridge'))
        found['step'] = Control(None, 1e-3, 10.0, 's', refusal=simulator)
        found['reset'] = Control(None, refusal=simulator)
        law = self._law if self._link.holding else 'free'
        others = ' and '.join(presence.drivers)
        refusal = (f'set-points are published by {others}, which must end first' if others else
                   '' if presence.followers else 'no node subscribes to set-points')
        found['law'] = Control(law, choices=tuple(LAWS), refusal=refusal)
        found['set_point'] = Control(
            self._set_point if law != 'free' else None, -LAWS[law], LAWS[law], UNITS[law],
            refusal=refusal or ('' if law != 'free' else 'choose a law other than free'))
        newest = self.history.newest
        found['goal'] = Control(None, refusal='' if 'navigator' in presence.nodes else (
            'no node navigator is running; "ballbot demo --house --view" runs one'))
        found['e_stop'] = Control(None if newest is None else newest.e_stop, refusal=bridge)
        return MappingProxyType(found)

    def start(self) -> None:
        self._link.start()

    def close(self) -> None:
        self._link.close()

    @property
    def _fresh(self) -> bool:
        return monotonic() - self._frame_at < FRAME_TIMEOUT

    @property
    def _paused(self) -> bool:
        """Return whether the page shows an earlier time, or time does not advance."""
        return self._sought is not None or not self._fresh or self._paused_at > self._frame_at

    @property
    def _parameters(self) -> Dict[str, Any]:
        return {name: value for described in list(self._described.values())
                for name, value in described.items() if value}

    def _awaited(self) -> List[str]:
        """Return the conditions that the source waits for, one sentence each."""
        nodes = self._link.presence.nodes
        if self._fresh:
            return []
        if 'simulator' in nodes:
            return ['No state arrives from the simulator: it is starting, paused, or waits for '
                    'a command.']
        if 'bridge' in nodes:
            return ['No state arrives from the bridge: it waits for its drive.']
        where = f'in the namespace /{self._namespace}' if self._namespace else 'here'
        return [f'Waiting for a simulator or a bridge {where}, with the same ROS_DOMAIN_ID: '
                'start one, for instance with "ballbot run simulator".']

    def _set_pause(self, value: bool) -> None:
        simulated = 'simulator' in self._link.presence.nodes
        if simulated:
            self._link.trigger('simulator/pause' if value else 'simulator/resume')
            self._paused_at = monotonic() if value else -math.inf
        newest = self.history.newest
        # A real robot cannot be paused: the page shows one frame instead.
        self._sought = newest.time if value and not simulated and newest is not None else None

    def _set_step(self, seconds: float) -> None:
        self._sought = None
        rate = float(self._parameters.get('control_rate', 500.0))
        self._link.step(max(1, round(seconds * rate)))

    def _set_reset(self, _: bool) -> None:
        self._link.trigger('simulator/reset')
        self._sought = None
        self.history.forget()

    def _set_seek(self, time: float) -> None:
        self._sought = time

    def _set_law(self, law: str) -> None:
        self._law, self._set_point = law, 0.0
        self._hold()

    def _set_set_point(self, value: float) -> None:
        self._set_point = value
        self._hold()

    def _hold(self) -> None:
        self._link.attend()
        if self._law == 'speed':
            self._link.hold_speed(self._set_point)
        elif self._law == 'position':
            self._link.hold_angle(math.radians(self._set_point))
        else:
            self._link.release_set_point()

    def _set_goal(self, place: Tuple[float, float]) -> None:
        self._link.go_to(*place, str(self._parameters.get('map_frame', 'map')))

    def _set_e_stop(self, engaged: bool) -> None:
        if engaged:
            self._law = 'free'
            self._link.release_set_point()
        self._link.trigger('bridge/engage_e_stop' if engaged else 'bridge/release_e_stop')
