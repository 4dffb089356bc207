# SPDX-License-Identifier: Apache-2.0
"""Motion of a ball after its commands stop, for each `on_timeout`; see `studies.command_loss`."""
from dataclasses import replace
import math

from matplotlib.figure import Figure
import numpy as np

from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.figures import canvas
from ballbot_ros.figures.canvas import draw_heading
from ballbot_ros.studies.command_loss import lose_commands, Scenario
from ballbot_ros.studies.progress import counted, ignore, Progress

SPEED = 0.6  # [m/s]
# Columns: title, slope [degrees], speed [m/s].
COLUMNS = (('held on 5 degrees', -5.0, 0.0), ('0.6 m/s, level', 0.0, SPEED),
           ('0.6 m/s down 2 degrees', -2.0, SPEED), ('0.6 m/s up 2 degrees', 2.0, SPEED))
DAMPING_TIME = 60.0  # damping_time of the dotted line [s]
POLICIES = (('coast', None, canvas.VERMILION, '-'), ('brake', None, canvas.BLUE, '-'),
            ('brake', DAMPING_TIME, canvas.BLUE, ':'), ('settle', None, canvas.GREEN, '-'))


def on_timeout(progress: Progress = ignore) -> Figure:
    """Show speed and pendulum angle after the last command, in a column per initial state."""
    found = load_hardware('gimball_odrive')
    report = counted(progress, len(COLUMNS) * len(POLICIES))
    with canvas.panels(10.4, 5.0) as figure:
        for number, (title, slope, speed) in enumerate(COLUMNS):
            above, below = (figure.add_axes((0.06 + 0.2375 * number, bottom, 0.19, 0.35))
                            for bottom in (0.51, 0.085))
            above.set_title(title)
            for policy, damping_time, colour, style in POLICIES:
                limits = found.limits if damping_time is None else replace(
                    found.limits, damping_time=damping_time)
                response = lose_commands(replace(found, limits=limits),
                                         Scenario(policy, math.radians(slope), speed))
                report()
                label = policy if damping_time is None else f'{policy}, {damping_time:g} s'
                above.plot(response.time, response.speed, style, color=colour, label=label)
                below.plot(response.time, np.degrees(response.pendulum_angle), style, color=colour)
            for axes in (above, below):
                axes.axvline(found.limits.command_timeout + found.limits.damping_time,
                             color=canvas.GREY, lw=0.7, ls='--')
                axes.axhline(0.0, color=canvas.GREY, lw=0.7)
                axes.set_xlim(0.0, response.time[-1])
            below.set_xlabel('since the last command [s]')
            if number == 0:
                above.set_ylabel('speed [m/s]')
                below.set_ylabel('pendulum angle [degrees]')
            elif number == 1:
                above.legend()
        draw_heading(figure, 'Commands stop: GimBall under coast, brake and settle',
                     'simulated with the full model; dashed: damping_time of '
                     f'{found.limits.damping_time:g} s is over')
    return figure
