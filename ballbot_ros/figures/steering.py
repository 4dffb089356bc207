# SPDX-License-Identifier: Apache-2.0
"""Turns of the lateral model compared with the free ball of MuJoCo, and steps at an angle."""
import math

from matplotlib.figure import Figure
import numpy as np

from ballbot_ros.crossing import held_at, max_step_heights
from ballbot_ros.figures import canvas
from ballbot_ros.figures.canvas import draw_heading
from ballbot_ros.physics import Actuation, load_robot
from ballbot_ros.steering import load_oblique_steps, yaw_rate_limit
from ballbot_ros.studies import free_ball
from ballbot_ros.studies.free_ball import compare
from ballbot_ros.studies.progress import counted, ignore, Progress

ROBOT = 'gimball'
TURNING_SPEEDS = (0.2, 0.4, 0.8)  # [m/s]
DURATION = 6.0  # [s]
EACH = 12  # period of the markers [samples]


def turning(progress: Progress = ignore) -> Figure:
    """Show yaw rate and tilt after a step of the lean and under the steering law."""
    found = load_robot(ROBOT)
    assert found.steering is not None
    report = counted(progress, 2 * len(TURNING_SPEEDS))
    lean = found.steering.largest_lean
    with canvas.panels(9.6, 5.0) as figure:
        for number, speed in enumerate(TURNING_SPEEDS):
            above, below = (figure.add_axes((0.07 + 0.315 * number, bottom, 0.27, 0.35))
                            for bottom in (0.51, 0.085))
            above.set_title(f'{speed:g} m/s')
            limit = yaw_rate_limit(found, speed)
            for label, colour, yaw_rate in (
                    (f'lean step of {np.degrees(lean):.0f} degrees', canvas.VERMILION, None),
                    ('steering law at the limit', canvas.BLUE, limit)):
                if free_ball.installed():
                    result = compare(found, speed, lean, yaw_rate, DURATION)
                    for axes, name, scale in ((above, 'yaw_rate', 1.0),
                                              (below, 'tilt', np.degrees(1.0))):
                        axes.plot(result.time, scale * result.model[name], color=colour,
                                  label=label)
                        axes.plot(result.time[::EACH], scale * result.mujoco[name][::EACH], 'o',
                                  ms=3.0, color=colour, mfc='none')
                report()
            above.axhline(limit, color=canvas.GREY, lw=0.7, ls='--')
            below.set_xlabel('time [s]')
            for axes in (above, below):
                axes.set_xlim(0.0, DURATION)
            if number == 0:
                above.set_ylabel('yaw rate [rad/s]')
                below.set_ylabel('tilt of the axle [degrees]')
                above.legend()
        draw_heading(
            figure, 'Turning: lateral model (lines) and MuJoCo (circles)',
            'simulated with the full three-dimensional model; dashed: yaw_rate_limit'
            if free_ball.installed() else 'not simulated with the full three-dimensional model: '
            f'MuJoCo is not installed ({free_ball.HOW_TO_INSTALL})')
    return figure


OBLIQUE_SPEEDS = (0.5, 0.8, 1.1)  # [m/s]
SET_ANGLES = (None, 0.0, 0.5 * math.pi)  # pendulum free, down and level
ANGLES = np.radians([0.0, 7.5, 15.0, 22.5, 30.0, 37.5, 45.0])
COLOURS = (canvas.GREEN, canvas.BLUE, canvas.VERMILION)


def oblique(progress: Progress = ignore) -> Figure:
    """Show height factor, course and heading over the angle between path and normal."""
    found, table = load_robot(ROBOT), load_oblique_steps(ROBOT)
    report = counted(progress, len(OBLIQUE_SPEEDS) * len(SET_ANGLES))
    factors = []
    for speed in OBLIQUE_SPEEDS:
        for set_angle in SET_ANGLES:
            actuation = Actuation() if set_angle is None else held_at(set_angle)
            maxima = np.array([item.height for item in max_step_heights(
                found, (speed * np.cos(ANGLES)).tolist(), actuation, set_angle or 0.0, 2e-5)])
            factors.append(maxima / maxima[0])
            report()
    with canvas.panels(
            10.4, 3.5, **{'axes.titlesize': 9.0, 'axes.titleweight': 'normal'}) as figure:
        heights, courses, headings = (
            figure.add_axes((left, 0.14, 0.26, 0.68)) for left in (0.06, 0.39, 0.72))
        heights.set_title('maximum height over that at 0 degrees')
        heights.fill_between(
            np.degrees(ANGLES), np.min(factors, axis=0), np.max(factors, axis=0),
            color=canvas.SOIL, lw=0, label='planar model, normal speed component')
        middle = 0.5 * (np.array(table.lowest_factor) + table.highest_factor)
        heights.errorbar(table.angles_deg, middle, fmt='none', color=canvas.BLUE, capsize=3,
                         yerr=middle - table.lowest_factor, label='three dimensions, MuJoCo')
        heights.set_ylim(0.0, 1.05)
        heights.legend()
        for axes, title, rows in (
                (courses, 'turn of the course at the edge [degrees]',
                 (table.lowest_course_change_deg, table.highest_course_change_deg)),
                (headings, 'turn of the heading later [degrees]',
                 (table.lowest_heading_change_deg, table.highest_heading_change_deg))):
            axes.set_title(title)
            for column, (share, colour) in enumerate(zip(table.height_shares, COLOURS)):
                low, high = (np.array(row)[:, column] for row in rows)
                axes.fill_between(table.angles_deg, low, high, color=colour, alpha=0.3, lw=0)
                axes.plot(table.angles_deg, 0.5 * (low + high), color=colour,
                          label=f'{100.0 * share:.0f} % of the maximum height')
        top = max(courses.get_ylim()[1], headings.get_ylim()[1])
        for axes in (courses, headings):
            axes.set_ylim(min(courses.get_ylim()[0], headings.get_ylim()[0]), 1.4 * top)
        courses.legend(loc='upper left')
        for axes in (heights, courses, headings):
            axes.set_xlabel('angle between path and normal [degrees]')
            axes.set_xlim(0.0, 1.02 * math.degrees(ANGLES[-1]))
        draw_heading(figure, 'Steps at an angle: GimBall at 0.5, 0.8 and 1.1 m/s',
                     'simulated with the full model; pendulum free, down and level')
    return figure
