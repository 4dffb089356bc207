# SPDX-License-Identifier: Apache-2.0
"""Step height against speed: curves of models, and rolls with their outcomes."""
import math
from typing import Any, Iterable, NamedTuple, Sequence

from matplotlib.figure import Figure
import numpy as np

from ballbot_ros.figures import canvas
from ballbot_ros.paper.cases import Case, holding, LEVEL, SPEEDS, step_heights
from ballbot_ros.paper.test_bench import Bench, Roll, RunUp
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.studies.comparators import quasi_static


class HeightLine(NamedTuple):
    """Height against speed, as a line."""

    label: str
    speeds: Array  # [m/s]
    heights: Array  # [m]
    colour: str = canvas.BLUE
    style: Any = '-'
    width: float = 1.6


def height_axes(figure: Figure, box: tuple[float, float, float, float], title: str,
                highest: float, fastest: float, slowest: float = 0.0) -> Any:
    """
    Add axes of height, up to `highest` [m], against speed [m/s].

    The box is left, bottom, width and height, as fractions of the figure.
    """
    axes = figure.add_axes(box)
    axes.set(xlim=(slowest, fastest), ylim=(0.0, 1e3 * highest), xlabel='collision speed [m/s]',
             ylabel='step height [mm]', title=title)
    return axes


def draw_curves(axes: Any, curves: Iterable[HeightLine]) -> None:
    """Draw height lines in mm."""
    for curve in curves:
        axes.plot(curve.speeds, 1e3 * curve.heights, color=curve.colour, ls=curve.style,
                  lw=curve.width, label=curve.label, zorder=3)


def draw_rolls(axes: Any, rolls: Sequence[Roll]) -> None:
    """Draw rolls at their measured speeds, with passes slightly above no-passes."""
    for passed, marker, colour, label, up in ((True, 'o', canvas.GREEN, 'passed', 0.35),
                                              (False, 'x', canvas.VERMILION, 'not passed', -0.35)):
        chosen = [roll for roll in rolls if roll.passed == passed]
        axes.plot([roll.measured_speed for roll in chosen],
                  [1e3 * roll.step_height + up for roll in chosen], marker, ms=3.6, mew=0.9,
                  mfc='none', color=colour, label=f'{label}, virtual bench', zorder=4)


def place_legend(axes: Any) -> None:
    """Add a translucent legend without a border, in front of the curves."""
    axes.legend(loc='upper left', frameon=True, framealpha=0.9, edgecolor='none',
                handlelength=2.2)


def bench_curves(robot: Robot, bench: Bench) -> list[HeightLine]:
    """Return the reference curves for the rolls of a bench."""
    if isinstance(bench, RunUp):
        cases = [('pendulum down', holding(robot, 0.0), '-'),
                 ('pendulum level', holding(robot, LEVEL), '--')]
    else:
        cases = [('pendulum free, hanging at the touch' if robot.has_pendulum else 'full model',
                  Case(robot), '-')]
    curves = [HeightLine(f'{label}, simulated', SPEEDS, step_heights(case, SPEEDS),
                         style=style) for label, case, style in cases]
    if robot.has_pendulum:
        curves.append(quasi_static_curve(robot))
    return curves


def quasi_static_curve(robot: Robot) -> HeightLine:
    """Return the line of eq. (1), which does not depend on the speed."""
    return HeightLine('quasi-static, eq. (1)', np.array([0.0, 10.0]),
                      np.full(2, quasi_static(robot)), canvas.GREY, ':')


def bench_figure(rolls: Sequence[Roll], curves: Sequence[HeightLine], title: str) -> Figure:
    """Return the plot of a test: each roll, and reference curves."""
    fastest = max((roll.measured_speed for roll in rolls
                   if math.isfinite(roll.measured_speed)), default=1.0)
    top = max((roll.step_height for roll in rolls), default=0.05)
    with canvas.panels(6.4, 4.6) as figure:
        axes = height_axes(figure, (0.10, 0.115, 0.87, 0.79), title, 1.12 * top,
                           0.1 * math.ceil(10.5 * fastest))
        axes.text(1.0, 1.02, canvas.RESIMULATED, transform=axes.transAxes, ha='right',
                  fontsize=7.5, color=canvas.GREY)
        axes.set_xlabel('speed by the sensors; of curves: speed at the touch [m/s]')
        draw_curves(axes, curves)
        draw_rolls(axes, rolls)
        place_legend(axes)
    return figure
