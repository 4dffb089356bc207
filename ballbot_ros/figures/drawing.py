# SPDX-License-Identifier: Apache-2.0
"""The ball and the ground as shapes, in metres."""
import math
from typing import Any

from matplotlib.patches import Circle
import numpy as np

from ballbot_ros.figures import canvas
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.terrain import Array, Terrain

# Colours by meaning; legends are made from these.
TURNING, PENDULUM, PATH, FORCE = canvas.GREY, canvas.VERMILION, canvas.GREEN, canvas.PURPLE
MEANING = {TURNING: 'turns with the ball', PENDULUM: 'pendulum', PATH: 'path of the centre',
           FORCE: 'ground contact force'}


def legend(pendulum: bool = True, force: bool = False) -> str:
    """Return the legend text of the drawn colours."""
    drawn = {PENDULUM: pendulum, FORCE: force}
    return '; '.join(f'{canvas.NAMES[colour]}: {meaning}' for colour, meaning in MEANING.items()
                     if drawn.get(colour, True))


def ground_line(terrain: Terrain, left: float, right: float) -> Array:
    """Return the vertices of a terrain from x = `left` to `right` [m], ends included."""
    inside = terrain.vertices[
        (terrain.vertices[:, 0] > left) & (terrain.vertices[:, 0] < right)]
    ends = [[x, float(terrain.height(x))] for x in (left, right)]
    return np.vstack([ends[:1], inside, ends[1:]])


def draw_ground(axes: Any, terrain: Terrain, left: float, right: float,
                bottom: float) -> None:
    """Draw a terrain with the solid below it, down to y = `bottom` [m]."""
    line = ground_line(terrain, left, right)
    axes.fill_between(line[:, 0], line[:, 1], bottom, color=canvas.SOIL, lw=0, zorder=1)
    axes.plot(line[:, 0], line[:, 1], color=canvas.INK, lw=1.2, zorder=2.5,
              solid_joinstyle='miter')


def draw_ball(axes: Any, robot: Robot, x: float, y: float, ball_angle: float,
              pendulum_angle: float, strength: float, order: float = 3.0) -> None:
    """
    Draw the ball at its centre [m] with a spoke that turns with it, and the pendulum inside.

    The angles are theta1 and the absolute pendulum angle [rad]; both point down at 0, so that the
    angle from spoke to pendulum is theta2.  `strength` is the opacity, 1 for the present position
    and less for earlier ones; `order` is the lowest z-order of the drawing.
    """
    radius = robot.ball_radius
    axes.add_patch(Circle((x, y), radius, facecolor=canvas.SKY, alpha=0.16 * strength, lw=0,
                          zorder=order))
    axes.add_patch(Circle((x, y), radius, fill=False, edgecolor=canvas.BLUE,
                          alpha=strength, lw=0.7 + 0.9 * strength, zorder=order + 0.1))
    rim_x, rim_y = radius * math.sin(ball_angle), -radius * math.cos(ball_angle)
    axes.plot([x, x + rim_x], [y, y + rim_y], color=TURNING, lw=0.9, alpha=strength,
              zorder=order + 0.2, solid_capstyle='butt')
    axes.add_patch(Circle((x + 0.94 * rim_x, y + 0.94 * rim_y), 0.06 * radius, lw=0,
                          facecolor=TURNING, alpha=strength, zorder=order + 0.2))
    if robot.has_pendulum:
        bob_x = x + robot.pendulum_length * math.sin(pendulum_angle)
        bob_y = y - robot.pendulum_length * math.cos(pendulum_angle)
        axes.plot([x, bob_x], [y, bob_y], color=PENDULUM, alpha=strength,
                  lw=1.0 + 1.2 * strength, zorder=order + 0.3, solid_capstyle='round')
        axes.add_patch(Circle((bob_x, bob_y), 0.11 * radius, lw=0, alpha=strength,
                              facecolor=PENDULUM, zorder=order + 0.3))
