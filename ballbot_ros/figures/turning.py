# SPDX-License-Identifier: Apache-2.0
"""Turns of the lateral model beside the free ball of MuJoCo; see `studies.free_ball`."""
from matplotlib.figure import Figure
import numpy as np

from ballbot_ros.figures import canvas
from ballbot_ros.figures.canvas import draw_heading
from ballbot_ros.physics import load_robot
from ballbot_ros.steering import yaw_rate_limit
from ballbot_ros.studies import free_ball
from ballbot_ros.studies.free_ball import compare, LateralRun
from ballbot_ros.studies.progress import counted, ignore, Progress

SPEEDS = (0.2, 0.4, 0.8)  # [m/s]
DURATION = 6.0  # [s]
EACH = 12  # period of the markers [samples]


def turning(progress: Progress = ignore, robot: str = 'gimball') -> Figure:
    """Show yaw rate and tilt after a step of the lean and under the steering law."""
    found = load_robot(robot)
    assert found.steering is not None
    report = counted(progress, 2 * len(SPEEDS))
    lean = found.steering.largest_lean
    with canvas.panels(9.6, 5.0) as figure:
        for number, speed in enumerate(SPEEDS):
            above, below = (figure.add_axes((0.07 + 0.315 * number, bottom, 0.27, 0.35))
                            for bottom in (0.51, 0.085))
            above.set_title(f'{speed:g} m/s')
            limit = yaw_rate_limit(found, speed)
            for label, colour, run in (
                    (f'lean step of {np.degrees(lean):.0f} degrees', canvas.VERMILION,
                     LateralRun(speed, lean, duration=DURATION)),
                    ('steering law at the limit', canvas.BLUE,
                     LateralRun(speed, yaw_rate=limit, duration=DURATION))):
                if free_ball.installed():
                    result = compare(found, run)
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
