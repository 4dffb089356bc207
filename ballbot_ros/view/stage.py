# SPDX-License-Identifier: Apache-2.0
"""The robot on its ground or floor, in three dimensions."""
import math
from typing import Any, List, Mapping, Optional, Tuple

import numpy as np
from trimesh import creation, Trimesh
from trimesh.util import concatenate
import viser
from viser.transforms import SE3, SO3

from ballbot_ros.figures.canvas import BLUE, GREEN, GREY, INK, ORANGE, SKY, VERMILION
from ballbot_ros.figures.drawing import ground_line
from ballbot_ros.floors.floor import Floor
from ballbot_ros.floors.profile import area_height
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.terrain import Array, Terrain
from ballbot_ros.results.faces import faces_of
from ballbot_ros.steering.model import moved_to
from ballbot_ros.view.floor_parts import base_level, floor_parts, GROUND, Mesh
from ballbot_ros.view.frame import Frame
from ballbot_ros.view.source import Source

# The ground is drawn beyond its ends, and beyond the ball, by this distance [m].
GROUND_EXTENSION, SECTION_DEPTH = 12.0, 0.15  # SECTION_DEPTH below the lowest point
# Length of the arrow of a force equal to the weight, and maximum length [ball radii].
WEIGHT_ARROW_LENGTH, ARROW_LENGTH_MAX = 0.8, 3.0
# Maximum number of drawn points of the path, and their minimum distance [ball radii].
PATH_POINTS_MAX, PATH_SPACING = 1500, 0.05
# The squares of the ground, and the section in front.
SQUARE_COLOUR, SECTION_COLOUR = '#D9D3C8', '#F1E9DC'
SQUARE_SIZE = 0.25  # [m]
SHADOW_RADIUS = 0.7  # [ball radii]
# Camera position and the point that it looks at, relative to the ball on the floor [m].
CAMERAS: Mapping[str, Tuple['Point', 'Point']] = {
    'side': ((0.35, -3.1, 0.62), (0.35, 0.0, 0.14)),
    'behind': ((-1.6, -1.7, 1.0), (0.5, 0.0, 0.1)),
    'close': ((0.1, -1.35, 0.4), (0.1, 0.0, 0.16)),
    'above': ((-2.2, -7.5, 8.0), (0.0, 0.6, 0.0))}
FIELD_OF_VIEW = math.radians(36.0)  # vertical
# Range of the width-to-height ratio of a phone held upright. The controls cover its lower part:
# the ball is drawn above the centre by this fraction of half the height.
PHONE_ASPECT, PHONE_BALL_OFFSET = (0.35, 0.62), 0.6
HALF_WIDTH_MIN = 0.45  # least distance visible on each side of the ball in a narrow window [m]
TARGET_HEIGHT = 0.2  # of the camera target in a narrow window [m]
# Below this width-to-height ratio, the panels leave this fraction of the width visible.
TABLET_ASPECT, VISIBLE_WIDTH_SHARE = 1.0, 1 / 3
Colour = Tuple[int, int, int]
Point = Tuple[float, float, float]


def camera_of(name: str, aspect: float) -> Tuple[Point, Point]:
    """Return position and target of a preset [m] for a window of a width-to-height ratio."""
    position, target = CAMERAS[name]
    if aspect >= TABLET_ASPECT:
        return position, target
    away = np.subtract(position, target)
    half_height = math.tan(0.5 * FIELD_OF_VIEW) * float(np.linalg.norm(away))
    visible = aspect if aspect < PHONE_ASPECT[1] else VISIBLE_WIDTH_SHARE * aspect
    factor = max(1.0, HALF_WIDTH_MIN / (visible * half_height))
    on_phone = PHONE_ASPECT[0] < aspect < PHONE_ASPECT[1]
    lower = PHONE_BALL_OFFSET * factor * half_height if on_phone else 0.0
    target = (0.0, 0.0, TARGET_HEIGHT - lower)
    x, y, z = np.add(target, factor * away).tolist()
    return (x, y, z), target


def look_from(client: viser.ClientHandle, name: str) -> None:
    """Move the camera of a browser to a preset."""
    client.camera.position, client.camera.look_at = camera_of(name, client.camera.aspect)


