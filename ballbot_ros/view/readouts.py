# SPDX-License-Identifier: Apache-2.0
"""Numbers, sentences and time series next to the scene."""
from html import escape
import math
from typing import Any, Callable, List, Mapping, NamedTuple, Optional, Sequence, Tuple

import numpy as np
import viser

from ballbot_ros.decision.planning.curve import HeightCurve
from ballbot_ros.figures.canvas import BLUE, GREEN, GREY, INK, ORANGE, SKY, VERMILION
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.view.frame import DecisionSign, EnergyShares, Frame
from ballbot_ros.view.ground import step_ahead
from ballbot_ros.view.source import Source

PLOT_TIME = 10.0  # duration of the time series [s]
PLOT_POINTS_MAX = 250  # per series
PLOT_HEIGHT, CURVE_HEIGHT, PANEL_WIDTH = 130, 200, 290  # [px]
COLOURS: Mapping[str, str] = {
    'clear': GREEN, 'cross': GREEN, 'stop': VERMILION, 'go_round': ORANGE, 'back_off': ORANGE}


class PlottedCurve(NamedTuple):
    """A curve over time: its name, its colour, and its value in a frame."""

    name: str
    colour: str
    value: Callable[[Frame], Optional[float]]


def _degrees(angle: Optional[float]) -> Optional[float]:
    return None if angle is None else math.degrees(angle)


def _energy(name: str) -> Callable[[Frame], Optional[float]]:
    return lambda frame: getattr(frame.energies or EnergyShares(), name)


# Title with unit -> smallest limit of its axis on both sides of 0, and its curves.  A plot without
# a known value is hidden.
PLOTS: Mapping[str, Tuple[float, Tuple[PlottedCurve, ...]]] = {
    'speed [m/s]': (0.2, (PlottedCurve('ahead', BLUE, lambda frame: frame.velocity_x),
                          PlottedCurve('up', SKY, lambda frame: frame.velocity_y))),
    'pendulum angle [deg]': (10.0, (
        PlottedCurve('from hanging', VERMILION, lambda frame: _degrees(frame.pendulum_angle)),)),
    'torque [N m]': (0.5, (
        PlottedCurve('motor', VERMILION, lambda frame: frame.pendulum_torque),)),
    'energy [J]': (0.5, (PlottedCurve('kinetic', BLUE, _energy('kinetic')),
                         PlottedCurve('potential', GREEN, _energy('potential')),
                         PlottedCurve('dissipated', VERMILION, _energy('dissipated')),
                         PlottedCurve('motor work', ORANGE, _energy('motor_work'))))}


