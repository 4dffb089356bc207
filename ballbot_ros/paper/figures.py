# SPDX-License-Identifier: Apache-2.0
"""
The figures of the paper, re-simulated: 5 (both halves), 6, 7 and 8; and all figures by name.

No data is digitised from the printed figures.  Three points and a range are printed as numbers in
the paper; they are marked as such.
"""
from typing import Any, Callable, Mapping, Sequence

from matplotlib.figure import Figure
import numpy as np

from ballbot_ros.crossing import max_step_heights, rolling
from ballbot_ros.figures import canvas, command_loss, steering
from ballbot_ros.figures.canvas import draw_heading, RESIMULATED
from ballbot_ros.figures.film import stacked
from ballbot_ros.paper import contact_laws, design, mujoco_check, pulled_plug
from ballbot_ros.paper.cases import ACCURACY, Case, holding, LEVEL, SPEEDS, step_heights
from ballbot_ros.paper.heights import (
    draw_curve, draw_quasi_static, draw_rolls, height_axes, place_legend)
from ballbot_ros.paper.procedure import run_tests, true_thresholds
from ballbot_ros.paper.test_bench import Bench, Ramp, Roll, RunUp
from ballbot_ros.physics import load_robot, load_scene
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.studies import comparators, free_ball
from ballbot_ros.studies.progress import counted, ignore, Progress, tracked

# The three crossings of Fig. 7: speed [m/s], step [m] and scene, from top to bottom.
PRINTED_CROSSINGS = ((0.76, 0.021, 'fig7_top'), (0.78, 0.031, 'fig7_middle'),
                     (1.09, 0.056, 'fig7_bottom'))

# Section 7: up to these speeds [m/s] and heights [m] the energy "appears to be useful".
ENERGY_RULE_LIMITS = ((0.6, 0.7), (0.02, 0.03))

# Speeds and time step for MuJoCo: its own contact model takes a hundred times as long as ours.
MUJOCO_SPEEDS, MUJOCO_STEP = SPEEDS[::4], 2e-4


def figure_5(progress: Progress = ignore) -> Figure:
    """Show free rolling: curves of both balls, and measurements of the virtual bench."""
    shell, gimball = load_robot('shellball'), load_robot('gimball')
    report = counted(progress, 4)
    with canvas.panels(10.0, 4.6) as figure:
        for left, robot, highest in ((0.065, shell, 0.045), (0.555, gimball, 0.062)):
            axes = height_axes(figure, (left, 0.115, 0.43, 0.76), robot.name, highest, 1.4)
            label = 'pendulum free, simulated' if robot.has_pendulum else 'simulated'
            axes.set_xlabel('collision speed; of the rolls: by the sensors [m/s]')
            draw_curve(axes, label, SPEEDS, step_heights(Case(robot), SPEEDS))
            if robot.has_pendulum:
                draw_quasi_static(axes, robot)
            report()
            rolls = _rolls(Ramp(), robot, highest)
            draw_rolls(axes, rolls)
            _draw_true_thresholds(axes, rolls)
            _explain_offset(axes, rolls)
            report()
            place_legend(axes)
        draw_heading(figure, 'Fig. 5  Free rolling into a step')
    return figure


def figure_6(progress: Progress = ignore) -> Figure:
    """Show the driven ball: orientations of the pendulum, the three printed points."""
    robot = load_robot('gimball')
    report = counted(progress, 4)
    with canvas.panels(8.2, 5.6) as figure:
        axes = height_axes(figure, (0.085, 0.095, 0.895, 0.815), '', 0.085, 1.3)
        down, level, up = (step_heights(holding(robot, angle), SPEEDS)
                           for angle in (0.0, LEVEL, 2.0 * LEVEL))
        report()
        driven = np.array([item.height for item in max_step_heights(
            robot, SPEEDS.tolist(), rolling(robot), accuracy=ACCURACY)])
        report()
        energy = np.array([comparators.energy(robot, speed) for speed in SPEEDS.tolist()])
        cubic = np.array(np.polyval(np.polyfit(SPEEDS, level, 3), SPEEDS), dtype=np.float64)
        draw_curve(axes, 'energy is kept', SPEEDS, energy, canvas.GREY, '-.', 1.2)
        draw_curve(axes, 'pendulum held level, (11)', SPEEDS, level, canvas.VERMILION)
        draw_curve(axes, 'cubic through these', SPEEDS, cubic, canvas.INK, (0, (1, 2)), 1.8)
        draw_curve(axes, 'ball driven at its speed, (12)', SPEEDS, driven, canvas.ORANGE)
        draw_curve(axes, 'pendulum held up, (11)', SPEEDS, up, canvas.PURPLE)
        draw_curve(axes, 'pendulum held down, (11)', SPEEDS, down, canvas.BLUE)
        draw_quasi_static(axes, robot)
        rolls = _rolls(RunUp(), robot)
        draw_rolls(axes, rolls)
        _explain_offset(axes, rolls)
        report()
        speeds, heights, _ = zip(*PRINTED_CROSSINGS)
        axes.plot(speeds, 1e3 * np.array(heights), '*', ms=11, color=canvas.INK, zorder=6,
                  mec='white', mew=0.6, label='passed, printed in the paper (Fig. 7)')
        (slow, fast), (low, high) = ENERGY_RULE_LIMITS
        axes.fill_between([slow, fast], 1e3 * low, 1e3 * high, color=canvas.GREY, alpha=0.18, lw=0,
                          label='end of the energy estimate, printed in the paper')
        place_legend(axes)
        draw_heading(figure, 'Fig. 6  GimBall driven into a step')
        report()
    return figure


