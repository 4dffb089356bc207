# SPDX-License-Identifier: Apache-2.0
"""What each `on_timeout` makes of a ball whose commands stop: a picture of `bridge.timeouts`."""
from dataclasses import replace
import math

import matplotlib
from matplotlib.figure import Figure
import numpy as np

from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.figures import canvas
from ballbot_ros.figures.heights import draw_heading
from ballbot_ros.studies.command_loss import Case, let_go

SPEED = 0.6  # [m/s]
# What is drawn, a column each: title, slope [degrees], speed [m/s].
COLUMNS = (('held on 5 degrees', -5.0, 0.0), ('0.6 m/s, level', 0.0, SPEED),
           ('0.6 m/s down 2 degrees', -2.0, SPEED), ('0.6 m/s up 2 degrees', 2.0, SPEED))
LONG = 60.0  # damping_time of the dotted line [s]
POLICIES = (('coast', None, canvas.VERMILION, '-'), ('brake', None, canvas.BLUE, '-'),
            ('brake', LONG, canvas.BLUE, ':'), ('settle', None, canvas.GREEN, '-'))


def timeout_figure(hardware: str = 'gimball_odrive') -> Figure:
    """Show speed and pendulum angle after the last command, a column for each start."""
    found = load_hardware(hardware)
    with matplotlib.rc_context(dict(canvas.STYLE)):
        figure = canvas.new_figure(10.4, 5.0)
        for number, (title, slope, speed) in enumerate(COLUMNS):
            above, below = (figure.add_axes((0.06 + 0.2375 * number, bottom, 0.19, 0.35))
                            for bottom in (0.51, 0.085))
            above.set_title(title, loc='left', fontsize=9.5, weight='bold')
            for policy, damping_time, colour, style in POLICIES:
                limits = found.limits if damping_time is None else replace(
                    found.limits, damping_time=damping_time)
                course = let_go(replace(found, limits=limits),
                                Case(policy, math.radians(slope), speed))
                label = policy if damping_time is None else f'{policy}, {damping_time:g} s'
                above.plot(course.time, course.speed, style, color=colour, label=label)
                below.plot(course.time, np.degrees(course.pendulum_angle), style, color=colour)
            for axes in (above, below):
                axes.axvline(found.limits.command_timeout + found.limits.damping_time,
                             color=canvas.GREY, lw=0.7, ls='--')
                axes.axhline(0.0, color=canvas.GREY, lw=0.7)
                axes.grid(color=canvas.SOIL, lw=0.5)
                axes.set_axisbelow(True)
                axes.set_xlim(0.0, course.time[-1])
            below.set_xlabel('since the last command [s]')
            if number == 0:
                above.set_ylabel('speed [m/s]')
                below.set_ylabel('pendulum angle [degrees]')
            elif number == 1:
                above.legend(fontsize=7.5, frameon=False)
        draw_heading(figure, 'Commands stop: GimBall under coast, brake and settle',
                     f'dashed: damping_time of {found.limits.damping_time:g} s is over')
    return figure
