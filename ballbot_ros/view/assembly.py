# SPDX-License-Identifier: Apache-2.0
"""
Frames out of messages, as nodes publish them or a bag has them.

A message is whatever has the fields of its type: this module knows no ROS.
"""
import math
from typing import Any, Mapping, Optional

from ballbot_ros.decision.values import Kind, Reason
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.view.frame import ContactForce, DecisionSign, EnergyShares, Frame
from ballbot_ros.view.seen_ground import SeenGround

# Numbers of StepDecision in their order, from 1 on; a test compares them with the message.
KINDS = (Kind.CLEAR, Kind.CROSS, Kind.STOP, Kind.GO_ROUND, Kind.BACK_OFF)
REASONS = (
    Reason.NOTHING_AHEAD, Reason.WITHIN_CURVE, Reason.TOO_HIGH, Reason.NO_ROOM, Reason.DROP,
    Reason.BAD_OBSERVATION, Reason.STALE, Reason.CONTRADICTORY, Reason.COMMITTED, Reason.TOO_FAST,
    Reason.NOT_LIKELY, Reason.LANDING, Reason.STEEP, Reason.FAILED_BEFORE, Reason.RUN_UP,
    Reason.STUCK, Reason.WALL, Reason.LIKELY, Reason.GOAL)

# Topics by the last part of their names.
TOPICS = ('ball_state', 'joint_states', 'odom', 'step_decision', 'step_observation',
          'terrain_observation', 'motor_status', 'e_stop')

# The true state goes before what is estimated for so long after its last message [s].
TRUSTED = 0.5

# Between two looks at ground that nobody knows, at least [s]: the page redraws it.
LOOK_AGAIN = 0.2


def stamp_of(message: Any) -> float:
    """Return the stamp of a message [s]."""
    stamp = message.header.stamp
    return float(stamp.sec + 1e-9 * stamp.nanosec)


class FrameAssembly:
    """
    Takes messages in the order of their coming and makes frames.

    Where ``ball_state`` comes, each of it is a frame; else each of ``joint_states`` is, with the
    newest ``odom``.

    Parameters
    ----------
    robot : Robot
    terrain : Terrain, optional
        The ground, where it is known; what sensors see, where it is not.

    """

    def __init__(self, robot: Robot, terrain: Optional[Terrain] = None):
        """Know nothing yet."""
        self.robot = robot
        self._given = terrain
        self.restart()

    def restart(self) -> None:
        """Forget all messages: time begins again."""
        self._ground = SeenGround(self.robot.ball_radius)
        self._decision: Optional[DecisionSign] = None
        self._e_stop: Optional[bool] = None
        self._odom: Optional[Any] = None
        self._torque: Optional[float] = None
        self._state_at = -math.inf
        self._looked_at = -math.inf

    @property
    def terrain(self) -> Optional[Terrain]:
        """Return the ground as far as it is known."""
        return self._given or self._ground.terrain

    @property
    def decision(self) -> Optional[DecisionSign]:
        """Return the last decision."""
        return self._decision

    def take(self, topic: str, message: Any) -> Optional[Frame]:
        """Take a message of a topic in `TOPICS`; return a frame where it makes one."""
        frame: Optional[Frame] = getattr(self, f'_take_{topic}')(message)
        return frame

    def _take_ball_state(self, message: Any) -> Frame:
        self._state_at = stamp_of(message)
        return Frame(
            self._state_at, message.x, message.y, message.ball_angle,
            known(message.pendulum_angle), message.velocity_x, message.velocity_y,
            message.ball_rate, known(message.pendulum_rate), known(message.pendulum_torque),
            tuple(contact_force(contact) for contact in message.contacts),
            EnergyShares(message.kinetic_energy, message.potential_energy, message.contact_energy,
                         message.dissipated_energy, message.motor_work),
            self._decision, self._e_stop)

    def _take_joint_states(self, message: Any) -> Optional[Frame]:
        time = stamp_of(message)
        if 0.0 <= time - self._state_at < TRUSTED:
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
        place = self._place_to_look_from(message)
        if place is not None:
            self._ground.see_step(place.x, place.z, message.distance,
                                  message.height if message.detected else 0.0)

    def _take_terrain_observation(self, message: Any) -> None:
        place = self._place_to_look_from(message)
        if place is not None and len(message.x) > 1:
            self._ground.see_profile(place.x, place.z, message.x, message.z)

    def _place_to_look_from(self, message: Any) -> Optional[Any]:
        """Return where the ball is; None where it is not known, or the ground is."""
        time = stamp_of(message)
        if self._given is not None or self._odom is None \
                or 0.0 <= time - self._looked_at < LOOK_AGAIN:
            return None
        self._looked_at = time
        return self._odom.pose.pose.position

    def _take_step_decision(self, message: Any) -> None:
        self._decision = decision_sign(message)


def decision_sign(message: Any) -> DecisionSign:
    """Return what a StepDecision says."""
    kind, reason = (names[number - 1].value if 1 <= number <= len(names) else 'unknown'
                    for names, number in ((KINDS, message.decision), (REASONS, message.reason)))
    ahead = kind != 'clear' and reason != 'nothing_ahead'
    touch = known(message.touch_speed)
    return DecisionSign(
        kind, reason, message.explanation, known(message.height) if ahead else None,
        known(message.distance) if ahead else None,
        touch if touch is not None else known(message.required_speed),
        known(message.height_margin), known(message.probability))


def contact_force(contact: Any) -> ContactForce:
    """Return a Contact as a force along x and y."""
    normal, friction = contact.normal_force, contact.friction_force
    return ContactForce(
        contact.x, contact.y, normal * contact.normal_x + friction * contact.normal_y,
        normal * contact.normal_y - friction * contact.normal_x, contact.penetration)


def known(value: float) -> Optional[float]:
    """Return a number, None for one that nobody knows."""
    return float(value) if math.isfinite(value) else None


def total(joints: Mapping[str, Optional[float]]) -> Optional[float]:
    """Return the absolute angle or rate of the pendulum from those of the joints."""
    shell, pendulum = joints.get('shell'), joints.get('pendulum')
    return None if shell is None or pendulum is None else shell + pendulum
