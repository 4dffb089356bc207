# SPDX-License-Identifier: Apache-2.0
"""The time around a fault, from the black box of the bridge."""
import math
from typing import Any, List, Sequence

from matplotlib.figure import Figure
import numpy as np

from ballbot_ros.black_box.read import BlackBoxRecording, date, RecordedEvent
from ballbot_ros.black_box.report import gaps, merge_repeated
from ballbot_ros.black_box.ring import TORQUE
from ballbot_ros.bridge.observer import Level
from ballbot_ros.figures import canvas
from ballbot_ros.figures.panels import Panel, panel_figure, Series

LINE = 0.17  # height of a line of the list of events [in]
MOST_LINES = 14
# Longer texts are cut [characters].
WIDEST = 118


def around_fault(recording: BlackBoxRecording, before: float) -> Figure:
    """Draw each quantity in a panel, from `before` [s] before the fault to the end."""
    fault, (start, end) = recording.fault_time, recording.span
    start = max(start, fault - before)
    events = chosen([event for event in merge_repeated(recording.events)
                     if start <= event.time <= end])
    below = LINE * (len(events) + 1)
    with panel_figure(_panels(recording, start), recording.tables['period']['time'], 9.6,
                      'from the fault on [s]', below) as (figure, drawn):
        _, total = figure.get_size_inches()
        for number, axes in enumerate(drawn):
            _mark(axes, events, fault, labelled=number == 0)
            axes.set_xlim(start - fault, end - fault + 1e-9)
        for number, event in enumerate(events):
            place = LINE * (len(events) - number + 0.5) / total
            for x, text, side in ((0.08, str(number + 1), 'right'), (0.09, _cut(
                    f'{event.time - fault:+.3f} s   {event.text}', WIDEST), 'left')):
                figure.text(x, place, text, fontsize=7.5, va='top', ha=side,
                            color=_colour(event))
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
    """Return at most `MOST_LINES` events in order of time; faults take precedence over logs."""
    ranked = sorted(events, key=lambda event: (-event.level, abs(event.time)))
    return sorted(ranked[:MOST_LINES], key=lambda event: event.time)


def _cut(text: str, length: int) -> str:
    return text if len(text) <= length else f'{text[:length]} ...'


def _colour(event: RecordedEvent) -> str:
    return {Level.FAULT: canvas.VERMILION, Level.LOG: canvas.GREY}.get(
        Level(event.level), canvas.INK)


def _panels(recording: BlackBoxRecording, start: float) -> List[Panel]:
    period, drive = recording.tables['period'], recording.tables['drive']
    command = recording.tables['command']
    torques = command['kind'] == TORQUE
    moved = np.isfinite(period['pendulum_angle'])
    ends, lengths = gaps(period['time'])

    def series(label: str, values: Any, colour: str, times: Any = period['time'],
               style: str = '-') -> Series:
        shown = times >= start
        return Series(label, values[shown], colour, style, times[shown] - recording.fault_time)

    def measured(label: str, name: str, colour: str, factor: float = 1.0) -> Series:
        return series(label, factor * period[name][moved], colour, period['time'][moved])

    def reported(label: str, name: str, colour: str) -> Series:
        return series(label, drive[name], colour, drive['time'])
    degrees = math.degrees(1.0)
    return [
        Panel('angle [deg]', (
            measured('pendulum, absolute', 'pendulum_angle', canvas.BLUE, degrees),
            measured('joint', 'joint_angle', canvas.SKY, degrees))),
        Panel('rate [rad/s]', (measured('joint', 'joint_rate', canvas.BLUE),
                               measured('ball', 'ball_rate', canvas.ORANGE))),
        Panel('torque [N m]', (
            series('commanded', command['value'][torques], canvas.GREY, command['time'][torques],
                   ':'),
            series('requested', period['requested'], canvas.SKY),
            series('applied', period['torque'], canvas.VERMILION)), stepped=True),
        Panel('supply [V], [A]', (
            reported('voltage', 'bus_voltage', canvas.GREEN),
            reported('current', 'bus_current', canvas.PURPLE),
            series('motor current', period['current'], canvas.ORANGE))),
        Panel('heat [°C]', (reported('drive', 'temperature', canvas.VERMILION),
                            reported('motor', 'motor_temperature', canvas.ORANGE)), height=0.8),
        Panel('gap [ms]', (series('between periods', 1e3 * lengths, canvas.BLUE, ends),),
              height=0.8)]


def _mark(axes: Any, events: Sequence[RecordedEvent], fault: float, labelled: bool) -> None:
    """Draw a line for each event, if `labelled` with its number in the list."""
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
