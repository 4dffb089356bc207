# SPDX-License-Identifier: Apache-2.0
"""Markers for RViz and Foxglove: ground, contacts, forces, and the decision."""
import math
from typing import Iterable, List, Sequence, Tuple

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from nav_msgs.msg import Odometry
import numpy as np
from rclpy.node import Node
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from ballbot_ros.decision import Decision, Kind
from ballbot_ros.floors.profile import WALL_HEIGHT
from ballbot_ros.physics.model.state import force_components, State
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.simulation.model import Model
from ballbot_ros.plant import FloorPlant
from ballbot_ros.ros.conversions import to_time
from ballbot_ros.ros.endpoints import create_publisher
from ballbot_ros.ros.frames import Frames
from ballbot_ros.steering.model import moved_to

MARKER_PERIOD = 0.1  # [s]
HALF_WIDTH = 0.5  # of ground and steps, to both sides [m]
GROUND_EXTENSION = 5.0  # length of the ground that is drawn beyond its last vertex [m]
WEIGHT_ARROW_LENGTH = 0.3  # length of the arrow of a force equal to the weight [m]
GROUND_COLOUR, WALL_COLOUR = (0.55, 0.5, 0.45, 1.0), (0.8, 0.8, 0.78, 0.5)
CONTACT_COLOUR, FORCE_COLOUR = (0.9, 0.1, 0.1, 1.0), (0.9, 0.6, 0.1, 1.0)
LIMIT_COLOUR = (0.1, 0.4, 0.9, 1.0)
ACCEPTED_COLOUR, REFUSED_COLOUR = (0.1, 0.65, 0.25, 1.0), (0.85, 0.15, 0.1, 1.0)
Place = Tuple[float, float, float]


class MarkerTopic:
    """The topic ``markers``, if `wanted`: at most 10 times a second, and only with subscribers."""

    def __init__(self, node: Node, wanted: bool):
        self._topic = create_publisher(node, 'markers') if wanted else None
        self._last = -math.inf

    def is_due(self, now: float) -> bool:
        """Return whether markers are due and have subscribers, and schedule the next ones."""
        if self._topic is None or 0.0 <= now - self._last < MARKER_PERIOD:
            return False
        self._last = now
        return self._topic.get_subscription_count() > 0

    def publish(self, markers: List[Marker]) -> None:
        assert self._topic is not None
        self._topic.publish(MarkerArray(markers=markers))


def world_markers(state: State, model: Model, frame: str) -> List[Marker]:
    """Return the ground, the contact points and the contact forces, in the frame `odom`."""
    stamp = to_time(state.time)
    ground = _marker(stamp, frame, 'terrain', Marker.TRIANGLE_LIST, GROUND_COLOUR, _ribbon(
        model.terrain.vertices), (1.0, 1.0, 1.0))
    return [ground, *_contact_markers(state, model, frame, (state.x, 0.0, 0.0))]


def floor_markers(plant: FloorPlant, frames: Frames) -> List[Marker]:
    """Return walls and features of a floor, and the contacts of the ball."""
    stamp, floor = to_time(plant.time), plant.floor
    walls: List[Place] = []
    for x, y, wide, high in floor.walls.tolist():
        corners = [(x - wide, y - high), (x + wide, y - high), (x + wide, y + high),
                   (x - wide, y + high)]
        for one, two in zip(corners, (*corners[1:], corners[0])):
            low, top = [(*one, 0.0), (*two, 0.0)], [(*one, WALL_HEIGHT), (*two, WALL_HEIGHT)]
            walls += [low[0], low[1], top[0], top[0], low[1], top[1]]
    outlines = [(*point, 0.005) for feature in floor.features for segment in feature.segments
                for point in segment]
    where = frames.map or frames.odom
    return [
        _marker(stamp, where, 'walls', Marker.TRIANGLE_LIST, WALL_COLOUR, walls, (1.0, 1.0, 1.0)),
        _marker(stamp, where, 'features', Marker.LINE_LIST, LIMIT_COLOUR, outlines,
                (0.02, 0.0, 0.0)),
        *_contact_markers(plant.state, plant.model, frames.odom, plant.relative_pose)]


