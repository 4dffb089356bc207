# SPDX-License-Identifier: Apache-2.0
"""The time around a fault, from the black box of the bridge."""
import math
from typing import Any, List, Sequence, Tuple

from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
import numpy as np

from ballbot_ros.black_box.read import BlackBoxRecording, date, RecordedEvent
from ballbot_ros.black_box.report import gaps, merge_repeated, window
from ballbot_ros.black_box.ring import TORQUE
from ballbot_ros.bridge.observer import Level
from ballbot_ros.figures import canvas
from ballbot_ros.figures.panels import Panel, Series

_WIDTH, _LEFT, _RIGHT, _TOP, _BOTTOM, _GAP = 9.6, 0.85, 1.9, 0.75, 0.55, 0.14  # [in]
LINE = 0.17  # height of a line of the list of events [in]
MOST_LINES = 14
# Wider than this a text is cut [characters].
WIDEST = 118


def around_fault(recording: BlackBoxRecording, before: float = 5.0) -> Figure:
    """
    Draw angles, rates, torques, supply, temperatures and gaps of the loop around the fault.

    Parameters
    ----------
    recording : BlackBoxRecording
    before : float
        Duration shown before the fault [s].

    """
    begin, end = window(recording, before, None)
    fault = recording.fault_time
    events = chosen([event for event in merge_repeated(recording.events)
                     if begin <= event.time <= end])
    panels = list(_panels(recording))
    bottom = _BOTTOM + LINE * (len(events) + 1)
    total = _TOP + bottom + sum(panel.height + _GAP for panel, _ in panels) - _GAP
    with canvas.drawing(_WIDTH, total) as figure:
        top, axes = total - _TOP, None
        for number, (panel, times) in enumerate(panels):
            top -= panel.height
            axes = figure.add_axes(
                (_LEFT / _WIDTH, top / total, 1.0 - (_LEFT + _RIGHT) / _WIDTH,
                 panel.height / total))
            _draw(axes, panel, [time - fault for time in times], begin - fault)
            _mark(axes, events, fault, labelled=number == 0)
            axes.set_xlim(begin - fault, end - fault + 1e-9)
            axes.tick_params(labelbottom=number + 1 == len(panels))
            top -= _GAP
        if axes is not None:
            axes.set_xlabel('from the fault on [s]')
        for number, event in enumerate(events):
            text = f'{event.time - fault:+.3f} s   {event.text}'
            figure.text(_LEFT / _WIDTH - 0.01, LINE * (len(events) - number + 0.5) / total,
                        str(number + 1), fontsize=7.5, va='top', ha='right',
                        color=_colour(event))
            figure.text(_LEFT / _WIDTH, LINE * (len(events) - number + 0.5) / total,
                        _cut(text, WIDEST), fontsize=7.5,
                        va='top', color=_colour(event))
        about = recording.about
        origin = ', '.join(filter(None, (
            about.get('hardware', ''), about.get('made', ''),
            f'fault at {date(fault):%Y-%m-%d %H:%M:%S} UTC')))
        for text, size, style, place in (
                (_cut(f'Black box: {recording.reason}', 78), 11, 'bold', 0.26),
                (origin, 7.5, 'normal', 0.42)):
            figure.text(0.012, 1.0 - place / total, text, fontsize=size, weight=style,
                        color=canvas.INK if size > 8 else canvas.GREY)
    return figure


def chosen(events: Sequence[RecordedEvent]) -> List[RecordedEvent]:
    """Return at most `MOST_LINES` events, faults before lines of the log, in order of time."""
    ranked = sorted(events, key=lambda event: (-event.level, abs(event.time)))
    return sorted(ranked[:MOST_LINES], key=lambda event: event.time)


def _cut(text: str, length: int) -> str:
    return text if len(text) <= length else f'{text[:length]} ...'


def _colour(event: RecordedEvent) -> str:
    return {Level.FAULT: canvas.VERMILION, Level.LOG: canvas.GREY}.get(
        Level(event.level), canvas.INK)


