# SPDX-License-Identifier: Apache-2.0
"""The robot on its ground, from the side, in three dimensions."""
import math
from typing import Any, List, Optional, Tuple

import numpy as np
import viser

from ballbot_ros.figures.canvas import BLUE, GREEN, GREY, INK, ORANGE, SKY, VERMILION
from ballbot_ros.figures.drawing import ground_line
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.results.faces import LEAST_HEIGHT, LEAST_SLOPE, SHORT
from ballbot_ros.view.frame import Frame
from ballbot_ros.view.shapes import bob, ground_front, ground_top, joined, Mesh, rod, tube, turned
from ballbot_ros.view.source import Source

# The ground is drawn so far beyond its ends, and beyond the ball where that goes farther [m].
BEYOND, DEPTH = 12.0, 1.5  # DEPTH below the lowest point
# A force as large as the weight is drawn this long, and none longer than that [ball radii].
WEIGHT, LONGEST = 0.8, 3.0
# Points of the path that are drawn, and how far apart they are at least [ball radii].
PATH, APART = 1500, 0.05
# The ground from above and where it is cut; light falls on them differently.
TOP, CUT = '#EAE6DF', '#F1E9DC'
Colour = Tuple[int, int, int]


def rgb(colour: str) -> Colour:
    """Return a colour such as #0072B2 as three numbers."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


class Stage:
    """
    Draws frames of a source.

    All that stands on the ground lies under one node, which moves below the camera: so the ball
    stays in sight, however the camera was turned by hand.

    Parameters
    ----------
    server : viser.ViserServer

    """

    def __init__(self, server: viser.ViserServer):
        """Set light and camera up."""
        self._scene = server.scene
        self._scene.set_up_direction('+z')
        self._scene.world_axes.visible = False
        # Shadows cost more than all the rest where there is no graphics card.
        self._scene.configure_default_lights(cast_shadow=False)
        camera = server.initial_camera
        camera.position, camera.look_at = (0.35, -3.1, 0.62), (0.35, 0.0, 0.14)
        camera.fov = math.radians(36.0)
        self._world = self._scene.add_frame('/world', show_axes=False)
        self._robot: Optional[Robot] = None
        self._terrain: Optional[Terrain] = None
        self._epoch = -1
        self._reach = (0.0, 0.0)
        self._path: List[Tuple[float, float, float]] = []
        self._path_since = -math.inf
        self._nodes: dict[str, Any] = {}
        self.follow = True

    def draw(self, source: Source, frame: Frame) -> None:
        """Draw a moment."""
        if source.robot is not self._robot:
            self._build_robot(source.robot)
        x = frame.x if frame.x is not None else 0.0
        if source.terrain is not self._terrain or not self._reach[0] < x < self._reach[1]:
            self._build_ground(source.terrain, x, source.robot.ball_radius)
        self._place(frame, source.robot)
        self._draw_forces(frame, source.robot)

    def draw_path(self, source: Source, frame: Frame) -> None:
        """Draw the way of the centre up to a moment; less often, because it takes longer."""
        if source.epoch != self._epoch:
            self._epoch, self._path, self._path_since = source.epoch, [], -math.inf
        apart = APART * source.robot.ball_radius
        for passed in source.history(self._path_since):
            self._path_since = passed.time
            if passed.x is None or passed.y is None:
                continue
            if not self._path or math.hypot(
                    passed.x - self._path[-1][1], passed.y - self._path[-1][2]) >= apart:
                self._path.append((passed.time, passed.x, passed.y))
        del self._path[:-PATH]
        shown = [(x, 0.0, y) for time, x, y in self._path if time <= frame.time]
        if frame.x is not None and frame.y is not None:
            shown.append((frame.x, 0.0, frame.y))
        ends = np.array(shown, dtype=np.float32).reshape(-1, 3)
        pairs = np.stack([ends[:-1], ends[1:]], axis=1) if len(ends) > 1 else np.zeros(
            (1, 2, 3), np.float32)
        if 'path' in self._nodes:
            self._nodes['path'].points = pairs
        else:
            self._nodes['path'] = self._scene.add_line_segments(
                '/world/path', pairs, np.array(rgb(GREEN)),
                thickness=0.03 * source.robot.ball_radius)

    def _place(self, frame: Frame, robot: Robot) -> None:
        """Move ball and pendulum to where they are, and the world below the camera."""
        known = frame.x is not None and frame.y is not None
        place = self._nodes['place']
        if place.visible is not known:
            place.visible = known
        if frame.x is None or frame.y is None:
            return
        place.position = (frame.x, 0.0, frame.y)
        if frame.ball_angle is not None:
            self._nodes['ball'].wxyz = turned(frame.ball_angle)
        if 'pendulum' in self._nodes and frame.pendulum_angle is not None:
            self._nodes['pendulum'].wxyz = turned(frame.pendulum_angle)
        if self.follow:
            self._world.position = (-frame.x, 0.0, robot.ball_radius - frame.y)

    def _draw_forces(self, frame: Frame, robot: Robot) -> None:
        """Draw the forces of the ground, from below into the point of contact."""
        arrows = []
        scale = WEIGHT * robot.ball_radius / robot.weight if robot.weight else 0.0
        for contact in frame.contacts or ():
            size = scale * math.hypot(contact.force_x, contact.force_y)
            if size < 0.02 * robot.ball_radius:
                continue
            cut = min(1.0, LONGEST * robot.ball_radius / size) * scale
            foot = np.array([contact.x - (frame.x or 0.0), 0.0, contact.y - (frame.y or 0.0)])
            arrows.append([foot, foot + [cut * contact.force_x, 0.0, cut * contact.force_y]])
        node = self._nodes['forces']
        if node.visible is not bool(arrows):
            node.visible = bool(arrows)
        if arrows:
            node.points = np.array(arrows, dtype=np.float32)

    def _mesh(self, name: str, mesh: Mesh, colour: str, opacity: Optional[float] = None,
              flat: bool = False) -> Any:
        return self._scene.add_mesh_simple(
            name, mesh.points.astype(np.float32), mesh.triangles.astype(np.uint32),
            color=rgb(colour), opacity=opacity, flat_shading=flat, side='double')

    def _build_robot(self, robot: Robot) -> None:
        """Make ball, mark and pendulum."""
        if 'place' in self._nodes:
            self._nodes['place'].remove()
        for name in ('place', 'ball', 'pendulum', 'forces'):
            self._nodes.pop(name, None)
        self._robot, radius = robot, robot.ball_radius
        self._nodes['place'] = self._scene.add_frame('/world/place', show_axes=False)
        self._nodes['ball'] = self._scene.add_frame('/world/place/ball', show_axes=False)
        self._scene.add_icosphere('/world/place/ball/shell', radius, rgb(SKY), subdivisions=4,
                                  opacity=0.22, cast_shadow=False)
        thick, quarter = 0.028 * radius, 0.5 * math.pi
        # Two quarters of the rim are dark: that it rolls is seen at any speed.
        for colour, first in ((BLUE, 0.0), (INK, quarter)):
            self._mesh(f'/world/place/ball/rim_{first:.0f}', joined(
                tube(radius, thick, begin, begin + quarter)
                for begin in (first, first + math.pi)), colour)
        self._mesh('/world/place/ball/mark', joined([
            rod(radius, 0.35 * thick), bob(0.07 * radius, 0.05 * radius, 0.88 * radius)]), GREY)
        if robot.has_pendulum:
            self._nodes['pendulum'] = self._scene.add_frame(
                '/world/place/pendulum', show_axes=False)
            self._mesh('/world/place/pendulum/arm', joined([
                rod(robot.pendulum_length, 0.04 * radius),
                bob(0.16 * radius, 0.3 * radius, robot.pendulum_length),
                bob(0.06 * radius, 0.3 * radius, 0.0)]), VERMILION)
        self._nodes['forces'] = self._scene.add_arrows(
            '/world/place/forces', np.zeros((1, 2, 3), np.float32), rgb(ORANGE),
            shaft_radius=0.035 * radius, head_radius=0.09 * radius, head_length=0.2 * radius,
            visible=False)

    def _build_ground(self, terrain: Optional[Terrain], x: float, radius: float) -> None:
        """Make the ground about a place, with a scale along it."""
        self._terrain = terrain
        if 'ground' in self._nodes:
            self._nodes.pop('ground').remove()
        if terrain is None:
            self._reach = (-math.inf, math.inf)
            return
        ends = terrain.vertices[[0, -1], 0]
        left, right = min(ends[0], x) - BEYOND, max(ends[1], x) + BEYOND
        self._reach = (left + 0.3 * BEYOND, right - 0.3 * BEYOND)
        self._nodes['ground'] = self._scene.add_frame('/world/ground', show_axes=False)
        line, width = ground_line(terrain, left, right), 2.6 * radius
        near = ground_line(terrain, min(ends[0], x) - 1.0, max(ends[1], x) + 1.0)
        self._mesh('/world/ground/top', ground_top(line, width), TOP, flat=True)
        self._mesh('/world/ground/front', ground_front(
            line, width, float(min(line[:, 1].min(), near[:, 1].min() - DEPTH))), CUT, flat=True)
        self._draw_scale(terrain, left, right, width)
        for number, face in enumerate(terrain.faces(
                LEAST_SLOPE, LEAST_HEIGHT, SHORT * radius, endless=False)):
            height = 1e3 * float(face[-1, 1] - face[0, 1])
            self._scene.add_label(
                f'/world/ground/step_{number}', f'step {height:+.0f} mm',
                position=(float(face[:, 0].mean()), -width, float(face[:, 1].max()) + 0.03),
                anchor='bottom-center', font_size_mode='screen', font_screen_scale=0.8)

    def _draw_scale(self, terrain: Terrain, left: float, right: float, width: float) -> None:
        """Draw a line across the ground every tenth of a metre, and x every metre."""
        places = np.arange(math.ceil(10.0 * left), math.floor(10.0 * right) + 1) / 10.0
        heights = terrain.height(places) + 1e-3
        whole = np.isclose(places, np.round(places))
        ends = [[(x, -width, y), (x, width if metre else -0.8 * width, y)]
                for x, y, metre in zip(places, heights, whole)]
        self._scene.add_line_segments('/world/ground/scale', np.array(ends, dtype=np.float32),
                                      np.array(rgb(GREY)), thickness=0.003)
        for x, y in zip(places[whole], heights[whole]):
            self._scene.add_label(
                f'/world/ground/x_{x:.0f}'.replace('-', 'm'), f'{x:.0f} m',
                position=(float(x), -width, float(y) - 0.02), anchor='top-center',
                font_size_mode='screen', font_screen_scale=0.7)
