# SPDX-License-Identifier: Apache-2.0
"""Redraw the pictures of the documentation: ``python scripts/draw_docs.py [FOLDER]``."""
import math
from pathlib import Path
import sys

from matplotlib.patches import Arc, Circle, FancyArrowPatch, Polygon
from PIL import Image

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / 'scripts')]

from stages import path_argument  # noqa: E402, I100, I201

from ballbot_ros.decision import nominal_knowledge  # noqa: E402
from ballbot_ros.figures import canvas  # noqa: E402
from ballbot_ros.figures.route import route_figure  # noqa: E402
from ballbot_ros.figures.run import animate, save, strip  # noqa: E402
from ballbot_ros.floors import load_floor  # noqa: E402
from ballbot_ros.navigation import RoutePlanner  # noqa: E402
from ballbot_ros.paper.figures import FIGURES  # noqa: E402
from ballbot_ros.physics import load_scene  # noqa: E402

# Proportions of the drawing, in ball radii; the penetration is exaggerated.
RADIUS, STEP, DEEP, PENDULUM = 1.0, 0.42, 0.07, 0.60
BALL_ANGLE, PENDULUM_ANGLE = math.radians(-58.0), math.radians(42.0)
SMALL = 8.5

# Figures of `ballbot figures` that docs/step_height.md shows.
IN_DOCS = ('fig5', 'fig6', 'fig8', 'tornado', 'design', 'slope')


def place(angle, length, centre=(0.0, RADIUS - DEEP)):
    """Return the point at an angle from hanging down, counter-clockwise, about the centre."""
    return (centre[0] + length * math.sin(angle), centre[1] - length * math.cos(angle))


def arrow(axes, start, end, colour, width=1.6, style='-|>', bend=0.0):
    """Draw an arrow."""
    axes.add_patch(FancyArrowPatch(
        start, end, arrowstyle=style, mutation_scale=12, color=colour, lw=width, zorder=8,
        shrinkA=0, shrinkB=0, connectionstyle=f'arc3,rad={bend}'))


def turn(axes, centre, radius, begin, end, colour, width=1.3):
    """Draw an arc with an arrowhead between two angles, measured from hanging down."""
    low, high = sorted((begin, end))
    axes.add_patch(Arc(centre, 2 * radius, 2 * radius, color=colour, lw=width, zorder=7,
                       theta1=math.degrees(low) - 90.0, theta2=math.degrees(high) - 90.0))
    sign = 1.0 if end > begin else -1.0
    tip = place(end, radius, centre)
    back = place(end - sign * 0.10 / radius, radius, centre)
    along = (tip[0] - back[0], tip[1] - back[1])
    across = (-0.35 * along[1], 0.35 * along[0])
    axes.add_patch(Polygon([tip, (back[0] + across[0], back[1] + across[1]),
                            (back[0] - across[0], back[1] - across[1])],
                           color=colour, lw=0, zorder=7))


def draw_ground_and_axes(axes, edge_x):
    """Draw floor, step and the axes x and y."""
    right = 2.75
    outline = [(-2.3, -0.5), (-2.3, 0.0), (edge_x, 0.0), (edge_x, STEP), (right, STEP),
               (right, -0.5)]
    axes.add_patch(Polygon(outline, color=canvas.SOIL, lw=0))
    axes.plot(*zip(*outline[1:-1]), color=canvas.INK, lw=1.4, zorder=5,
              solid_joinstyle='miter')
    origin = (-2.05, 0.0)
    arrow(axes, origin, (-1.45, 0.0), canvas.INK)
    arrow(axes, origin, (-2.05, 0.6), canvas.INK)
    axes.text(-1.45, -0.06, '$x$', ha='center', va='top', fontsize=11)
    axes.text(-2.12, 0.58, '$y$', ha='right', va='center', fontsize=11)
    axes.text(edge_x + 0.5, 0.12, 'solid', fontsize=SMALL, color=canvas.GREY)


