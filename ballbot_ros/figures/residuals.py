# SPDX-License-Identifier: Apache-2.0
"""What an identified model leaves unexplained, channel by channel."""
from typing import Any, Mapping, Tuple

from matplotlib.figure import Figure

from ballbot_ros.figures import canvas
from ballbot_ros.physics.model.terrain import Array


def residual_figure(series: Mapping[str, Tuple[Array, Array]], units: Mapping[str, str],
                    noise: Mapping[str, float], title: str) -> Figure:
    """
    Draw residuals against time, a panel per channel, with twice their scatter.

    `series` has times and residuals of each channel, `noise` their root mean square.
    """
    with canvas.drawing(7.0, 0.9 + 1.25 * len(series)) as figure:
        axes: Any = figure.subplots(len(series), 1, sharex=True, squeeze=False)[:, 0]
        for panel, (name, (times, values)) in zip(axes, series.items()):
            for level in (-2.0 * noise[name], 2.0 * noise[name]):
                panel.axhline(level, color=canvas.GREY, linewidth=0.7, linestyle='--')
            panel.axhline(0.0, color=canvas.GREY, linewidth=0.7)
            panel.plot(times, values, '.', color=canvas.BLUE, markersize=2.0)
            panel.set_ylabel(f'{name.replace("_", " ")}\n[{units[name]}]')
        axes[0].set_title(title)
        axes[-1].set_xlabel('time [s]; dashed: twice the scatter')
        figure.align_ylabels(axes)
        figure.tight_layout()
    return figure
