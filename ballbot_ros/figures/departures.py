# SPDX-License-Identifier: Apache-2.0
"""A recording beside the model, and what is between them."""
from typing import Any, Mapping, Tuple

from matplotlib.figure import Figure

from ballbot_ros.figures import canvas
from ballbot_ros.physics.model.terrain import Array


def departure_figure(series: Mapping[str, Tuple[Array, Array, Array]], units: Mapping[str, str],
                     title: str) -> Figure:
    """
    Draw measured and model on the left, model less measured on the right, a row per channel.

    `series` has times [s], measured and model of each channel.
    """
    with canvas.drawing(9.0, 1.0 + 1.35 * len(series)) as figure:
        axes: Any = figure.subplots(len(series), 2, sharex=True, squeeze=False)
        for (left, right), (name, (times, measured, model)) in zip(axes, series.items()):
            left.plot(times, measured, color=canvas.INK, linewidth=1.8, label='measured')
            left.plot(times, model, color=canvas.VERMILION, linewidth=1.0, label='model')
            left.set_ylabel(f'{name.replace("_", " ")}\n[{units[name]}]')
            right.axhline(0.0, color=canvas.GREY, linewidth=0.7)
            right.plot(times, model - measured, color=canvas.BLUE, linewidth=1.0)
        axes[0, 0].legend(frameon=False, ncols=2, loc='lower left', bbox_to_anchor=(0.0, 1.0),
                          borderaxespad=0.2, fontsize=8.0)
        axes[0, 1].set_title('model less measured', fontsize=9.0)
        for panel in axes[-1]:
            panel.set_xlabel('time [s]')
        figure.suptitle(title, fontsize=11.0)
        figure.align_ylabels(axes[:, 0])
        figure.tight_layout()
    return figure
