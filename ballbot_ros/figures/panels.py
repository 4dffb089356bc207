# SPDX-License-Identifier: Apache-2.0
"""A run over time, as panels below one another."""
from dataclasses import dataclass, replace
from typing import Iterator

import matplotlib
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
import numpy as np

from ballbot_ros.figures import canvas
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.simulation.trajectory import Trajectory

# Numbers beyond are those of a run that diverged, and would only spoil the scales.
PLOTTED_VALUE_MAX = 1e9

_WIDTH = 9.0
_LEFT, _RIGHT, _TOP, _BOTTOM, _GAP = 0.85, 1.75, 0.62, 0.55, 0.16  # [in]


@dataclass(frozen=True)
class Series:
    """One curve of a panel."""

    label: str
    values: Array
    colour: str
    style: str = '-'


@dataclass(frozen=True)
class Panel:
    """Curves that share a quantity."""

    title: str
    lines: tuple[Series, ...]
    height: float = 1.15  # [in]
    band: float = 0.0  # half width of a band about zero that is shaded


def sane(trajectory: Trajectory) -> Trajectory:
    """Return a trajectory without the rows that are not finite, or out of all bounds."""
    rows = trajectory.rows
    with np.errstate(invalid='ignore'):
        good = np.all(np.abs(rows[:, 1:]) < PLOTTED_VALUE_MAX, axis=1, keepdims=True)[:, 0]
    good[0] = True
    return trajectory if good.all() else replace(trajectory, rows=rows[good])


def time_series(trajectory: Trajectory, title: str = '') -> Figure:
    """
    Return speed, pendulum, forces, slip and energies over time.

    Bands in the background mark the time in flight.  The title is the name of the scene, say.
    """
    run = sane(trajectory)
    panels = list(_panels(run))
    total = _TOP + _BOTTOM + sum(panel.height + _GAP for panel in panels) - _GAP
    with canvas.drawing(_WIDTH, total) as figure:
        top = total - _TOP
        first = None
        for panel in panels:
            top -= panel.height
            axes = figure.add_axes(
                (_LEFT / _WIDTH, top / total, 1.0 - (_LEFT + _RIGHT) / _WIDTH,
                 panel.height / total), sharex=first)
            first = first or axes
            _draw(axes, run, panel)
            axes.tick_params(labelbottom=panel is panels[-1])
            top -= _GAP
        axes.set_xlabel('time [s]')
        if len(run) > 1:
            axes.set_xlim(run['time'][0], run['time'][-1])
        heading = ', '.join(part for part in (title, run.model.robot.name) if part)
        figure.text(_LEFT / _WIDTH, 1.0 - 0.30 / total, heading, fontsize=11, weight='bold')
        if (run['penetration'] == 0.0).any():
            figure.text(1.0 - _RIGHT / _WIDTH, 1.0 - 0.30 / total, 'shaded: in flight',
                        fontsize=8, color=canvas.GREY, ha='right')
    return figure


def _draw(axes: matplotlib.axes.Axes, run: Trajectory, panel: Panel) -> None:
    """Draw one panel."""
    time = run['time']
    flying = run['penetration'] == 0.0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flying, [False]]).astype(int)))
    for begin, end in zip(edges[::2], edges[1::2]):
        axes.axvspan(time[begin], time[min(end, len(time) - 1)], color=canvas.PALE, lw=0,
                     zorder=0)
    if panel.band:
        axes.axhspan(-panel.band, panel.band, color=canvas.SOIL, alpha=0.6, lw=0, zorder=0.5,
                     label=f'full friction\nbeyond {panel.band:g} m/s')
    axes.axhline(0.0, color=canvas.GREY, lw=0.6, zorder=1)
    for line in panel.lines:
        axes.plot(time, line.values, line.style, color=line.colour, label=line.label)
    axes.set_ylabel(panel.title)
    axes.yaxis.set_label_coords(-0.62 / (_WIDTH - _LEFT - _RIGHT), 0.5)
    axes.yaxis.set_major_locator(MaxNLocator(4))
    axes.ticklabel_format(axis='y', style='sci', scilimits=(-3, 4), useMathText=True)
    axes.yaxis.get_offset_text().set_fontsize(8)
    axes.grid(axis='both', lw=0.4, color='#DDDDDD', zorder=0)
    axes.margins(x=0.0, y=0.08)
    axes.legend(loc='upper left', bbox_to_anchor=(1.01, 1.03), frameon=False, fontsize=8,
                handlelength=1.6, borderaxespad=0.0, labelspacing=0.3)


def _panels(run: Trajectory) -> Iterator[Panel]:
    """Yield the panels from top to bottom."""
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
    """Yield the energies, and the residual of their balance."""
    potential = run['potential_energy']
    motor = (Series('motor work', run['motor_work'], canvas.ORANGE),)
    yield Panel('energy [J]', (
        Series('kinetic', run['kinetic_energy'], canvas.BLUE),
        Series('potential, change', potential - potential[0], canvas.GREEN),
        Series('in contact springs', run['contact_energy'], canvas.SKY),
        Series('dissipated', run.dissipated_energy, canvas.VERMILION, '--'),
        *(motor if run.model.robot.has_pendulum else ())), height=1.7)
    yield Panel('residual [J]', (
        Series('of the energy ledger', run.energy_residual, canvas.PURPLE),), height=0.8)
