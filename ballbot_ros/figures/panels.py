# SPDX-License-Identifier: Apache-2.0
"""A run over time, as stacked panels."""
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Iterator, Optional, Sequence

from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
import numpy as np

from ballbot_ros.figures import canvas
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.simulation.trajectory import Trajectory

# Larger numbers occur in diverged runs only, and would spoil the scales.
PLOTTED_VALUE_MAX = 1e9

# Margins at the sides, above and below the panels, and the gap between two panels [in].
LEFT, RIGHT, TOP, BOTTOM, GAP = 0.85, 1.75, 0.7, 0.55, 0.15


@dataclass(frozen=True)
class Series:
    """One curve of a panel; `times` defaults to those of the figure."""

    label: str
    values: Array
    colour: str
    style: str = '-'
    times: Optional[Array] = None


@dataclass(frozen=True)
class Panel:
    """Curves of one quantity."""

    title: str
    lines: tuple[Series, ...]
    height: float = 1.15  # [in]
    stepped: bool = False
    band: float = 0.0  # half width of a shaded band about zero


def plottable(trajectory: Trajectory) -> Trajectory:
    """Return a trajectory without rows that are not finite or exceed `PLOTTED_VALUE_MAX`."""
    rows = trajectory.rows
    with np.errstate(invalid='ignore'):
        good = np.all(np.abs(rows[:, 1:]) < PLOTTED_VALUE_MAX, axis=1, keepdims=True)[:, 0]
    good[0] = True
    return trajectory if good.all() else replace(trajectory, rows=rows[good])


def time_series(trajectory: Trajectory, title: str = '') -> Figure:
    """
    Return speed, pendulum, forces, slip and energies over time.

    Bands in the background mark the time in flight.  The title may be the name of the scene.
    """
    run = plottable(trajectory)
    with panel_figure(list(_panels(run)), run['time'], 9.0, 'time [s]') as (figure, drawn):
        time, flying = run['time'], run['penetration'] == 0.0
        ends = np.flatnonzero(np.diff(np.concatenate([[False], flying, [False]]).astype(int)))
        for axes in drawn:
            for begin, end in zip(ends[::2], ends[1::2]):
                axes.axvspan(time[begin], time[min(end, len(time) - 1)], color=canvas.PALE, lw=0,
                             zorder=0)
            axes.ticklabel_format(axis='y', style='sci', scilimits=(-3, 4), useMathText=True)
            axes.yaxis.get_offset_text().set_fontsize(8)
            if len(run) > 1:
                axes.set_xlim(time[0], time[-1])
        width, height = figure.get_size_inches()
        heading = ', '.join(part for part in (title, run.model.robot.name) if part)
        figure.text(LEFT / width, 1.0 - 0.30 / height, heading, fontsize=11, weight='bold')
        if flying.any():
            figure.text(1.0 - RIGHT / width, 1.0 - 0.30 / height, 'shaded: in flight',
                        fontsize=8, color=canvas.GREY, ha='right')
    return figure


@contextmanager
def panel_figure(panels: Sequence[Panel], times: Array, width: float, label: str,
                 below: float = 0.0) -> Iterator[tuple[Figure, list[Any]]]:
    """
    Provide a figure with stacked panels, and their axes; `label` is that of the time axis.

    `times` applies to series without times; `width`, and the additional space `below` the panels,
    are in inches.
    """
    height = TOP + BOTTOM + below + sum(panel.height + GAP for panel in panels) - GAP
    with canvas.drawing(width, height) as figure:
        top, drawn = height - TOP, []
        for panel in panels:
            top -= panel.height
            axes = figure.add_axes((LEFT / width, top / height, 1.0 - (LEFT + RIGHT) / width,
                                    panel.height / height))
            top -= GAP
            _draw(axes, panel, times)
            axes.yaxis.set_label_coords(-0.62 / (width - LEFT - RIGHT), 0.5)
            axes.tick_params(labelbottom=panel is panels[-1])
            drawn.append(axes)
        drawn[-1].set_xlabel(label)
        yield figure, drawn


def _draw(axes: Any, panel: Panel, times: Array) -> None:
    """Draw one panel, without series that have no known value."""
    if panel.band:
        axes.axhspan(-panel.band, panel.band, color=canvas.SOIL, alpha=0.6, lw=0, zorder=0.5,
                     label=f'full friction\nbeyond {panel.band:g} m/s')
    axes.axhline(0.0, color=canvas.GREY, lw=0.6, zorder=1)
    for line in panel.lines:
        if np.isfinite(line.values).any():
            axes.plot(times if line.times is None else line.times, line.values, line.style,
                      color=line.colour, label=line.label,
                      drawstyle='steps-post' if panel.stepped else 'default')
    axes.set_ylabel(panel.title)
    axes.yaxis.set_major_locator(MaxNLocator(4))
    axes.grid(lw=0.4, color='#DDDDDD', zorder=0)
    axes.margins(x=0.0, y=0.08)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc='upper left', bbox_to_anchor=(1.01, 1.03), frameon=False, fontsize=8,
                    handlelength=1.6, borderaxespad=0.0, labelspacing=0.3)


def _panels(run: Trajectory) -> Iterator[Panel]:
    robot = run.model.robot
    yield Panel('speed [m/s]', (
        Series('of the centre, along x', run['velocity_x'], canvas.BLUE),
        Series('of the centre, upwards', run['velocity_y'], canvas.SKY),
        Series('of rolling, $-R\\,\\dot\\theta_1$', -robot.ball_radius * run['ball_rate'],
               canvas.VERMILION, '--')), height=1.5)
    if robot.has_pendulum:
        yield Panel('angle [deg]', (
            Series('pendulum, absolute', np.degrees(run['pendulum_angle']), canvas.BLUE),))
        yield Panel('torque [N m]', (
            Series('pendulum motor', run['pendulum_torque'], canvas.VERMILION),))
    yield Panel('normal force [N]', (
        Series('on surfaces', run['surface_normal_force'], canvas.BLUE),
        Series('on edges', run['edge_normal_force'], canvas.VERMILION)), height=1.3)
    yield Panel('slip [m/s]', (
        Series('at the deepest contact', run['slip_velocity'], canvas.BLUE),),
        band=robot.slip_threshold)
    yield from _energy_panels(run)


def _energy_panels(run: Trajectory) -> Iterator[Panel]:
    potential = run['potential_energy']
    motor = (Series('motor work', run['motor_work'], canvas.ORANGE),)
    yield Panel('energy [J]', (
        Series('kinetic', run['kinetic_energy'], canvas.BLUE),
        Series('potential, change', potential - potential[0], canvas.GREEN),
        Series('in contact springs', run['contact_energy'], canvas.SKY),
        Series('dissipated', run.dissipated_energy, canvas.VERMILION, '--'),
        *(motor if run.model.robot.has_pendulum else ())), height=1.7)
    yield Panel('residual [J]', (
        Series('of the energy balance', run.energy_residual, canvas.PURPLE),), height=0.8)
