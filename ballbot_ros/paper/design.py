# SPDX-License-Identifier: Apache-2.0
"""Sensitivity of the maximum step height: uncertain numbers, design, ground behind the step."""
from dataclasses import replace
import math
from typing import Any, NamedTuple, Sequence

from matplotlib.figure import Figure
from matplotlib.patches import Patch
import numpy as np
from scipy.interpolate import CubicSpline

from ballbot_ros.crossing import Rules, Site
from ballbot_ros.figures import canvas
from ballbot_ros.figures.canvas import draw_heading
from ballbot_ros.paper.cases import Case, holding, LEVEL, SPEEDS, step_height, step_heights
from ballbot_ros.paper.heights import height_axes, place_legend
from ballbot_ros.physics import Actuation, load_robot
from ballbot_ros.physics.model.robot import MOTOR, ROBOT
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.model.uncertainty import changed, draw, independent, ranges
from ballbot_ros.studies.progress import counted, ignore, part_of, Progress, tracked

MAP_ACCURACY = 1e-4  # accuracy of heights for a shaded map [m]
ASSUMED_SHARE = 0.1  # relative change of parameters without a range

# Parameters that are not varied: gravity is known, the slip threshold is a regularisation.
EXCLUDED_PARAMETERS = ('gravity', 'slip_threshold')


class Bar(NamedTuple):
    """Effect of one parameter of a robot on the maximum step height."""

    name: str
    unit: str
    low: float  # ends of the range
    high: float
    height_low: float  # maximum step height at these ends [m]
    height_high: float
    uncertain: bool  # has a range in the robot's file; False for a variation by 10 %


def sensitivity(case: Case, speed: float, progress: Progress = ignore) -> list[Bar]:
    """
    Return the effect of each parameter, from the largest to the smallest.

    Uncertain parameters are set to the ends of their ranges, all others that are not 0 are changed
    by +-10 %.  Those of the motor are included only if the actuation is a voltage, and those of
    the lateral axis never: the ball meets the step in the plane of the pendulum.
    """
    robot = case.robot
    found = ranges(robot)
    known = {name: span for name, span in independent(found).items()
             if not name.startswith('steering.')
             and (case.actuation.law == 'voltage' or not name.startswith('motor.'))}
    spans = [(name, low, high, True) for name, (low, high) in known.items()]
    spans += [(name, (1.0 - ASSUMED_SHARE) * value, (1.0 + ASSUMED_SHARE) * value, False)
              for name in ROBOT if name not in (*found, *EXCLUDED_PARAMETERS)
              and (value := getattr(robot, name)) > 0.0]
    bars = []
    for name, low, high, uncertain in tracked(spans, progress):
        at_low, at_high = (step_height(case._replace(robot=changed(robot, {name: value})), speed)
                           for value in (low, high))
        unit = {**ROBOT, **MOTOR}[name]['unit']
        bars.append(Bar(name, '' if unit == '1' else unit, low, high, at_low, at_high, uncertain))
    return sorted(bars, key=lambda bar: -abs(bar.height_high - bar.height_low))


def sampled_heights(case: Case, speeds: Array, samples: int,
                    progress: Progress = ignore) -> Array:
    """Return the maximum step heights [m] of robots drawn from the ranges, one row per robot."""
    return np.array([step_heights(case._replace(robot=robot), speeds)
                     for robot in tracked(draw(case.robot, samples), progress)])


def design_map(case: Case, speed: float, lengths: Array, masses: Array,
               progress: Progress = ignore) -> Array:
    """
    Return the maximum step height for other pendulums in the same ball, one row per mass [m].

    `speed` is the collision speed [m/s]; `lengths` [m] and `masses` [kg] are of the pendulum.
    """
    def height(mass: float, length: float) -> float:
        robot = replace(case.robot, pendulum_mass=mass, pendulum_length=length)
        return step_height(case._replace(robot=robot), speed, MAP_ACCURACY)
    return np.array([[height(mass, length) for length in lengths.tolist()]
                     for mass in tracked(masses.tolist(), progress)])


def heights_on_slopes(case: Case, speeds: Array, slopes: Array, progress: Progress = ignore
                      ) -> Array:
    """
    Return the maximum step height for slopes of the ground behind the step, one row per slope [m].

    `speeds` are collision speeds [m/s]; slopes [rad] are positive uphill.
    """
    return np.array([
        step_heights(case._replace(site=replace(case.site, slope_behind=slope)), speeds)
        for slope in tracked(slopes.tolist(), progress)])


METHOD = 'simulated with the full model'
SPEED = 0.8  # of the studies at one speed [m/s]
BARS_MAX, EFFECT_MIN = 10, 6e-5  # of the bars shown; heights are accurate to 5e-5 [m]
SAMPLES = 256
LENGTHS: Array = np.linspace(0.005, 0.175, 18, dtype=np.float64)  # of the pendulum [m]
MASSES: Array = np.linspace(0.3, 4.2, 14, dtype=np.float64)  # [kg]
SLOPE_SPEEDS: Array = np.array([0.3, 0.5, 0.7, 0.9, 1.1])  # [m/s]
SLOPE_COLOURS = (canvas.PURPLE, canvas.BLUE, canvas.GREEN, canvas.ORANGE, canvas.VERMILION)
# Lines for the criteria of "over", and slopes behind the step [deg].
RULES = ((Rules(), '-', 'past the edge'), (Rules(over='clear'), '--', 'clear of it'))
SLOPES_BEHIND = ((0.0, canvas.BLUE), (2.5, canvas.ORANGE), (5.0, canvas.VERMILION))
LEVELS = {0.05: '--', 0.5: '-', 0.95: ':'}  # probabilities and their lines


