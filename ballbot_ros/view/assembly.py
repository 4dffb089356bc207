# SPDX-License-Identifier: Apache-2.0
"""
Assembly of frames from messages of nodes or of a bag.

Messages are duck-typed by their fields: this module does not depend on ROS.
"""
import math
import re
from typing import Any, Mapping, Optional, Sequence, Tuple

import numpy as np

from ballbot_ros.bags.recorded_run import stamp_of
from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.config.files import shipped_folder
from ballbot_ros.decision.planning.curve import HeightCurve, load_curve
from ballbot_ros.errors import BallbotError, ConfigurationError
from ballbot_ros.floors.floor import load_floor, start_on
from ballbot_ros.physics.model.robot import load_robot, Robot
from ballbot_ros.physics.model.terrain import Array, Terrain
from ballbot_ros.physics.simulation.scene import load_scene
from ballbot_ros.view.frame import ContactForce, DecisionSign, EnergyShares, Frame
from ballbot_ros.view.source import Source

# Constants of StepDecision -> values of `decision.Kind` and of `decision.Reason`.
_MESSAGE = (shipped_folder('msg') / 'StepDecision.msg').read_text(encoding='utf-8')
KINDS, REASONS = ({int(number): name.lower() for name, number in re.findall(
    rf'uint8 {prefix}_(\w+)=(\d+)', _MESSAGE)} for prefix in ('DECISION', 'REASON'))

# Timeout after which the estimated state replaces the true one [s].
TRUE_STATE_TIMEOUT = 0.5

# Shortest time between two updates of observed terrain [s]: the page redraws it each time.
TERRAIN_PERIOD = 0.2


class FrameAssembly:
    """
    Creates frames from messages, in the order of their arrival.

    Each ``ball_state`` creates a frame; without it, each ``joint_states`` does, with the latest
    ``odom``.  The ground is the given one, otherwise the observed terrain.
    """

    def __init__(self, robot: Robot, terrain: Optional[Terrain] = None):
        self.robot = robot
        self._given = terrain
        self.restart()

    def restart(self) -> None:
        """Clear all messages for a restart of time."""
        self._ground = ObservedTerrain(self.robot.ball_radius)
        self._decision: Optional[DecisionSign] = None
        self._e_stop: Optional[bool] = None
        self._odom: Optional[Any] = None
        self._torque: Optional[float] = None
        self._state_at = -math.inf
        self._observed_at = -math.inf

    @property
    def terrain(self) -> Optional[Terrain]:
        """Return the given ground, otherwise the observed part; None if unknown."""
        return self._given or self._ground.terrain

    def take(self, topic: str, message: Any) -> Optional[Frame]:
        """Process a message of one of `TOPICS`; return the frame that it creates, if any."""
        frame: Optional[Frame] = getattr(self, f'_take_{topic}')(message)
        return frame

    def _take_ball_state(self, message: Any) -> Frame:
        self._state_at = stamp_of(message) / 1e9
        return Frame(
            self._state_at, message.x, message.y, message.ball_angle,
            known(message.pendulum_angle), message.velocity_x, message.velocity_y,
            message.ball_rate, known(message.pendulum_rate), known(message.pendulum_torque),
            tuple(map(ContactForce.of, message.contacts)),
            EnergyShares(message.kinetic_energy, message.potential_energy, message.contact_energy,
                         message.dissipated_energy, message.motor_work),
            self._decision, self._e_stop,
            (message.position_x, message.position_y, message.heading), message.lean,
            message.tilt)

    def _take_joint_states(self, message: Any) -> Optional[Frame]:
        time = stamp_of(message) / 1e9
        if 0.0 <= time - self._state_at < TRUE_STATE_TIMEOUT:
            return None
        joints = list(message.name)
        angles, rates, torques = (
            dict(zip(joints, map(known, map(float, values))))
            for values in (message.position, message.velocity, message.effort))
        pose, twist = ((self._odom.pose.pose.position, self._odom.twist.twist.linear)
                       if self._odom is not None else (None, None))
        return Frame(
            time, None if pose is None else known(pose.x), None if pose is None else known(pose.z),
            angles.get('shell'), total(angles), None if twist is None else known(twist.x),
            None if twist is None else known(twist.z), rates.get('shell'), total(rates),
            torques.get('pendulum'), decision=self._decision, e_stop=self._e_stop)

    def _take_odom(self, message: Any) -> None:
        self._odom = message

    def _take_e_stop(self, message: Any) -> None:
        self._e_stop = bool(message.data)

    def _take_motor_status(self, message: Any) -> None:
        self._e_stop = bool(message.e_stop)

    def _take_step_observation(self, message: Any) -> None:
        ball = self._position_of(message)
        if ball is not None:
            self._ground.add_step(ball.x, ball.z, message.distance,
                                  message.height if message.detected else 0.0)

    def _take_terrain_observation(self, message: Any) -> None:
        ball = self._position_of(message)
        if ball is not None and len(message.x) > 1:
            self._ground.add_profile(ball.x, ball.z, message.x, message.z)

    def _position_of(self, message: Any) -> Optional[Any]:
        """Return the position of the ball if it is known and a terrain update is due."""
        time = stamp_of(message) / 1e9
        if self._given is not None or self._odom is None \
                or 0.0 <= time - self._observed_at < TERRAIN_PERIOD:
            return None
        self._observed_at = time
        return self._odom.pose.pose.position

    def _take_step_decision(self, message: Any) -> None:
        self._decision = decision_sign(message)


