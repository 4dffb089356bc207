# SPDX-License-Identifier: Apache-2.0
"""
The figures of the paper, re-simulated: 5 (both halves), 6, 7 and 8.

Nothing in them is digitised from print.  Only three points of the paper are printed as numbers;
they are marked as such.
"""
from typing import Any, Callable, Optional, Sequence

import matplotlib
from matplotlib.figure import Figure
import numpy as np

from ballbot_ros.crossing import max_step_heights, rolling
from ballbot_ros.figures import canvas
from ballbot_ros.figures.film import stacked
from ballbot_ros.figures.heights import (
    draw_curves, draw_heading, draw_rolls, height_axes, HeightCurve, place_legend,
    quasi_static_curve, RESIMULATED)
from ballbot_ros.physics import load_robot, load_scene
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.studies import comparators, mujoco_check
from ballbot_ros.studies.cases import ACCURACY, Case, holding, LEVEL, SPEEDS, step_heights
from ballbot_ros.studies.procedure import find_thresholds, run_tests
from ballbot_ros.studies.test_bench import Bench, Ramp, Roll, RunUp

Progress = Optional[Callable[[float], None]]

# The three crossings of Fig. 7: speed [m/s], step [m] and scene, from top to bottom.
PRINTED = ((0.76, 0.021, 'fig7_top'), (0.78, 0.031, 'fig7_middle'),
           (1.09, 0.056, 'fig7_bottom'))

# Steps and time step of the twin: its own contact costs a hundred times ours.
TWIN_SPEEDS, TWIN_STEP = SPEEDS[::4], 2e-4


def figure_5(progress: Progress = None) -> Figure:
    """Show free rolling: curves of both balls, and what the virtual bench measures."""
    shell, gimball = load_robot('shellball'), load_robot('gimball')
    tell = _parts(progress, 4)
    with matplotlib.rc_context(dict(canvas.STYLE)):
        figure = canvas.new_figure(10.0, 4.6)
        for left, robot, highest in ((0.065, shell, 0.045), (0.555, gimball, 0.062)):
            axes = height_axes(figure, (left, 0.115, 0.43, 0.76), robot.name, highest, 1.4)
            label = 'pendulum free, simulated' if robot.has_pendulum else 'simulated'
            axes.set_xlabel('collision speed; of the rolls: by the sensors [m/s]')
            draw_curves(axes, [HeightCurve(label, SPEEDS, step_heights(Case(robot), SPEEDS))])
            if robot.has_pendulum:
                draw_curves(axes, [quasi_static_curve(robot)])
            tell()
            rolls = _rolls(Ramp(), robot, highest)
            draw_rolls(axes, rolls)
            _draw_true_thresholds(axes, rolls)
            tell()
            place_legend(axes)
        draw_heading(figure, 'Fig. 5  Free rolling into a step')
    return figure


def figure_6(progress: Progress = None) -> Figure:
    """Show the driven ball: orientations of the pendulum, the three printed points."""
    robot = load_robot('gimball')
    tell = _parts(progress, 4)
    with matplotlib.rc_context(dict(canvas.STYLE)):
        figure = canvas.new_figure(8.2, 5.6)
        axes = height_axes(figure, (0.085, 0.095, 0.895, 0.815), '', 0.085, 1.3)
        down, level, up = (step_heights(holding(robot, angle), SPEEDS)
                           for angle in (0.0, LEVEL, 2.0 * LEVEL))
        tell()
        driven = np.array([item.height for item in max_step_heights(
            robot, SPEEDS.tolist(), rolling(robot), accuracy=ACCURACY)])
        tell()
        energy = np.array([comparators.energy(robot, speed) for speed in SPEEDS.tolist()])
        cubic = np.array(np.polyval(np.polyfit(SPEEDS, level, 3), SPEEDS), dtype=np.float64)
        draw_curves(axes, [
            HeightCurve('energy is kept', SPEEDS, energy, canvas.GREY, '-.', 1.2),
            HeightCurve('pendulum held level, (11)', SPEEDS, level, canvas.VERMILION),
            HeightCurve('cubic through these', SPEEDS, cubic, canvas.INK, (0, (1, 2)), 1.8),
            HeightCurve('ball driven at its speed, (12)', SPEEDS, driven, canvas.ORANGE),
            HeightCurve('pendulum held up, (11)', SPEEDS, up, canvas.PURPLE),
            HeightCurve('pendulum held down, (11)', SPEEDS, down, canvas.BLUE),
            quasi_static_curve(robot)])
        draw_rolls(axes, _rolls(RunUp(), robot))
        tell()
        speeds, heights, _ = zip(*PRINTED)
        axes.plot(speeds, 1e3 * np.array(heights), '*', ms=11, color=canvas.INK, zorder=6,
                  mec='white', mew=0.6, label='passed, printed in the paper (Fig. 7)')
        place_legend(axes)
        draw_heading(figure, 'Fig. 6  GimBall driven into a step')
        tell()
    return figure