def _contact_markers(state: State, model: Model, frame: str,
                     pose: Tuple[float, float, float]) -> List[Marker]:
    stamp = to_time(state.time)
    part = WEIGHT_ARROW_LENGTH / model.robot.weight if model.robot.weight > 0.0 else 0.0

    def place(x: float, z: float) -> Place:
        """Return a point of the vertical plane of the path."""
        return (*moved_to(pose[:2], pose[2], x - state.x), z)

    points, arrows = [], []
    for touch in model.touches(state):
        along, up = force_components(
            touch.normal_force, touch.friction_force, touch.normal_x, touch.normal_y)
        points.append(place(touch.x, touch.y))
        arrows += [points[-1], place(touch.x + part * along, touch.y + part * up)]
    return [
        _marker(stamp, frame, 'contacts', Marker.SPHERE_LIST, CONTACT_COLOUR, points,
                (0.03, 0.03, 0.03)),
        _marker(stamp, frame, 'forces', Marker.LINE_LIST, FORCE_COLOUR, arrows, (0.015, 0.0, 0.0))]


def decision_markers(decision: Decision, odometry: Odometry, radius: float) -> List[Marker]:
    """
    Return markers of the step ahead, its permitted height, and the decision at the ball.

    They are in the frame of `odometry`, which has the position of the centre of the ball; `radius`
    is that of the ball [m].
    """
    stamp, frame = odometry.header.stamp, odometry.header.frame_id
    at = odometry.pose.pose.position
    colour = ACCEPTED_COLOUR if decision.kind in (Kind.CLEAR, Kind.CROSS) else REFUSED_COLOUR
    foot, floor = at.x + decision.distance, at.z - radius
    known = math.isfinite(decision.distance) and math.isfinite(decision.height)
    outline, limit = [], []
    if known and decision.height != 0.0:
        left, right, top = HALF_WIDTH, -HALF_WIDTH, floor + decision.height
        outline = [(foot, left, floor), (foot, left, top), (foot, right, top),
                   (foot, right, floor), (foot, left, floor)]
        most = decision.outlook.height_limit
        if math.isfinite(most):
            limit = [(foot, side, floor + most) for side in (-HALF_WIDTH, HALF_WIDTH)]
    text = _marker(stamp, frame, 'decision', Marker.TEXT_VIEW_FACING, colour,
                   [(at.x, 0.0, at.z + 2.0 * radius)], (0.0, 0.0, 0.08))
    text.pose.position, text.points = text.points[0], []
    text.text = f'{decision.kind.name}\n{decision.explanation}'
    return [
        _marker(stamp, frame, 'step', Marker.LINE_STRIP, colour, outline, (0.02, 0.0, 0.0)),
        _marker(stamp, frame, 'height_limit', Marker.LINE_STRIP, LIMIT_COLOUR, limit,
                (0.015, 0.0, 0.0)),
        text]


def _ribbon(vertices: Array) -> List[Place]:
    """Return the triangles of the ground, extended along its last segments."""
    ends = [vertices[near] + GROUND_EXTENSION * (vertices[near] - vertices[next_])
            / np.linalg.norm(vertices[near] - vertices[next_])
            for near, next_ in ((0, 1), (-1, -2))]
    course = [ends[0], *vertices, ends[1]]
    found: List[Place] = []
    for (x, z), (next_x, next_z) in zip(course[:-1], course[1:]):
        corners = [(float(a), side, float(b)) for a, b in ((x, z), (next_x, next_z))
                   for side in (HALF_WIDTH, -HALF_WIDTH)]
        found += [corners[0], corners[1], corners[2], corners[2], corners[1], corners[3]]
    return found


def _marker(stamp: Time, frame: str, name: str, kind: int, colour: Sequence[float],
            points: Iterable[Place], scale: Place) -> Marker:
    """Return a marker of points; without points, one that deletes the previous marker."""
    places = [Point(x=x, y=y, z=z) for x, y, z in points]
    return Marker(
        header=Header(stamp=stamp, frame_id=frame), ns=name, type=kind,
        action=Marker.ADD if places else Marker.DELETE,  # viewers warn about an empty list
        pose=Pose(orientation=Quaternion(w=1.0)), scale=Vector3(**dict(zip('xyz', scale))),
        color=ColorRGBA(**dict(zip('rgba', colour))), points=places)
