# SPDX-License-Identifier: Apache-2.0
"""Residuals of an identified model, channel by channel."""
import textwrap
from typing import Any, Mapping, Tuple

from matplotlib.figure import Figure

from ballbot_ros.figures import canvas
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.results.units import SI

# Verdict of a channel, and its colour.
VERDICTS = {
    'good': ('', canvas.BLUE),
    'correlated': ('CORRELATED: the model is incomplete', canvas.ORANGE),
    'poor': ('POOR FIT: the model does not explain this channel', canvas.VERMILION)}


def residual_figure(series: Mapping[str, Tuple[Array, Array]], channels: Mapping[str, Any],
                    title: str, command: str) -> Figure:
    """
    Draw residuals against time, a panel per channel, with twice their RMS.

    `series` has times [s] and residuals of each channel, `channels` its `ChannelFit`: a bad fit is
    labelled, and drawn in another colour.  `command`, which creates the figure, is its caption.
    """
    with canvas.drawing(7.0, 1.1 + 1.35 * len(series)) as figure:
        axes: Any = figure.subplots(len(series), 1, sharex=True, squeeze=False)[:, 0]
        for panel, (name, (times, values)) in zip(axes, series.items()):
            item = channels[name]
            words, colour = VERDICTS[item.verdict]
            for level in (-2.0 * item.residual_rms, 2.0 * item.residual_rms):
                panel.axhline(level, color=canvas.GREY, linewidth=0.7, linestyle='--')
            panel.axhline(0.0, color=canvas.GREY, linewidth=0.7)
            panel.plot(times, values, '.', color=colour, markersize=2.0)
            panel.set_ylabel(f'{name.replace("_", " ")}\n[{SI[name]}]')
            share = 100.0 * item.residual_rms / item.motion if item.motion else float('inf')
            panel.set_title(f'RMS {item.residual_rms:.3g} {SI[name]}, {share:.2g} % of the motion'
                            + (f'.  {words}' if words else ''), fontsize=8.0, loc='left',
                            color=canvas.INK if not words else canvas.VERMILION)
        figure.suptitle(title, fontsize=11.0)
        caption = textwrap.fill(command, 88, break_on_hyphens=False)
        axes[-1].set_xlabel(f'time [s]; dashed: twice the RMS\n{caption}')
        figure.align_ylabels(axes)
        figure.tight_layout()
    return figure


def departure_figure(series: Mapping[str, Tuple[Array, Array, Array]], units: Mapping[str, str],
                     title: str) -> Figure:
    """
    Draw measurement and model on the left, model minus measurement on the right, by channel.

    `series` has times [s], measured values and model values of each channel.
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
        axes[0, 1].set_title('model minus measured', fontsize=9.0)
        for panel in axes[-1]:
            panel.set_xlabel('time [s]')
        figure.suptitle(title, fontsize=11.0)
        figure.align_ylabels(axes[:, 0])
        figure.tight_layout()
    return figure