def draw_ball_and_angles(axes, centre):
    """Draw ball, spoke, pendulum and the angles between them."""
    axes.add_patch(Circle(centre, RADIUS, facecolor=canvas.SKY, alpha=0.14, lw=0, zorder=3))
    axes.add_patch(Circle(centre, RADIUS, fill=False, edgecolor=canvas.BLUE, lw=1.8, zorder=6))
    axes.plot(*zip(centre, place(0.0, 0.90)), color=canvas.INK, lw=0.9, ls=(0, (4, 3)), zorder=4)
    rim = place(BALL_ANGLE, RADIUS)
    axes.plot(*zip(centre, rim), color=canvas.GREY, lw=1.6, zorder=6)
    axes.add_patch(Circle(place(BALL_ANGLE, 0.95), 0.05, color=canvas.GREY, lw=0, zorder=6))
    axes.text(rim[0] - 0.10, rim[1] - 0.03, 'line fixed\nin the ball', fontsize=SMALL,
              ha='right', va='center', color=canvas.GREY)
    bob = place(PENDULUM_ANGLE, PENDULUM)
    axes.plot(*zip(centre, bob), color=canvas.VERMILION, lw=2.4, zorder=7)
    axes.add_patch(Circle(bob, 0.085, color=canvas.VERMILION, lw=0, zorder=7))
    middle = place(PENDULUM_ANGLE, 0.5 * PENDULUM)
    axes.text(middle[0] + 0.05, middle[1] + 0.04, '$e$', color=canvas.VERMILION, fontsize=11)
    axes.text(bob[0] + 0.0, bob[1] - 0.12, '$M_2, J_2$', color=canvas.VERMILION, fontsize=9,
              ha='center', va='top', zorder=9)
    axes.text(centre[0] - 0.42, centre[1] + 0.42, '$M_1, J_1$', color=canvas.BLUE, fontsize=9,
              ha='center')
    turn(axes, centre, 0.80, 0.0, BALL_ANGLE, canvas.GREY)
    turn(axes, centre, 0.28, BALL_ANGLE, PENDULUM_ANGLE, canvas.GREEN)
    turn(axes, centre, 0.50, 0.0, PENDULUM_ANGLE, canvas.VERMILION)
    for angle, radius, text, colour in (
            (BALL_ANGLE / 2, 0.66, r'$\theta_1$', canvas.GREY),
            (-0.35, 0.38, r'$\theta_2$', canvas.GREEN),
            (PENDULUM_ANGLE / 2, 0.60, r'$\varphi$', canvas.VERMILION)):
        axes.text(*place(angle, radius), text, color=colour, fontsize=11, ha='center',
                  va='center', zorder=9)
    axes.add_patch(Circle(centre, 0.03, color=canvas.INK, zorder=9, lw=0))


def draw_contacts(axes, centre, edge_x):
    """Draw both contact vectors, the tangent and the penetration at the edge."""
    edge = (edge_x, STEP)
    distance = math.hypot(centre[0] - edge[0], centre[1] - edge[1])
    normal = ((centre[0] - edge[0]) / distance, (centre[1] - edge[1]) / distance)
    arrow(axes, edge, (edge[0] + 0.52 * normal[0], edge[1] + 0.52 * normal[1]), canvas.PURPLE,
          2.0)
    tangent = (normal[1], -normal[0])
    arrow(axes, edge, (edge[0] + 0.52 * tangent[0], edge[1] + 0.52 * tangent[1]),
          canvas.PURPLE, 2.0)
    for name, along, aside in (('$\\mathbf{n}$', normal, 0.05), ('$\\mathbf{t}$', tangent, -0.06)):
        axes.text(edge[0] + 0.36 * along[0] + aside, edge[1] + 0.36 * along[1] + 0.09, name,
                  fontsize=11, color=canvas.PURPLE, ha='center', va='center', zorder=9)
    axes.text(1.24, 0.80, '$\\mathbf{n}$: normal, along $\\mathbf{d}$ from\n'
              'the contact to the centre\n'
              '$\\mathbf{t} = (n_y, -n_x)$: tangent,\npositive slip and friction',
              fontsize=SMALL, color=canvas.PURPLE, va='center', linespacing=1.35)
    axes.annotate('penetration $R - |\\mathbf{d}|$', (edge[0] + 0.02, edge[1] - 0.02),
                  (edge_x + 0.50, 0.29), fontsize=SMALL, color=canvas.INK, va='center',
                  zorder=9, arrowprops={'arrowstyle': '-', 'color': canvas.INK, 'lw': 0.7})


