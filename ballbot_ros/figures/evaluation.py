# SPDX-License-Identifier: Apache-2.0
"""Results of the evaluation of the decision; see `studies.evaluation`."""
from typing import Any, Dict

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ballbot_ros.figures import canvas

COLOURS = (canvas.BLUE, canvas.VERMILION, canvas.GREEN, canvas.ORANGE, canvas.PURPLE, canvas.SKY)
# Shades of grey: colours denote planners.
BAD = {'fell': canvas.INK, 'hit': canvas.GREY, 'ran away': canvas.SOIL, 'stuck': canvas.PALE}


def evaluation(report: Dict[str, Any]) -> Figure:
    """Draw reliability, failures, and crossings by room from `evaluation.report.report`."""
    planners = report['planners']
    with canvas.panels(10.4, 3.8) as figure:
        left, middle, right = (figure.add_axes((0.06 + 0.33 * place, 0.16, 0.255, 0.66))
                               for place in range(3))
        draw_reliability(left, planners)
        draw_failures(middle, planners)
        draw_rooms(right, planners)
        for axes, title in ((left, 'Predicted and observed'), (middle, 'Failures per 1,000'),
                            (right, 'Success rate on crossable steps')):
            axes.set_title(title)
        # Left and right panel share their colours.  Above the panels, the legend hides no points.
        figure.legend(*right.get_legend_handles_labels(), ncols=len(planners), fontsize=8,
                      loc='upper center')
    return figure


def draw_reliability(axes: Axes, planners: Dict[str, Any]) -> None:
    """Draw the observed success rate over the predicted one."""
    axes.plot([0.0, 1.0], [0.0, 1.0], color=canvas.GREY, lw=0.8, ls='--')
    for one, colour in zip(planners.values(), COLOURS):
        parts = [part for part in one['reliability'] if part['attempts']]
        if not parts:
            continue
        predicted, share = ([part[key] for part in parts] for key in ('predicted', 'observed'))
        errors = [[max(0.0, part['observed'] - part['interval'][0]) for part in parts],
                  [max(0.0, part['interval'][1] - part['observed']) for part in parts]]
        axes.errorbar(predicted, share, errors, fmt='o', ms=4, lw=1.0, color=colour)
    axes.set_xlim(0.4, 1.01)
    axes.set_ylim(0.0, 1.01)
    axes.set_xlabel('predicted success rate')
    axes.set_ylabel('observed success rate, 95 % intervals')


def draw_failures(axes: Axes, planners: Dict[str, Any]) -> None:
    """Draw the failures per thousand approaches."""
    names = list(planners)
    before = [0.0] * len(names)
    for outcome, colour in BAD.items():
        shares = [planners[name]['per thousand'][outcome] for name in names]
        axes.barh(names, shares, left=before, color=colour, label=outcome, height=0.6,
                  edgecolor=canvas.INK, lw=0.4)
        before = [low + share for low, share in zip(before, shares)]
    for place, (name, sum_of_shares) in enumerate(zip(names, before)):
        if sum_of_shares == 0.0:
            axes.text(0.02, place, f'none of {planners[name]["approaches"]}', va='center',
                      fontsize=8)
    axes.invert_yaxis()
    axes.tick_params(axis='y', labelsize=7.5)
    axes.set_xlim(0.0, 1.7 * max(1.0, *before))  # room for the legend
    axes.legend(loc='center right')
    axes.set_xlabel('approaches of 1,000')


def draw_rooms(axes: Axes, planners: Dict[str, Any]) -> None:
    """Draw the fraction of crossable steps that was crossed, by the room before them."""
    for (name, one), colour in zip(planners.items(), COLOURS):
        parts = [part for part in one['crossable']['by room'] if part['approaches']]
        axes.plot([0.5 * (part['from'] + part['to']) for part in parts],
                  [part['over'] / part['approaches'] for part in parts],
                  'o-', ms=3.5, color=colour, label=name)
    axes.set_ylim(-0.03, 1.03)
    axes.set_xlabel('room before the step [m]')
    axes.set_ylabel('part crossed')