def _panels(recording: BlackBoxRecording) -> List[Tuple[Panel, List[Any]]]:
    """Return the panels from top to bottom, with the times of each of their lines."""
    period, drive = recording.tables['period'], recording.tables['drive']
    command = recording.tables['command']
    torques = command['kind'] == TORQUE
    moved = np.isfinite(period['pendulum_angle'])
    time, slow = period['time'], drive['time']
    ends, lengths = gaps(time)

    def measured(name: str) -> Any:
        return period[name][moved]
    found = [
        (Panel('angle [deg]', (
            Series('pendulum, absolute', np.degrees(measured('pendulum_angle')), canvas.BLUE),
            Series('joint', np.degrees(measured('joint_angle')), canvas.SKY))),
         [time[moved]] * 2),
        (Panel('rate [rad/s]', (
            Series('joint', measured('joint_rate'), canvas.BLUE),
            Series('ball', measured('ball_rate'), canvas.ORANGE))), [time[moved]] * 2),
        (Panel('torque [N m]', (
            Series('commanded', command['value'][torques], canvas.GREY, ':'),
            Series('asked', period['asked'], canvas.SKY),
            Series('applied', period['torque'], canvas.VERMILION))),
         [command['time'][torques], time, time]),
        (Panel('supply [V], [A]', (
            Series('voltage', drive['bus_voltage'], canvas.GREEN),
            Series('current', drive['bus_current'], canvas.PURPLE),
            Series('motor current', period['current'], canvas.ORANGE))),
         [slow, slow, time]),
        (Panel('heat [°C]', (
            Series('drive', drive['temperature'], canvas.VERMILION),
            Series('motor', drive['motor_temperature'], canvas.ORANGE)), height=0.8), [slow] * 2),
        (Panel('gap [ms]', (
            Series('between periods', 1e3 * lengths, canvas.BLUE),), height=0.8), [ends])]
    return [(panel, times) for panel, times in found]


def _draw(axes: Any, panel: Panel, times: Sequence[Any], begin: float) -> None:
    """Draw one panel from a time on; values that the drive does not report are left out."""
    axes.axhline(0.0, color=canvas.GREY, lw=0.5, zorder=1)
    for line, time in zip(panel.lines, times):
        shown = time >= begin
        if np.isfinite(line.values[shown]).any():
            axes.plot(time[shown], line.values[shown], line.style, color=line.colour,
                      label=line.label, lw=1.1,
                      drawstyle='steps-post' if 'torque' in panel.title else 'default')
    axes.set_ylabel(panel.title)
    axes.yaxis.set_label_coords(-0.62 / (_WIDTH - _LEFT - _RIGHT), 0.5)
    axes.yaxis.set_major_locator(MaxNLocator(4))
    axes.grid(lw=0.4, color='#DDDDDD', zorder=0)
    axes.margins(x=0.0, y=0.08)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc='upper left', bbox_to_anchor=(1.01, 1.03), frameon=False, fontsize=8,
                    handlelength=1.6, borderaxespad=0.0, labelspacing=0.3)


def _mark(axes: Any, events: Sequence[RecordedEvent], fault: float, labelled: bool) -> None:
    """Draw a line for each event; those of the first panel have the number of the list."""
    last, level = -math.inf, 0
    left, right = (min((event.time for event in events), default=0.0),
                   max((event.time for event in events), default=0.0))
    for number, event in enumerate(events):
        axes.axvline(event.time - fault, color=_colour(event), lw=0.7,
                     ls='-' if event.level == Level.FAULT else ':', zorder=0.5)
        if labelled:
            level = level + 1 if event.time - last < 0.02 * (right - left) else 0
            last = event.time
            axes.annotate(str(number + 1), (event.time - fault, 1.0),
                          xycoords=('data', 'axes fraction'), xytext=(7 * level, 2),
                          textcoords='offset points', fontsize=7, ha='center',
                          color=_colour(event))