def tornado(progress: Progress = ignore) -> Figure:
    """Show the effect of the uncertain parameters, and of a 10 % change of the others."""
    robot = load_robot('gimball')
    cases = [('pendulum free', Case(robot)), ('held level', holding(robot, LEVEL)),
             ('motor under 5.7 V', Case(robot, Actuation(law='voltage', voltage=5.7)))]
    with canvas.panels(10.4, 4.6) as figure:
        for number, (label, case) in enumerate(cases):
            bars = sensitivity(case, SPEED, part_of(progress, number, len(cases)))
            axes = figure.add_axes((0.125 + 0.322 * number, 0.175, 0.205, 0.685))
            middle = step_height(case, SPEED)
            axes.set_title(f'{label}: {1e3 * middle:.1f} mm')
            _draw_bars(axes, [bar for bar in bars[:BARS_MAX] if max(
                abs(bar.height_low - middle), abs(bar.height_high - middle)) > EFFECT_MIN], middle)
        axes.legend(handles=[
            Patch(color=canvas.BLUE, label='at the high end of its range'),
            Patch(color=canvas.ORANGE, label='at the low end'),
            Patch(color=canvas.BLUE, alpha=0.35, label=f'no range: {ASSUMED_SHARE:.0%} more'),
            Patch(color=canvas.ORANGE, alpha=0.35, label=f'{ASSUMED_SHARE:.0%} less')],
            loc='lower right', bbox_to_anchor=(0.995, 0.0), bbox_transform=figure.transFigure,
            ncols=4)
        draw_heading(figure, f'Sensitivity of the maximum step height of GimBall at {SPEED:g} m/s',
                     METHOD)
    return figure


def _short(number: float) -> str:
    """Return a number without an exponent."""
    return f'{number:.0f}' if number >= 1e3 else f'{number:.3g}'


def _draw_bars(axes: Any, bars: Sequence[Bar], middle: float) -> None:
    for row, bar in enumerate(bars):
        for height, colour in ((bar.height_low, canvas.ORANGE), (bar.height_high, canvas.BLUE)):
            axes.barh(row, 1e3 * (height - middle), color=colour, height=0.68,
                      alpha=1.0 if bar.uncertain else 0.35)
    axes.set_yticks(range(len(bars)))
    axes.set_yticklabels([
        f'{bar.name.replace("_", " ").replace(".", ": ")}\n'
        f'{_short(bar.low)} to {_short(bar.high)} {bar.unit}' for bar in bars],
        fontsize=6.5, linespacing=1.15)
    axes.set_ylim(BARS_MAX - 0.5, -0.6)
    axes.axvline(0.0, color=canvas.INK, lw=0.8)
    axes.set_xlabel('change of the height [mm]')
    axes.grid(visible=False, axis='y')


def probability(progress: Progress = ignore) -> Figure:
    """Show the probability of passing against speed and height for the ranges of GimBall."""
    robot = load_robot('gimball')
    heights, fine = np.linspace(0.0, 0.07, 701), np.linspace(SPEEDS[0], SPEEDS[-1], 151)
    with canvas.panels(10.0, 4.6) as figure:
        for number, (label, case) in enumerate((('pendulum free', Case(robot)),
                                                ('held level', holding(robot, LEVEL)))):
            drawn = sampled_heights(case, SPEEDS[::2], SAMPLES, part_of(progress, number, 2))
            curves = CubicSpline(SPEEDS[::2], drawn, axis=1)(fine)
            passing = (curves[:, :, None] >= heights).mean(axis=0).T
            axes = height_axes(figure, (0.065 + 0.445 * number, 0.115, 0.385, 0.76), label,
                               0.07, SPEEDS[-1], SPEEDS[0])
            shades = axes.contourf(fine, 1e3 * heights, passing, np.linspace(0.0, 1.0, 11),
                                   cmap='Blues')
            for level, style in LEVELS.items():
                axes.contour(fine, 1e3 * heights, passing, [level], colors=canvas.INK,
                             linestyles=[style], linewidths=[0.9])
                axes.plot([], [], ls=style, lw=0.9, color=canvas.INK, label=f'{level:.0%} pass')
            place_legend(axes)
        scale = figure.add_axes((0.925, 0.115, 0.014, 0.76))
        figure.colorbar(shades, cax=scale, label='probability of passing')
        draw_heading(figure, f'Probability of passing: {SAMPLES} robots drawn from the ranges of '
                             'GimBall', METHOD)
    return figure