def draw_rolling(axes, centre):
    """Draw the positive sense of angles, and the effect of rolling forward."""
    corner = (-1.75, 1.75)
    turn(axes, corner, 0.20, math.radians(-60.0), math.radians(220.0), canvas.INK)
    axes.text(corner[0], corner[1], '+', ha='center', va='center', fontsize=12)
    axes.text(corner[0], corner[1] - 0.30, 'angles and rates:\ncounter-clockwise positive',
              ha='center', va='top', fontsize=SMALL)
    turn(axes, centre, 1.14, math.radians(205.0), math.radians(135.0), canvas.BLUE, 1.8)
    axes.text(0.93, 1.93, 'rolling forward turns\nthe ball clockwise:\n'
              r'$\dot\theta_1 = -v/R < 0$', fontsize=9, color=canvas.BLUE, va='center')
    arrow(axes, centre, (0.55, centre[1]), canvas.BLUE, 2.0)
    axes.text(0.58, centre[1] + 0.06, '$v$', color=canvas.BLUE, fontsize=11, va='bottom')


def conventions():
    """Return the figure of the signs of all angles and forces."""
    centre = (0.0, RADIUS - DEEP)
    away = RADIUS - DEEP
    edge_x = math.sqrt(away**2 - (centre[1] - STEP)**2)
    with canvas.drawing(8.0, 4.75, **{'mathtext.fontset': 'dejavusans'}) as figure:
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_aspect('equal')
        axes.set_xlim(-2.45, 2.75)
        axes.set_ylim(-0.5, 2.5875)
        axes.axis('off')
        draw_ground_and_axes(axes, edge_x)
        draw_ball_and_angles(axes, centre)
        draw_contacts(axes, centre, edge_x)
        draw_rolling(axes, centre)
        axes.text(-2.3, 2.38, r'$\theta_1$: ball angle (here negative)      '
                  r'$\theta_2$: pendulum joint      '
                  r'$\varphi = \theta_1 + \theta_2$: pendulum, from hanging down, + towards +x',
                  fontsize=9)
    return figure


def save_small(figure, path):
    """Write a PNG of a third of the size, with no difference to be seen."""
    save(figure, path)
    Image.open(path).convert('RGB').quantize(96, dither=Image.Dither.NONE).save(
        path, optimize=True)


def main():
    """Draw all into the folder on the command line, docs/figures by default."""
    folder = path_argument('folder', ROOT / 'docs' / 'figures')
    save_small(conventions(), folder / 'conventions.png')
    crossing = load_scene('fig7_bottom').simulate()
    save(strip(crossing, 'fig7_bottom'), folder / 'crossing.png')
    animate(crossing, folder / 'crossing.gif', 'fig7_bottom', playback=0.4)
    for name in ('on_timeout', 'turning', 'oblique', 'contact_law'):
        save_small(FIGURES[name](), folder / f'{name}.png')
    planner = RoutePlanner(load_floor('apartment'), nominal_knowledge())
    save_small(route_figure(planner.floor, planner.route((1.7, 1.4), (8.1, 5.5)),
                            planner.ball_radius), folder / 'route.png')
    for name in IN_DOCS:
        save_small(FIGURES[name](), folder / f'step_{name}.png')


if __name__ == '__main__':
    main()