def figure_7(progress: Progress = ignore) -> Figure:
    """Show the three crossings whose numbers are printed, as film strips."""
    runs = [(load_scene(name).simulate(), f'{1e3 * height:.0f} mm at {speed:g} m/s, passed')
            for speed, height, name in tracked(PRINTED_CROSSINGS, progress)]
    return stacked(runs, f'Fig. 7  Three crossings, {RESIMULATED}')


def figure_8(progress: Progress = ignore) -> Figure:
    """Show both balls in two simulators, or in one with a note if MuJoCo is not installed."""
    robots = [load_robot(name) for name in ('gimball', 'shellball')]
    contacts = (('matched', 'o', 'its contact matched to (7)-(9)'),
                ('default', 'd', 'its default contact')) if free_ball.installed() else ()
    report = counted(progress, len(robots) * (1 + len(contacts) * len(MUJOCO_SPEEDS)))
    with canvas.panels(6.8, 5.0) as figure:
        axes = height_axes(figure, (0.10, 0.105, 0.87, 0.81), '', 0.062, 1.3)
        for robot, colour in zip(robots, (canvas.BLUE, canvas.VERMILION)):
            draw_curve(axes, f'{robot.name}, this model', SPEEDS,
                       step_heights(Case(robot), SPEEDS), colour)
            report()
            for law, marker, label in contacts:
                heights = []
                for speed in MUJOCO_SPEEDS.tolist():
                    heights.append(mujoco_check.mujoco_height(
                        Case(robot), speed, MUJOCO_STEP, law=law))
                    report()
                axes.plot(MUJOCO_SPEEDS, 1e3 * np.array(heights), marker, ms=5.5, color=colour,
                          mfc='none' if law == 'matched' else colour, zorder=5,
                          label=f'{robot.name}, MuJoCo, {label}')
        if contacts:
            apart = mujoco_check.largest_difference(Case(robots[0]), 0.78, 0.031, 0.6, MUJOCO_STEP)
            axes.text(0.985, 0.03, 'Under the same forces, the paths of GimBall over 31 mm\n'
                      f'in both simulators are {apart:.0e} m apart.', ha='right', fontsize=7.5,
                      transform=axes.transAxes, color=canvas.GREY)
        place_legend(axes)
        draw_heading(figure, 'Fig. 8  Two simulators' if contacts else
                     'Fig. 8  One simulator: MuJoCo is not installed')
    return figure


def _rolls(bench: Bench, robot: Robot, highest: float = 1.0) -> list[Roll]:
    return [roll for roll in run_tests(bench, robot) if roll.step_height < highest]


def _explain_offset(axes: Any, rolls: Sequence[Roll]) -> None:
    """State the difference between the measured speeds and those at the touch."""
    offset = np.array([roll.measured_speed - roll.touch_speed for roll in rolls])
    low, middle, high = np.nanpercentile(offset, (5.0, 50.0, 95.0))
    axes.text(0.985, 0.05, 'The sensors measure the speed before the step.\n'
              f'Measured minus touch speed: {middle:+.2f} m/s,\n'
              f'in 90 % of the rolls {low:+.2f} to {high:+.2f} m/s.', ha='right',
              fontsize=7.5, color=canvas.GREY, transform=axes.transAxes, zorder=6)


def _draw_true_thresholds(axes: Any, rolls: Sequence[Roll]) -> None:
    """Mark the highest no-pass speed at the touch, which the sensors do not measure."""
    found = true_thresholds(rolls)
    axes.plot([item.highest_no_pass for item in found],
              [1e3 * item.step_height for item in found], '|', ms=9, mew=1.4,
              color=canvas.INK, zorder=5, label='highest speed not passed, at the contact')


# Name -> function that draws it; it reports a progress from 0 to 1.
FIGURES: Mapping[str, Callable[..., Figure]] = {
    'fig5': figure_5, 'fig6': figure_6, 'fig7': figure_7, 'fig8': figure_8,
    'tornado': design.tornado, 'probability': design.probability, 'design': design.design,
    'slope': design.slope, 'over': design.over, 'contact_law': contact_laws.contact_law,
    'on_timeout': command_loss.on_timeout, 'black_box': pulled_plug.black_box,
    'turning': steering.turning, 'oblique': steering.oblique}