def design(progress: Progress = ignore) -> Figure:
    """Show the maximum step height against length and mass of the pendulum, for the same ball."""
    robot = load_robot('gimball')
    with canvas.panels(10.0, 4.6, **{'axes.grid': False}) as figure:
        for number, (label, case) in enumerate((('pendulum held level', holding(robot, LEVEL)),
                                                ('pendulum free', Case(robot)))):
            found = design_map(case, SPEED, LENGTHS, MASSES, part_of(progress, number, 2))
            axes = figure.add_axes((0.065 + 0.485 * number, 0.115, 0.43, 0.76))
            _draw_map(figure, axes, LENGTHS, MASSES, found)
            axes.plot(robot.pendulum_length, robot.pendulum_mass, '*', ms=12, color=canvas.INK,
                      mec='white', label='GimBall')
            _draw_slope_limits(axes, LENGTHS, robot.ball_mass, robot.ball_radius)
            axes.set_title(f'{label}, {SPEED:g} m/s')
            axes.set_xlabel('pendulum length [m]')
            axes.set_ylabel('pendulum mass [kg]' if number == 0 else '')
            if number == 0:
                axes.legend(loc='lower left', frameon=True, framealpha=0.9, edgecolor='none')
        draw_heading(figure, 'Which pendulum? Maximum step height in mm, with the ball of GimBall',
                     METHOD)
    return figure


def _draw_map(figure: Figure, axes: Any, lengths: Array, masses: Array, found: Array) -> None:
    levels = np.arange(np.floor(1e3 * found.min()), np.ceil(1e3 * found.max()) + 0.5)
    shades = axes.contourf(lengths, masses, 1e3 * found, levels, cmap='viridis', alpha=0.85)
    lines = axes.contour(lengths, masses, 1e3 * found, levels[::2], colors='white',
                         linewidths=0.7)
    axes.clabel(lines, fmt='%.0f', fontsize=7)
    figure.colorbar(shades, ax=axes, pad=0.02, label='maximum step height [mm]')


def _draw_slope_limits(axes: Any, lengths: Array, ball_mass: float, radius: float) -> None:
    """Draw the limits of pendulums that hold the ball on slopes: M2 e = (M1 + M2) R sin(alpha)."""
    low, high = axes.get_ylim()
    for degrees, style in ((4.0, ':'), (8.0, '--'), (16.0, '-')):
        moment = radius * np.sin(np.radians(degrees))
        with np.errstate(divide='ignore'):
            mass = np.where(lengths > moment, ball_mass * moment / (lengths - moment), np.nan)
        axes.plot(lengths, mass, style, color=canvas.VERMILION, lw=1.3,
                  label=f'climbs {degrees:g} degrees')
    axes.set_ylim(low, high)


def slope(progress: Progress = ignore) -> Figure:
    """Show the maximum step height against the slope of the ground behind the step."""
    robot = load_robot('gimball')
    slopes = np.radians(np.linspace(-8.0, 8.0, 17))
    with canvas.panels(10.0, 4.4) as figure:
        for number, (label, case) in enumerate((('pendulum free', Case(robot)),
                                                ('held level', holding(robot, LEVEL)))):
            found = heights_on_slopes(case, SLOPE_SPEEDS, slopes, part_of(progress, number, 2))
            axes = figure.add_axes((0.065 + 0.49 * number, 0.12, 0.44, 0.755))
            for speed, heights, colour in zip(SLOPE_SPEEDS.tolist(), found.T, SLOPE_COLOURS):
                axes.plot(np.degrees(slopes), 1e3 * heights, color=colour)
                axes.text(8.2, 1e3 * heights[-1], f'{speed:g} m/s', color=colour, fontsize=8,
                          va='center')
            axes.set(title=label, xlim=(-8.0, 10.2), xticks=range(-8, 9, 2), ylim=(0.0, 65.0),
                     xlabel='slope behind the step, uphill positive [degrees]',
                     ylabel='maximum step height [mm]' if number == 0 else '')
        draw_heading(figure, 'Slope behind the step, GimBall', METHOD)
    return figure


def over(progress: Progress = ignore) -> Figure:
    """Show the maximum step height by both criteria of when a ball is over."""
    robot = load_robot('gimball')
    report = counted(progress, 2 * len(RULES) * len(SLOPES_BEHIND))
    with canvas.panels(10.0, 4.4) as figure:
        for number, (label, case) in enumerate((('pendulum free', Case(robot)),
                                                ('held down', holding(robot, 0.0)))):
            axes = height_axes(figure, (0.065 + 0.48 * number, 0.12, 0.43, 0.755), label, 0.055,
                               SPEEDS[-1], SPEEDS[0])
            for rise, colour in SLOPES_BEHIND:
                site = Site(slope_behind=math.radians(rise))
                for rules, line, words in RULES:
                    found = step_heights(case._replace(site=site, rules=rules), SPEEDS)
                    axes.plot(SPEEDS, 1e3 * found, line, color=colour, lw=1.3,
                              label=f'{words}, {rise:g} degrees up behind it')
                    report()
            axes.legend(fontsize=8, loc='upper left')
        draw_heading(figure, 'Where a ball is over, GimBall', METHOD)
    return figure