# The topics that create frames, by the last part of their names.
TOPICS = tuple(name[len('_take_'):] for name in vars(FrameAssembly) if name.startswith('_take_'))


def decision_sign(message: Any) -> DecisionSign:
    """Return the content of a StepDecision."""
    kind = KINDS.get(message.decision, 'unknown')
    reason = REASONS.get(message.reason, 'unknown')
    ahead = kind != 'clear' and reason != 'nothing_ahead'
    touch = known(message.touch_speed)
    return DecisionSign(
        kind, reason, message.explanation, known(message.height) if ahead else None,
        known(message.distance) if ahead else None,
        touch if touch is not None else known(message.required_speed),
        known(message.height_margin), known(message.probability))


def known(value: float) -> Optional[float]:
    """Return a finite number; None, for unknown, if it is not finite."""
    return float(value) if math.isfinite(value) else None


def total(joints: Mapping[str, Optional[float]]) -> Optional[float]:
    """Return the absolute angle or rate of the pendulum: the sum over both joints."""
    shell, pendulum = joints.get('shell'), joints.get('pendulum')
    return None if shell is None or pendulum is None else shell + pendulum


# Smaller changes of a scan have no effect [m]: noise would redraw the page continuously.
TERRAIN_TOLERANCE = 1e-3


class ObservedTerrain:
    """
    Scans of the terrain joined to one polyline; the latest scan replaces older ones in its range.

    Scans are relative to the centre of the ball; `radius` is that of the ball [m].
    """

    def __init__(self, radius: float):
        self._radius = radius
        self._points: Optional[Array] = None
        self.terrain: Optional[Terrain] = None  # a new object after each change

    def add_profile(self, x: float, y: float, along: Sequence[float],
                    above: Sequence[float]) -> None:
        """Add a polyline relative to the centre (x, y) of the ball [m]."""
        self._join(np.column_stack([np.asarray(along) + x, np.asarray(above) + y]))

    def add_step(self, x: float, y: float, distance: float, height: float) -> None:
        """Add the next step ahead [m]; a height of 0 means clear ground up to the distance."""
        floor, face = y - self._radius, x + distance
        points = [[x, floor], [face, floor]]
        if height:
            points += [[face, floor + height], [face + self._radius, floor + height]]
        self._join(np.array(points))

    def _join(self, points: Array) -> None:
        points = points[np.isfinite(points).all(axis=1)]
        if len(points) < 2 or points[-1, 0] <= points[0, 0]:
            return
        known = self._points
        if known is not None:
            if self._agrees(points):
                return
            points = np.vstack([known[known[:, 0] < points[0, 0]], points,
                                known[known[:, 0] > points[-1, 0]]])
        points = _simplified(points)
        try:
            self.terrain, self._points = Terrain(points), points
        except ConfigurationError:
            pass  # an overhang, for example: the earlier scans are kept

    def _agrees(self, points: Array) -> bool:
        assert self._points is not None and self.terrain is not None
        known = self._points
        inside = (known[:, 0] > points[0, 0]) & (known[:, 0] < points[-1, 0])
        if points[0, 0] < known[0, 0] - TERRAIN_TOLERANCE \
                or points[-1, 0] > known[-1, 0] + 50.0 * TERRAIN_TOLERANCE:
            return False
        # Compared in both directions, to detect new steps and removed ones.
        return _lies_on(points, known) and _lies_on(known[inside], points)