class Readouts:
    """Values and plots next to the scene; created once, then updated."""

    def __init__(self, server: viser.ViserServer):
        self._gui = server.gui
        panel = self._gui.add_panel()
        with panel.add_tab('State'):
            self._now = self._gui.add_html('')
            self._step = self._gui.add_html('')
            self._curve = self._curve_plot()
            self._plots = {title: self._plot(title, *plot) for title, plot in PLOTS.items()}
        panel.dock_left()
        panel.set_width(PANEL_WIDTH)
        self._drawn: Tuple[int, float] = (-1, math.nan)

    def write(self, source: Source, frame: Frame) -> None:
        """Write the numbers and draw the step ahead."""
        prospect = prospect_of(source, frame)
        self._now.content = numbers(frame)
        sentence = verdict(source.curve, prospect)
        words = '' if frame.decision is None else decision_words(frame.decision)
        self._step.content = (f'{words}<div style="{SMALL_STYLE}"><b>Step ahead</b><br>'
                              f'{escape(sentence)}</div>')
        columns = curve_columns(source.curve, prospect)
        if not all(map(np.array_equal, columns, self._curve.data, (True,) * len(columns))):
            self._curve.data = columns
            scales = _curve_scales(columns[2][0])
            if scales != self._curve.scales:
                self._curve.scales = scales

    def plot(self, source: Source, frame: Frame) -> None:
        """Draw the time series up to the time of a frame."""
        if self._drawn == (source.history.epoch, frame.time):
            return
        self._drawn = source.history.epoch, frame.time
        since = frame.time - PLOT_TIME
        frames = [passed for passed in source.history.since(since) if passed.time <= frame.time]
        frames = thinned(frames, PLOT_TIME / PLOT_POINTS_MAX)
        if len(frames) < 2:
            return
        times = np.array([passed.time for passed in frames])
        for title, (_, series) in PLOTS.items():
            columns = [column(frames, item.value) for item in series]
            handle = self._plots[title]
            handle.visible = any(np.isfinite(values).any() for values in columns)
            if handle.visible:
                handle.data = (times, *columns)

    def _curve_plot(self) -> Any:
        from viser import uplot
        series = (
            uplot.Series(label='speed at contact [m/s]'),
            uplot.Series(label='maximum height [mm]', stroke=GREEN, width=2, fill='#009E731F',
                         points=uplot.Series_Points(show=False)),
            uplot.Series(label='step ahead', stroke=INK, width=1, dash=(4, 3),
                         points=uplot.Series_Points(show=False)),
            uplot.Series(label='now', stroke=BLUE, width=0, points=uplot.Series_Points(
                show=True, size=11, fill=BLUE)),
            uplot.Series(label='expected', stroke=INK, width=0, points=uplot.Series_Points(
                show=True, size=11)))
        return self._gui.add_uplot(
            curve_columns(None, Prospect()), series, height=CURVE_HEIGHT, padding=(6, 14, 0, 0),
            scales=_curve_scales(math.nan), title='maximum step height',
            axes=(uplot.Axis(size=44, label='speed at contact [m/s]', labelSize=14),
                  uplot.Axis(size=40, label='height [mm]', labelSize=14)),
            legend=uplot.Legend(show=False))

    def _plot(self, title: str, least: float, series: Sequence[PlottedCurve]) -> Any:
        from viser import uplot
        spread = {'min': {'pad': 0.1, 'soft': -least, 'mode': 1},
                  'max': {'pad': 0.1, 'soft': least, 'mode': 1}}
        return self._gui.add_uplot(
            (np.array([0.0, 1e-3]), *(np.zeros(2) for _ in series)),
            (uplot.Series(label='t [s]'), *(uplot.Series(
                label=item.name, stroke=item.colour, width=1.5,
                points=uplot.Series_Points(show=False)) for item in series)),
            title=title, height=PLOT_HEIGHT, padding=(0, 14, 0, 0),
            scales={'x': uplot.Scale(time=False, auto=True), 'y': uplot.Scale(
                auto=True, range=spread)},
            axes=(uplot.Axis(size=30), uplot.Axis(size=46)),
            legend=uplot.Legend(show=len(series) > 1))


def _curve_scales(height: float) -> Any:
    """Return the scales of the plot of the height curve for a step ahead [mm]."""
    from viser import uplot
    # Fixed, because uPlot computes no range for a column with a NaN.
    return {'x': uplot.Scale(time=False, auto=True),
            'y': uplot.Scale(auto=False, range=(0.0, 160.0 if height > 75.0 else 80.0))}


SMALL_STYLE = 'font:13px/1.45 system-ui,sans-serif;padding:0.5em 0.7em 0'


def numbers(frame: Frame) -> str:
    """Return the values of a frame as a small table without unknown values."""
    force = None if frame.contacts is None else sum(
        math.hypot(contact.force_x, contact.force_y) for contact in frame.contacts)
    rows = [('time', frame.time, '.2f', 's'), ('position x', frame.x, '.2f', 'm'),
            ('speed', frame.velocity_x, '.2f', 'm/s'),
            ('pendulum angle', _degrees(frame.pendulum_angle), '.0f', 'deg'),
            ('motor torque', frame.pendulum_torque, '.2f', 'N m'),
            ('ground contact force', force, '.0f', 'N')]
    cells = ''.join(
        f'<tr><td style="color:{GREY};padding-right:1em">{name}</td>'
        f'<td style="text-align:right;font-variant-numeric:tabular-nums">'
        f'<b>{_rounded(value, form)}</b></td><td style="padding-left:0.4em">{unit}</td></tr>'
        for name, value, form, unit in rows if value is not None)
    flight = '' if frame.contacts is None or frame.contacts else (
        f'<tr><td colspan="3" style="color:{BLUE}">in flight</td></tr>')
    return f'<div style="{SMALL_STYLE}"><table id="ballbot-numbers">{cells}{flight}</table></div>'


def _rounded(value: float, form: str) -> str:
    """Return a formatted number, without a minus sign if it rounds to zero."""
    words = f'{value:{form}}'
    return words.lstrip('-') if float(words) == 0.0 else words


def decision_words(decision: DecisionSign) -> str:
    """Return the decision, its reason, margin and probability of success."""
    colour = COLOURS.get(decision.kind, GREY)
    facts = []
    if decision.margin is not None:
        facts.append(f'margin {1e3 * decision.margin:+.0f} mm')
    if decision.probability is not None:
        facts.append(f'success probability {100.0 * decision.probability:.0f} %')
    name = escape(decision.kind.replace('_', ' ').upper())
    reason = escape(decision.reason.replace('_', ' '))
    return (f'<div style="{SMALL_STYLE}"><span id="ballbot-decision" style="background:{colour};'
            f'color:white;border-radius:4px;padding:1px 8px;font-weight:600">{name}</span> '
            f'{reason}<br>{escape(decision.explanation)}'
            f'{"<br>" if facts else ""}{", ".join(facts)}</div>')


