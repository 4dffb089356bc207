# SPDX-License-Identifier: Apache-2.0
"""Figures of a floor, and of a route on it."""
from contextlib import contextmanager
from typing import Any, Iterator, Sequence, Tuple

from matplotlib.figure import Figure
from matplotlib.patches import Circle
import numpy as np

from ballbot_ros.figures.canvas import (
    BLUE, drawing, GREEN, GREY, INK, ORANGE, PALE, PURPLE, SKY, SOIL, VERMILION)
from ballbot_ros.floors.floor import Floor, FREE, Point, UNKNOWN
from ballbot_ros.navigation import Route

Points = Sequence[Point]

COLOURS = {'step': VERMILION, 'threshold': ORANGE, 'cord': ORANGE, 'drop': INK, 'stairs': INK,
           'carpet': SOIL, 'level': SKY, 'ramp': SKY, 'friction': PURPLE, 'keep_out': GREY}


def route_figure(floor: Floor, route: Route, radius: float) -> Figure:
    """Return a plan of a floor with a route, and the ball of a radius [m] along it."""
    title = f'{floor.name}: {route.time:.0f} s, probability {route.probability:.2f}'
    with _plan_of(floor, title) as (figure, axes):
        for segment in route.segments:
            points = np.array(segment.points)
            if segment.feature is None:
                axes.plot(*points.T, color=BLUE, linewidth=1.6)
            else:
                axes.annotate('', points[-1], points[0], arrowprops={
                    'arrowstyle': '-|>', 'color': GREEN, 'linewidth': 2.2, 'shrinkA': 0,
                    'shrinkB': 0})
                axes.add_patch(
                    Circle(tuple(points[0]), radius, facecolor='none', edgecolor=GREEN))
        for point in (*route.points[:1], *route.points[-1:]):
            _draw_ball(axes, point, radius)
    return figure


def driven_figure(floor: Floor, title: str, plans: Sequence[Points], driven: Points,
                  goals: Points, radius: float) -> Figure:
    """Return a plan of a floor with the planned paths and the driven path; positions in m."""
    with _plan_of(floor, title) as (figure, axes):
        for plan in plans:
            axes.plot(*np.array(plan).T, color=BLUE, linewidth=1.0, linestyle='--',
                      label='planned' if plan is plans[0] else None)
        axes.plot(*np.array(driven).T, color=VERMILION, linewidth=1.6, label='driven')
        for point in (driven[0], *goals):
            _draw_ball(axes, point, radius)
        axes.legend(loc='upper left', fontsize=7)
    return figure


@contextmanager
def _plan_of(floor: Floor, title: str) -> Iterator[Tuple[Figure, Any]]:
    left, right, bottom, top = floor.extent
    width = 7.0
    with drawing(width, 1.2 + width * (top - bottom) / (right - left)) as figure:
        axes = figure.add_subplot()
        shades = np.where(floor.cells == FREE, 0.0, np.where(floor.cells == UNKNOWN, 0.4, 1.0))
        axes.imshow(shades, cmap='Greys', vmin=0.0, vmax=1.3, origin='lower',
                    extent=floor.extent, interpolation='nearest')
        for feature in floor.features:
            _draw_feature(axes, feature)
        yield figure, axes
        axes.set(xlim=(left, right), ylim=(bottom, top), aspect='equal', xlabel='x [m]',
                 ylabel='y [m]')
        axes.set_title(title, loc='left')
        figure.tight_layout()


def _draw_feature(axes: Any, feature: Any) -> None:
    colour = COLOURS[feature.kind]
    points = np.array(feature.polygon or feature.line)
    if feature.polygon:
        axes.fill(*points.T, facecolor=colour, edgecolor=colour,
                  alpha=0.5 if feature.kind != 'stairs' else 0.8, linewidth=1.0)
    else:
        axes.plot(*points.T, color=colour, linewidth=2.5)
    if feature.kind == 'ramp':
        axes.annotate('', feature.line[-1], feature.line[0], arrowprops={
            'arrowstyle': '->', 'color': INK, 'linewidth': 0.8})
    middle = points.mean(axis=0)
    text = feature.label if not feature.name or not feature.height else \
        f'{feature.name}\n{1e3 * feature.height:.0f} mm'
    axes.annotate(text, middle, xytext=(0, 5), textcoords='offset points', ha='center',
                  va='bottom', fontsize=6.5, color=INK,
                  bbox={'facecolor': 'white', 'alpha': 0.7, 'edgecolor': 'none', 'pad': 0.6})


def _draw_ball(axes: Any, place: Point, radius: float) -> None:
    axes.add_patch(Circle(place, radius, facecolor=PALE, edgecolor=BLUE, linewidth=1.4))