def rgb(colour: str) -> Colour:
    """Return a colour such as #0072B2 as three numbers."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def quarter_ring(radius: float, thickness: float, begin: float) -> Mesh:
    """
    Return a quarter of a torus about the axis of the ball [m].

    `begin` is the angle of its start [rad], counter-clockwise from straight down as in the model.
    """
    roll = np.linspace(0.0, 2.0 * math.pi, 11)
    profile = np.column_stack([radius + thickness * np.cos(roll), thickness * np.sin(roll)])
    ring = creation.revolve(profile, angle=0.5 * math.pi, sections=16)
    turn = SO3.from_y_radians(0.5 * math.pi - begin) @ SO3.from_x_radians(0.5 * math.pi)
    return ring.apply_transform(SE3.from_rotation(turn).as_matrix())


def rod(length: float, thickness: float) -> Mesh:
    """Return a rod that hangs down from the origin [m]."""
    return creation.cylinder(thickness, segment=[[0.0, 0.0, 0.0], [0.0, 0.0, -length]])


def bob(radius: float, width: float, length: float) -> Mesh:
    """Return a disk about the axis of the ball, `length` below the origin [m]."""
    return creation.cylinder(
        radius, segment=[[0.0, -0.5 * width, -length], [0.0, 0.5 * width, -length]])


def ribbon(line: Array, near: float, far: float) -> Mesh:
    """Return the surface along a line of (x, y), between two lateral positions [m]."""
    count, index = len(line), np.arange(len(line) - 1)
    points = np.vstack([
        np.column_stack([line[:, 0], np.full(count, side), line[:, 1]]) for side in (near, far)])
    return Trimesh(points, np.vstack([
        np.column_stack([index, index + 1, index + count]),
        np.column_stack([index + 1, index + count + 1, index + count])]), process=False)


def tiles(line: Array, half_width: float, size: float) -> Mesh:
    """Return every other square of a chequered strip along and just above a line (x, y) [m]."""
    parts = []
    for number in range(math.floor(line[0, 0] / size), math.ceil(line[-1, 0] / size)):
        left, right = max(line[0, 0], number * size), min(line[-1, 0], (number + 1) * size)
        inside = line[(line[:, 0] > left) & (line[:, 0] < right)]
        # np.interp returns the height beyond a face: seen from the other side, the one before it.
        begin = left, np.interp(left, line[:, 0], line[:, 1])
        end = right, np.interp(-right, -line[::-1, 0], line[::-1, 1])
        part = np.vstack([begin, inside, end]) + [0.0, 5e-4]
        parts.append(ribbon(part, *((-half_width, 0.0) if number % 2 else (0.0, half_width))))
    return concatenate(parts)


def place_of(source: Source, frame: Frame) -> Optional[Point]:
    """Return the centre of the ball in the world frame [m], None if it is unknown."""
    if frame.y is None:
        return None
    if source.floor is None:
        return None if frame.x is None else (frame.x, 0.0, frame.y)
    if frame.place is None:
        return None
    x, y, heading = source.start_pose
    return (*moved_to((x, y), heading, *frame.place[:2]), frame.y)


class Stage:
    """
    Draws frames of a source; the camera starts above its floor if it has one.

    The world is one node that moves relative to the camera, so that the ball stays in view.
    """

    def __init__(self, server: viser.ViserServer, source: Source):
        self._scene = server.scene
        self._scene.set_up_direction('+z')
        self._scene.world_axes.visible = False
        # Without a graphics card, shadows take most of the time of a frame.
        self._scene.configure_default_lights(cast_shadow=False)
        camera = server.initial_camera
        camera.position, camera.look_at = CAMERAS['side']
        camera.fov = FIELD_OF_VIEW
        if source.floor is None:
            server.on_client_connect(lambda client: look_from(client, 'side'))
        else:
            # The world is moved so that the ball is at the origin.
            left, right, bottom, top = source.floor.extent
            x, y = (0.5 * (left + right) - source.start_pose[0],
                    0.5 * (bottom + top) - source.start_pose[1])
            size = max(right - left, top - bottom)
            above = (x, y - 1.1 * size, 1.5 * size), (x, y, 0.0)

            def look(client: viser.ClientHandle) -> None:
                client.camera.position, client.camera.look_at = above
            server.on_client_connect(look)
        self._world = self._scene.add_frame('/world', show_axes=False)
        self._robot: Optional[Robot] = None
        self._terrain: Optional[Terrain] = None
        self._floor: Optional[Floor] = None
        self._epoch = -1
        self._reach = (0.0, 0.0)
        self._path: List[Tuple[float, Point]] = []
        self._path_since = -math.inf
        self._nodes: dict[str, Any] = {}

    def draw(self, source: Source, frame: Frame) -> None:
        if source.robot is not self._robot:
            self._build_robot(source.robot)
        x = frame.x if frame.x is not None else 0.0
        if source.floor is not None:
            if source.floor is not self._floor:
                self._build_floor(source.floor)
        elif source.terrain is not self._terrain or not self._reach[0] < x < self._reach[1]:
            self._build_ground(source.terrain, x, source.robot.ball_radius)
        self._place(source, frame)
        self._draw_forces(frame, source.robot)

    def draw_path(self, source: Source, frame: Frame) -> None:
        """Draw the path of the centre up to a frame; takes longer than `draw`."""
        if source.history.epoch != self._epoch:
            self._epoch, self._path, self._path_since = source.history.epoch, [], -math.inf
        apart = PATH_SPACING * source.robot.ball_radius
        for passed in source.history.since(self._path_since):
            self._path_since = passed.time
            point = place_of(source, passed)
            if point is not None and (
                    not self._path or math.dist(point, self._path[-1][1]) >= apart):
                self._path.append((passed.time, point))
        del self._path[:-PATH_POINTS_MAX]
        shown = [point for time, point in self._path if time <= frame.time]
        here = place_of(source, frame)
        ends = np.array(shown if here is None else [*shown, here], np.float32).reshape(-1, 3)
        pairs = np.stack([ends[:-1], ends[1:]], axis=1) if len(ends) > 1 else np.zeros(
            (1, 2, 3), np.float32)
        if 'path' in self._nodes:
            self._nodes['path'].points = pairs
        else:  # a floor is viewed from farther away
            self._nodes['path'] = self._scene.add_line_segments(
                '/world/path', pairs, np.array(rgb(GREEN)),
                thickness=(0.03 if source.floor is None else 0.06) * source.robot.ball_radius)

    def point_at(self, origin: Point, direction: Point) -> Optional[Tuple[float, float]]:
        """Return the intersection of a camera ray with the floor [m], None outside the floor."""
        if self._floor is None or direction[2] >= 0.0:
            return None
        start = np.subtract(origin, self._world.position)
        left, right, bottom, top = self._floor.extent
        height = 0.0
        for _ in range(4):  # iterate from level 0 to the level of the intersection
            x, y, _ = (start + np.array(direction) * (height - start[2]) / direction[2]).tolist()
            if not (left <= x <= right and bottom <= y <= top):
                return None
            height = base_level(self._floor, (x, y)) if self._floor.heights is None \
                else area_height(self._floor, (x, y))
        return x, y

    def _place(self, source: Source, frame: Frame) -> None:
        """Move ball and pendulum to their poses, and the world relative to the camera."""
        point, radius = place_of(source, frame), source.robot.ball_radius
        place, shadow = self._nodes['place'], self._nodes['shadow']
        place.visible = point is not None
        if point is None:
            return
        heading = 0.0 if source.floor is None or frame.place is None else (
            source.start_pose[2] + frame.place[2])
        place.position, place.wxyz = point, SO3.from_z_radians(heading).wxyz
        if frame.ball_angle is not None:
            self._nodes['ball'].wxyz = (
                SO3.from_x_radians(-frame.tilt) @ SO3.from_y_radians(-frame.ball_angle)).wxyz
        if 'pendulum' in self._nodes and frame.pendulum_angle is not None:
            self._nodes['pendulum'].wxyz = (
                SO3.from_y_radians(-frame.pendulum_angle)
                @ SO3.from_x_radians(frame.lean - frame.tilt)).wxyz
        self._world.position = (-point[0], -point[1], radius - point[2])
        ground = self._terrain
        shadow.visible = ground is not None or source.floor is not None
        shadow.position = (*point[:2], point[2] - radius + 0.004 if ground is None else float(
            ground.height(point[0])) + 1.5e-3)

    def _draw_forces(self, frame: Frame, robot: Robot) -> None:
        arrows = []
        scale = WEIGHT_ARROW_LENGTH * robot.ball_radius / robot.weight if robot.weight else 0.0
        for contact in frame.contacts or ():
            size = scale * math.hypot(contact.force_x, contact.force_y)
            if size < 0.02 * robot.ball_radius:
                continue
            cut = min(1.0, ARROW_LENGTH_MAX * robot.ball_radius / size) * scale
            foot = np.array([contact.x - (frame.x or 0.0), 0.0, contact.y - (frame.y or 0.0)])
            arrows.append([foot, foot + [cut * contact.force_x, 0.0, cut * contact.force_y]])
        self._nodes['forces'].visible = bool(arrows)
        if arrows:
            self._nodes['forces'].points = np.array(arrows, dtype=np.float32)

    def _mesh(self, name: str, mesh: Mesh, colour: str, opacity: Optional[float] = None,
              flat: bool = False) -> Any:
        return self._scene.add_mesh_simple(
            name, mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32),
            color=rgb(colour), opacity=opacity, flat_shading=flat, side='double')

    def _build_robot(self, robot: Robot) -> None:
        self._new_frame('place')
        self._nodes.pop('pendulum', None)
        self._robot, radius = robot, robot.ball_radius
        self._nodes['ball'] = self._scene.add_frame('/world/place/ball', show_axes=False)
        self._scene.add_icosphere('/world/place/ball/shell', radius, rgb(SKY), subdivisions=4,
                                  opacity=0.22, cast_shadow=False)
        thick = 0.028 * radius
        # Two quarters of the rim are dark, to show the rotation at any speed.
        for colour, first in ((BLUE, 0.0), (INK, 0.5 * math.pi)):
            self._mesh(f'/world/place/ball/rim_{first:.0f}', concatenate([
                quarter_ring(radius, thick, begin) for begin in (first, first + math.pi)]), colour)
        self._mesh('/world/place/ball/mark', concatenate([
            rod(radius, 0.35 * thick), bob(0.07 * radius, 0.05 * radius, 0.88 * radius)]), GREY)
        if robot.has_pendulum:
            self._nodes['pendulum'] = self._scene.add_frame(
                '/world/place/pendulum', show_axes=False)
            self._mesh('/world/place/pendulum/arm', concatenate([
                rod(robot.pendulum_length, 0.04 * radius),
                bob(0.16 * radius, 0.3 * radius, robot.pendulum_length),
                bob(0.06 * radius, 0.3 * radius, 0.0)]), VERMILION)
        self._nodes['shadow'] = self._mesh(
            '/world/shadow', creation.cylinder(SHADOW_RADIUS * radius, 1e-4), INK, opacity=0.25,
            flat=True)
        self._nodes['forces'] = self._scene.add_arrows(
            '/world/place/forces', np.zeros((1, 2, 3), np.float32), rgb(ORANGE),
            shaft_radius=0.035 * radius, head_radius=0.09 * radius, head_length=0.2 * radius,
            visible=False)

    def _new_frame(self, name: str) -> None:
        """Create a node of the world without children; remove that of the same name."""
        if name in self._nodes:
            self._nodes[name].remove()
        self._nodes[name] = self._scene.add_frame(f'/world/{name}', show_axes=False)

    def _label(self, name: str, text: str, position: Point, size: float,
               anchor: Any = 'bottom-center') -> None:
        self._scene.add_label(f'/world/ground/{name}', text, position=position, anchor=anchor,
                              font_size_mode='screen', font_screen_scale=size)

    def _build_floor(self, floor: Floor) -> None:
        self._floor, self._terrain = floor, None
        self._new_frame('ground')
        for part in floor_parts(floor):
            self._mesh(f'/world/ground/{part.name}', part.mesh, part.colour, part.opacity,
                       flat=True)
            if part.label:
                self._label(f'label_{part.name}', part.label, part.place, 0.7)

    def _build_ground(self, terrain: Optional[Terrain], x: float, radius: float) -> None:
        """Create the ground around a position, with a scale along it."""
        self._terrain, self._floor = terrain, None
        self._new_frame('ground')
        if terrain is None:
            self._reach = (-math.inf, math.inf)
            return
        ends = terrain.vertices[[0, -1], 0]
        left, right = min(ends[0], x) - GROUND_EXTENSION, max(ends[1], x) + GROUND_EXTENSION
        self._reach = (left + 0.3 * GROUND_EXTENSION, right - 0.3 * GROUND_EXTENSION)
        line, width = ground_line(terrain, left, right), 2.6 * radius
        near = ground_line(terrain, min(ends[0], x) - 1.0, max(ends[1], x) + 1.0)
        self._mesh('/world/ground/top', ribbon(line, -width, width), GROUND, flat=True)
        self._mesh('/world/ground/squares', tiles(near, width, SQUARE_SIZE), SQUARE_COLOUR,
                   flat=True)
        bottom = float(min(line[:, 1].min(), near[:, 1].min() - SECTION_DEPTH))
        front = ribbon(line, -width, -width)
        front.vertices[:len(line), 2] = bottom
        self._mesh('/world/ground/front', front, SECTION_COLOUR, flat=True)
        self._draw_scale(terrain, left, right, width)
        for number, face in enumerate(faces_of(terrain, radius, endless=False)):
            height = 1e3 * float(face[-1, 1] - face[0, 1])
            self._label(f'step_{number}', f'step {height:+.0f} mm',
                        (float(face[:, 0].mean()), -width, float(face[:, 1].max()) + 0.03), 0.8)

    def _draw_scale(self, terrain: Terrain, left: float, right: float, width: float) -> None:
        """Draw a tick every 0.1 m, and a line with its x coordinate every metre."""
        places = np.arange(math.ceil(10.0 * left), math.floor(10.0 * right) + 1) / 10.0
        heights = terrain.height(places) + 1e-3
        whole = np.isclose(places, np.round(places))
        ends = [[(x, -width, y), (x, width if metre else -0.85 * width, y)]
                for x, y, metre in zip(places, heights, whole)]
        self._scene.add_line_segments('/world/ground/scale', np.array(ends, dtype=np.float32),
                                      np.array(rgb(GREY)), thickness=0.003)
        for x, y in zip(places[whole], heights[whole]):
            self._label(f'x_{x:.0f}'.replace('-', 'm'), f'{x:.0f} m',
                        (float(x), -width, float(y) - 0.02), 0.7, 'top-center')