def thinned(frames: Sequence[Frame], apart: float) -> List[Frame]:
    """
    Return the first frame of each interval of length `apart` [s], and the last frame.

    The intervals are fixed in time, so that a curve does not flicker.
    """
    kept: List[Frame] = []
    for frame in frames:
        if not kept or frame.time // apart != kept[-1].time // apart:
            kept.append(frame)
    return kept if not frames or kept[-1] is frames[-1] else [*kept, frames[-1]]


def column(frames: Sequence[Frame], value: Callable[[Frame], Optional[float]]) -> Array:
    """Return a value in each frame, NaN if unknown."""
    found = [value(frame) for frame in frames]
    return np.array([math.nan if item is None else item for item in found])


class Prospect(NamedTuple):
    """Speed of the robot and the step ahead; None for unknown values."""

    speed: Optional[float] = None  # of the centre, towards the step [m/s]
    height: Optional[float] = None  # of the step ahead [m]
    distance: Optional[float] = None  # from the centre to its face [m]
    touch_speed: Optional[float] = None  # that a decision expects or requires [m/s]
    at_it: bool = False  # closer than a radius: the speed is no longer that at contact


def prospect_of(source: Source, frame: Frame) -> Prospect:
    """Return the step ahead, from the decision if available, otherwise from the ground."""
    speed = None if frame.velocity_x is None else abs(frame.velocity_x)
    decision = frame.decision
    if decision is not None and decision.height is not None:
        return Prospect(speed, decision.height, decision.distance, decision.speed)
    if source.terrain is None or frame.x is None:
        return Prospect(speed)
    ahead = step_ahead(source.terrain, frame.x, source.robot.ball_radius)
    if ahead is None:
        return Prospect(speed)
    distance = ahead.x - frame.x
    return Prospect(speed, ahead.height, distance, at_it=distance < source.robot.ball_radius)


def verdict(curve: Optional[HeightCurve], prospect: Prospect) -> str:
    """Return a sentence on the step ahead, the required speed and the present speed."""
    if prospect.height is None:
        return 'No step ahead.'
    where = '' if prospect.distance is None else f', {prospect.distance:.2f} m ahead'
    step = f'{"Step" if prospect.height > 0.0 else "Drop"} of ' \
        f'{abs(1e3 * prospect.height):.0f} mm{where}'
    if prospect.at_it:
        return f'{step}: the ball is crossing it.'
    if prospect.height < 0.0:
        return f'{step}.'
    if curve is None:
        return f'{step}. There is no height curve for this robot and law.'
    needed = curve.required_speed(prospect.height)
    if needed is None:
        highest = 1e3 * curve.height(curve.highest_speed)
        return f'{step}: above the maximum of {highest:.0f} mm.'
    if prospect.speed is None:
        return f'{step}: requires {needed:.2f} m/s at contact.'
    enough = ', fast enough' if prospect.speed >= needed else ''
    return f'{step}: requires {needed:.2f} m/s at contact; now {prospect.speed:.2f} m/s{enough}.'


def curve_columns(curve: Optional[HeightCurve], prospect: Prospect) -> Tuple[Array, ...]:
    """
    Return the columns of the height curve plot: increasing speeds [m/s], then heights [mm].

    The columns of heights, NaN where undefined, are the curve, the step ahead, the step ahead at
    the present speed only, and the step ahead at the expected contact speed only.
    """
    height = math.nan if prospect.height is None else max(1e3 * prospect.height, 0.0)
    now = math.nan if prospect.speed is None else prospect.speed
    touch = math.nan if prospect.touch_speed is None else prospect.touch_speed
    fastest = max(1.2, curve.highest_speed if curve else 0.0, *np.nan_to_num([1.05 * now, touch]))
    speeds = np.linspace(0.0, fastest, 61)
    speeds = np.unique(np.concatenate([speeds, [
        speed for speed in (now, touch) if math.isfinite(speed)]]))
    heights = np.full(len(speeds), math.nan)
    if curve is not None:
        known = (speeds >= curve.lowest_speed) & (speeds <= curve.highest_speed)
        heights[known] = [1e3 * curve.height(float(speed)) for speed in speeds[known]]
    return (speeds, heights, np.full(len(speeds), height),
            np.where(speeds == now, height, math.nan), np.where(speeds == touch, height, math.nan))