def figure_7(progress: Progress = None) -> Figure:
    """Show the three crossings whose numbers are printed, as film strips."""
    tell = _parts(progress, len(PRINTED))
    runs = []
    for speed, height, name in PRINTED:
        runs.append((load_scene(name).simulate(),
                     f'{1e3 * height:.0f} mm at {speed:g} m/s, passed'))
        tell()
    return stacked(runs, f'Fig. 7  Three crossings, {RESIMULATED}')


def figure_8(progress: Progress = None) -> Figure:
    """Show both balls in two simulators; without MuJoCo in one, and say so."""
    robots = [load_robot(name) for name in ('gimball', 'shellball')]
    laws = ('matched', 'default') if mujoco_check.installed() else ()
    tell = _parts(progress, len(robots) * (1 + len(laws) * len(TWIN_SPEEDS)))
    with matplotlib.rc_context(dict(canvas.STYLE)):
        figure = canvas.new_figure(6.8, 5.0)
        axes = height_axes(figure, (0.10, 0.105, 0.87, 0.81), '', 0.062, 1.3)
        for robot, colour in zip(robots, (canvas.BLUE, canvas.VERMILION)):
            draw_curves(axes, [HeightCurve(f'{robot.name}, this model', SPEEDS, step_heights(
                Case(robot), SPEEDS), colour)])
            tell()
            for law, marker, label in (('matched', 'o', 'its contact matched to (7)-(9)'),
                                       ('default', 'd', 'its contact as it comes'))[:len(laws)]:
                heights = []
                for speed in TWIN_SPEEDS.tolist():
                    heights.append(
                        mujoco_check.twin_height(Case(robot), speed, TWIN_STEP, law=law))
                    tell()
                axes.plot(TWIN_SPEEDS, 1e3 * np.array(heights), marker, ms=5.5, color=colour,
                          mfc='none' if law == 'matched' else colour, zorder=5,
                          label=f'{robot.name}, MuJoCo, {label}')
        if laws:
            apart = mujoco_check.largest_difference(Case(robots[0]), 0.78, 0.031, 0.6, TWIN_STEP)
            axes.text(0.985, 0.03, 'Under the same forces, the ways of GimBall over 31 mm\n'
                      f'in both simulators are {apart:.0e} m apart.', ha='right', fontsize=7.5,
                      transform=axes.transAxes, color=canvas.GREY)
        place_legend(axes)
        draw_heading(figure, 'Fig. 8  Two simulators' if laws else
                 'Fig. 8  One simulator: MuJoCo is not installed')
    return figure


def _rolls(bench: Bench, robot: Robot, highest: float = 1.0) -> list[Roll]:
    """Return the rolls of a test, up to a height."""
    return [roll for roll in run_tests(bench, robot) if roll.step_height < highest]


def _draw_true_thresholds(axes: Any, rolls: Sequence[Roll]) -> None:
    """Mark the highest no-pass speed at the touch, which the sensors do not see."""
    found = find_thresholds(roll._replace(measured_speed=roll.touch_speed) for roll in rolls)
    axes.plot([item.highest_no_pass for item in found],
              [1e3 * item.step_height for item in found], '|', ms=9, mew=1.4,
              color=canvas.INK, zorder=5, label='highest not passed, at the touch')


def _parts(progress: Progress, parts: int) -> Callable[[], None]:
    """Return a function that tells that one more part of so many is done."""
    done = 0

    def tell() -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done / parts)
    return tell