def _lies_on(points: Array, line: Array) -> bool:
    """Return whether all points lie on a polyline within `TERRAIN_TOLERANCE`, also in x."""
    error = np.abs([np.interp(points[:, 0] + shift, line[:, 0], line[:, 1]) - points[:, 1]
                    for shift in (-TERRAIN_TOLERANCE, 0.0, TERRAIN_TOLERANCE)]).min(axis=0)
    return bool((error < TERRAIN_TOLERANCE).all())


def _simplified(points: Array) -> Array:
    """Return a polyline without duplicate and collinear vertices."""
    kept = [points[0]]
    for point, after in zip(points[1:], [*points[2:], None]):
        if point[0] < kept[-1][0] or np.hypot(*(point - kept[-1])) < 1e-9:
            continue
        if after is not None:
            along, onward = point - kept[-1], after - kept[-1]
            across = along[0] * onward[1] - along[1] * onward[0]
            if abs(across) < 1e-6 * max(np.hypot(*onward), 1e-9) and along @ onward > 0.0:
                continue
        kept.append(point)
    return np.array(kept)


DEFAULT_ROBOT = 'gimball'


class MessageSource(Source):
    """
    A source that creates frames from messages, and its robot and ground from node parameters.

    The parameters are ``scene``, ``floor``, ``robot``, ``hardware``, ``curve`` and ``variant``;
    files that another machine names may be missing here.  `robot`, a name or file, overrides them.
    Raises `ConfigurationError` if `robot` cannot be read.
    """

    def __init__(self, parameters: Mapping[str, Any], robot: str) -> None:
        super().__init__()
        self._describe(parameters, robot)

    def _describe(self, parameters: Mapping[str, Any], robot: str) -> None:
        """Load robot, ground and curve from node parameters, with notes on missing files."""
        self._notes: Tuple[str, ...] = ()
        terrain: Optional[Terrain] = None
        found = load_robot(robot) if robot else None
        self.floor = None
        try:
            if parameters.get('floor'):
                found = found or load_robot(str(parameters.get('robot') or DEFAULT_ROBOT))
                floor = load_floor(str(parameters['floor']))
                self.start_pose = start_on(floor, str(parameters.get('start') or ''))
                self.floor = floor
            elif parameters.get('scene'):
                scene = load_scene(
                    str(parameters['scene']), str(parameters.get('robot') or '') or None)
                terrain, found = scene.model.terrain, found or scene.model.robot
            elif found is None and parameters.get('robot'):
                found = load_robot(str(parameters['robot']))
            elif found is None and parameters.get('hardware'):
                found = load_robot(load_hardware(str(parameters['hardware'])).robot)
        except BallbotError as error:
            self._notes += (f'{error}.',)
        if found is None:
            found = load_robot(DEFAULT_ROBOT)
            self._notes += (
                f'The robot is unknown and drawn as {DEFAULT_ROBOT} (--robot NAME sets it).',)
        self.curve = self._curve_of(found, parameters)
        self._assembly = FrameAssembly(found, terrain)

    def _curve_of(self, robot: Robot, parameters: Mapping[str, Any]) -> Optional[HeightCurve]:
        """Return the named curve, otherwise that of the robot with its pendulum held down."""
        if parameters.get('curve'):
            try:
                curve = load_curve(
                    str(parameters['curve']), str(parameters.get('variant') or 'fit'))
                if curve.robot == robot.name:
                    return curve
            except BallbotError as error:
                self._notes += (f'{error}.',)
        try:
            return load_curve(f'{robot.name}_down')
        except BallbotError:
            return None

    @property
    def robot(self) -> Robot:
        return self._assembly.robot

    @property
    def terrain(self) -> Optional[Terrain]:
        """Return the ground of the scene, otherwise the observed terrain."""
        return self._assembly.terrain
