# SPDX-License-Identifier: Apache-2.0
"""Step height against speed: curves of models, and rolls with their outcomes."""
import math
from typing import Any, Sequence

from matplotlib.figure import Figure

from ballbot_ros.figures import canvas
from ballbot_ros.paper.cases import Case, holding, LEVEL, SPEEDS, step_heights
from ballbot_ros.paper.test_bench import Bench, Roll, RunUp
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.studies.comparators import quasi_static


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


def draw_curve(axes: Any, label: str, speeds: Array, heights: Array, colour: str = canvas.BLUE,
               style: Any = '-', width: float = 1.6) -> None:
    """Draw heights [m] against speeds [m/s]."""
    axes.plot(speeds, 1e3 * heights, color=colour, ls=style, lw=width, label=label, zorder=3)


def draw_quasi_static(axes: Any, robot: Robot) -> None:
    """Draw eq. (1), which does not depend on the speed."""
    axes.axhline(1e3 * quasi_static(robot), color=canvas.GREY, ls=':', lw=1.6,
                 label='quasi-static, eq. (1)', zorder=3)


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


def bench_figure(robot: Robot, bench: Bench, rolls: Sequence[Roll], title: str) -> Figure:
    """Return the plot of a test: each roll, and reference curves."""
    if isinstance(bench, RunUp):
        cases = [('pendulum down', holding(robot, 0.0), '-'),
                 ('pendulum level', holding(robot, LEVEL), '--')]
    else:
        cases = [('pendulum free, hanging at the touch' if robot.has_pendulum else 'full model',
                  Case(robot), '-')]
    fastest = max((roll.measured_speed for roll in rolls
                   if math.isfinite(roll.measured_speed)), default=1.0)
    top = max((roll.step_height for roll in rolls), default=0.05)
    with canvas.panels(6.4, 4.6) as figure:
        axes = height_axes(figure, (0.10, 0.115, 0.87, 0.79), title, 1.12 * top,
                           0.1 * math.ceil(10.5 * fastest))
        axes.text(1.0, 1.02, canvas.RESIMULATED, transform=axes.transAxes, ha='right',
                  fontsize=7.5, color=canvas.GREY)
        axes.set_xlabel('speed by the sensors; of curves: speed at the touch [m/s]')
        for label, case, style in cases:
            draw_curve(axes, f'{label}, simulated', SPEEDS, step_heights(case, SPEEDS),
                       style=style)
        if robot.has_pendulum:
            draw_quasi_static(axes, robot)
        draw_rolls(axes, rolls)
        place_legend(axes)
    return figure
