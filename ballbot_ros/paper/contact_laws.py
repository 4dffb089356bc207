# SPDX-License-Identifier: Apache-2.0
"""The maximum step height with other contact laws: Hunt and Crossley, and a spring alone."""
import math

from matplotlib.figure import Figure
import numpy as np
from scipy.optimize import brentq

from ballbot_ros.figures import canvas
from ballbot_ros.paper.cases import Case, SPEEDS, step_heights
from ballbot_ros.physics import load_robot
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.studies.progress import ignore, Progress

IMPACT_SPEED = 0.6  # speed at which both laws have the same restitution [m/s]


def dissipation_for(restitution: float, speed: float) -> float:
    """
    Return lambda of N = k p (1 - lambda v_n) for a coefficient of restitution at a speed [s/m].

    ``w - ln(1 + lambda w) / lambda`` of the velocity w into the ground is the same before an
    impact and after it.
    """
    def gap(scaled: float) -> float:
        after = -restitution * scaled
        return (scaled - math.log1p(scaled)) - (after - math.log1p(after))
    return float(brentq(gap, 1e-6, (1.0 - 1e-12) / restitution)) / speed


def laws(robot: Robot) -> dict[str, Robot]:
    """Return a robot with each contact law, by name."""
    dissipation = dissipation_for(robot.restitution, IMPACT_SPEED)
    return {'spring and damper, eq. (7)': robot,
            'Hunt and Crossley': robot.replace(
                contact_law='hunt_crossley', contact_dissipation=dissipation),
            'spring alone': robot.replace(contact_damping=0.0)}


def contact_law(progress: Progress = ignore) -> Figure:
    """Show the maximum step height with each contact law, and the differences."""
    colours = (canvas.BLUE, canvas.VERMILION, canvas.GREEN)
    with canvas.panels(10.0, 4.4) as figure:
        for number, name in enumerate(('gimball', 'shellball')):
            robot = load_robot(name)
            axes = figure.add_axes((0.065 + 0.48 * number, 0.40, 0.43, 0.475))
            below = figure.add_axes((0.065 + 0.48 * number, 0.12, 0.43, 0.22))
            axes.set_title(f'{robot.name}, restitution {robot.restitution:.2f} at '
                           f'{IMPACT_SPEED:g} m/s')
            reference = None
            for (label, one), colour, line in zip(laws(robot).items(), colours, ('-', '--', ':')):
                heights = 1e3 * step_heights(Case(one), SPEEDS)
                reference = heights if reference is None else reference
                gap = heights - reference
                if one is not robot:
                    label += (f', within {np.max(np.abs(gap)):.1f} mm, '
                              f'{np.max(np.abs(gap / reference)):.1%}')
                axes.plot(SPEEDS, heights, line, color=colour, lw=1.3, label=label)
                below.plot(SPEEDS, gap, line, color=colour, lw=1.3)
            progress(0.5 * (number + 1))
            for each in (axes, below):
                each.set_xlim(SPEEDS[0], SPEEDS[-1])
            axes.set_xticklabels([])
            below.set_xlabel('speed at touch [m/s]')
            if number == 0:
                axes.set_ylabel('maximum step height [mm]')
                below.set_ylabel('difference [mm]')
            axes.legend(fontsize=8, loc='upper left')
        canvas.draw_heading(figure, 'Contact law and maximum step height, pendulum free',
                            'simulated with the full model')
    return figure
