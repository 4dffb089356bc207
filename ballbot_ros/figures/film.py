# SPDX-License-Identifier: Apache-2.0
"""The ball on the terrain, true to scale: a film strip like Fig. 7 of the paper."""
import math
from typing import Any, NamedTuple, Optional, Sequence

from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
import numpy as np

from ballbot_ros.figures import canvas
from ballbot_ros.figures.drawing import draw_ball, draw_ground, ground_line, legend, PATH
from ballbot_ros.figures.frames import lay_out, Layout, Row
from ballbot_ros.figures.panels import plottable
from ballbot_ros.physics.simulation.trajectory import Trajectory
from ballbot_ros.results.faces import FaceMeeting, faces_of, meet_faces, rising_faces

_WIDTH, _HIGHEST_ROW = 9.6, 3.6  # width of the drawing, and largest height of a row [in]
_LEFT, _RIGHT, _TOP, _BOTTOM = 0.8, 0.2, 0.72, 0.48  # [in]
_ROW_GAP, _COLUMN_GAP, _NARROWEST = 0.55, 0.65, 6.4  # [in]
_RESULT_LINES = 1.6  # space below a face for its result [lines]
_LETTER, _LINE = 0.072, 0.15  # width of a letter and height of a line of a label [in]
_MARGIN, _DEPTH = 1.25, 0.42  # margin of the outermost centres, depth of the ground [ball radii]


class Mark(NamedTuple):
    """A decision, drawn at its step or, without a step, at the position of the ball."""

    time: float  # [s]
    word: str
    good: bool  # green; else orange
    step: Optional[float] = None  # position of the foot of the step [m]


def strip(trajectory: Trajectory, title: str = '', marks: Sequence[Mark] = ()) -> Figure:
    """
    Return outlines of the ball along its path, with pendulum, rotation and time.

    A row is a part of the run in which the ball moves in one direction.  If a run is too long for
    four rows, only the rows around its hardest impact are drawn.  Below each rising face are its
    height, the touch speed, and whether the ball crossed it.  The title may be the name of the
    scene.
    """
    run = plottable(trajectory)
    chosen = lay_out(run)
    views = [_view(run, row) for row in chosen.rows]
    span = max(right - left for left, right, _, _ in views)
    tall = max(top - bottom for _, _, bottom, top in views)
    scale = min(_WIDTH / span, _HIGHEST_ROW / tall)  # [in/m]
    cell = max(span * scale, 2.4)
    columns = max(1, min(len(views), int((_WIDTH + _COLUMN_GAP) / (cell + _COLUMN_GAP))))
    bands = [range(begin, min(begin + columns, len(views)))
             for begin in range(0, len(views), columns)]
    # Neighbours share a height range, so that their ground is aligned.
    lines = _RESULT_LINES if rising_faces(run.model.terrain, run.model.robot.ball_radius) else 1.0
    above_ball = 4.0 if marks else 2.0
    levels = [(min(views[index][2] for index in band) - lines * _LINE / scale,
               max(views[index][3] for index in band) + above_ball * _LINE / scale)
              for band in bands]
    # A narrow view shows more of the ground, so that the heading fits above it.
    cell = max(cell, (_NARROWEST + _COLUMN_GAP) / columns - _COLUMN_GAP)
    width = _LEFT + _RIGHT + columns * (cell + _COLUMN_GAP) - _COLUMN_GAP
    height = (_TOP + _BOTTOM + _ROW_GAP * (len(bands) - 1)
              + scale * sum(top - bottom for bottom, top in levels))
    with canvas.drawing(width, height) as figure:
        above = height - _TOP
        for band, (bottom, top) in zip(bands, levels):
            above -= scale * (top - bottom)
            for column, index in enumerate(band):
                axes = figure.add_axes((
                    (_LEFT + column * (cell + _COLUMN_GAP)) / width, above / height,
                    cell / width, scale * (top - bottom) / height))
                centre = 0.5 * (views[index][0] + views[index][1])
                axes.set_xlim(centre - 0.5 * cell / scale, centre + 0.5 * cell / scale)
                axes.set_ylim(bottom, top)
                _draw_row(axes, run, chosen.rows[index], scale)
                _draw_marks(axes, run, chosen.rows[index], marks, scale)
                axes.set_xlabel('x [m]' if band is bands[-1] else '', labelpad=1.0)
                axes.set_ylabel('y [m]' if column == 0 else '')
                axes.yaxis.set_label_coords(-0.55 / cell, 0.5)
            above -= _ROW_GAP
        _heading(figure, run, chosen, title)
    return figure


def stacked(runs: Sequence[tuple[Trajectory, str]], title: str) -> Figure:
    """Return the first rows of the strips of short runs, stacked and with their labels."""
    chosen = [(run, lay_out(run).rows[0], label) for run, label in runs]
    views = [_view(run, row) for run, row, _ in chosen]
    scale = _NARROWEST / max(right - left for left, right, _, _ in views)  # [in/m]
    tall = [scale * (top - bottom) + 3.0 * _LINE for _, _, bottom, top in views]
    width = _LEFT + _RIGHT + _NARROWEST
    height = _BOTTOM + sum(tall) + _ROW_GAP * len(tall) + 0.4
    with canvas.drawing(width, height) as figure:
        figure.text(0.1 / width, 1.0 - 0.24 / height, title, fontsize=11, weight='bold')
        figure.text(0.1 / width, 1.0 - 0.43 / height, legend(), fontsize=7.5, color=canvas.GREY)
        above = height - 0.4
        for (run, row, label), (left, right, bottom, _), inches in zip(chosen, views, tall):
            above -= inches + _ROW_GAP
            axes = figure.add_axes((_LEFT / width, above / height, _NARROWEST / width,
                                    inches / height))
            centre, half = 0.5 * (left + right), 0.5 * _NARROWEST / scale
            axes.set_xlim(centre - half, centre + half)
            axes.set_ylim(bottom, bottom + inches / scale)
            axes.set_title(label, loc='left', fontsize=9.5)
            _draw_row(axes, run, row, scale)
            axes.set_ylabel('y [m]')
        axes.set_xlabel('x [m]', labelpad=1.0)
    return figure


def _view(run: Trajectory, row: Row) -> tuple[float, float, float, float]:
    """Return left, right, bottom and top of a row [m]."""
    radius = run.model.robot.ball_radius
    x, y = run['x'][row.samples], run['y'][row.samples]
    left, right = float(x.min()) - _MARGIN * radius, float(x.max()) + _MARGIN * radius
    # If the ball stopped before a step or a drop, the view includes it.
    for face in faces_of(run.model.terrain, radius, endless=False):
        if right - radius < face[-1, 0] < right + 1.5 * radius:
            right = max(right, float(face[-1, 0]) + 0.5 * radius)
    line = ground_line(run.model.terrain, left, right)
    top = max(float(y.max()) + radius, float(line[:, 1].max()))
    return left, right, float(line[:, 1].min()) - _DEPTH * radius, top


def _draw_row(axes: Any, run: Trajectory, row: Row, scale: float) -> None:
    """Draw ground, path, outlines and labels of one row, `scale` in inches per metre."""
    robot, terrain = run.model.robot, run.model.terrain
    left, right = axes.get_xlim()
    draw_ground(axes, terrain, left, right, axes.get_ylim()[0])
    axes.plot(run['x'][row.samples], run['y'][row.samples], color=PATH, lw=1.1,
              zorder=8)
    for number, index in enumerate(row.frames):
        # Outlines fade towards the start of a strip; the last one is the ball itself.
        age = number / max(len(row.frames) - 1, 1)
        draw_ball(axes, robot, run['x'][index], run['y'][index], run['ball_angle'][index],
                  run['pendulum_angle'][index], 1.0 if number == len(row.frames) - 1
                  else 0.30 + 0.40 * age, 3.0 + age)
    _label_times(axes, run, row, scale)
    labels = [(face, _result(run, row, met)) for face, met in zip(
        rising_faces(terrain, robot.ball_radius), meet_faces(run))]
    labels += [(face, f'{1e3 * (face[-1, 1] - face[0, 1]):.3g} mm') for face in faces_of(
        terrain, robot.ball_radius, endless=False) if face[-1, 1] < face[0, 1]]
    for face, label in labels:
        if left < face[0, 0] and face[-1, 0] < right:
            axes.text(face[:, 0].mean(), face[:, 1].min() - 0.06 / scale, label, fontsize=7.5,
                      ha='center', va='top', zorder=9, linespacing=1.1)
    for axis, (low, high), room in ((axes.xaxis, axes.get_xlim(), 0.7),
                                    (axes.yaxis, axes.get_ylim(), 0.4)):
        axis.set_major_locator(
            MaxNLocator(max(2, int((high - low) * scale / room)), steps=[1, 2, 5, 10]))


def _result(run: Trajectory, row: Row, met: FaceMeeting) -> str:
    """Return height, touch speed and result of a face, as far as a row shows them."""
    words = f'{1e3 * met.height:.3g} mm'
    first, last = run['time'][row.samples[0]], run['time'][row.samples[-1]]
    if met.touch_time is None or met.touch_speed is None or not first <= met.touch_time <= last:
        return words
    return f'{words}: {"over" if met.passed else "not over"}\nat {met.touch_speed:.2f} m/s'


def _draw_marks(axes: Any, run: Trajectory, row: Row, marks: Sequence[Mark],
                scale: float) -> None:
    """Write each mark above its position, on two levels in turn, with a line down to it."""
    first, last = run['time'][row.samples[0]], run['time'][row.samples[-1]]
    left, right = axes.get_xlim()
    top = axes.get_ylim()[1]
    tops = {face[0, 0]: face[-1, 1]
            for face in rising_faces(run.model.terrain, run.model.robot.ball_radius)}
    shown = [mark for mark in marks if first <= mark.time <= last]
    for number, mark in enumerate(shown):
        index = row.samples[np.argmin(np.abs(run['time'][row.samples] - mark.time))]
        x, y, word = run['x'][index], run['y'][index], mark.word
        if mark.step in tops and left < mark.step < right:
            x, y, word = mark.step, tops[mark.step], f'{mark.word}, at {mark.time:.2f} s'
        colour = canvas.GREEN if mark.good else canvas.VERMILION
        level = top - (0.2 + 1.1 * (number % 2)) * _LINE / scale
        axes.plot([x] * 2, [y, level - 0.8 * _LINE / scale], color=colour, lw=0.7, ls=':',
                  zorder=9)
        axes.plot(x, y, 'o', color=colour, ms=3.0, zorder=9)
        # The text must not extend beyond the right end.
        half = 0.5 * _LETTER * len(word) / scale
        axes.text(min(x, right - half), level, word, fontsize=7.5, weight='bold', color=colour,
                  ha='center', va='top', zorder=10,
                  path_effects=[withStroke(linewidth=2.0, foreground='white')])


def _label_times(axes: Any, run: Trajectory, row: Row, scale: float) -> None:
    """Write the time above each ball where space permits; first and last take precedence."""
    radius = run.model.robot.ball_radius
    frames = row.frames.tolist()
    taken: list[tuple[float, float]] = []
    length = float(run['time'][frames[-1]] - run['time'][frames[0]])
    digits = 2 if length < 60.0 else 1
    for index in dict.fromkeys([frames[0], frames[-1], *frames]):
        x, y = run['x'][index], run['y'][index] + radius + 0.05 / scale
        label = f'{run["time"][index]:.{digits}f} s'
        if all(abs(x - other_x) * scale > _LETTER * len(label)
               or abs(y - other_y) * scale > _LINE for other_x, other_y in taken):
            taken.append((x, y))
            axes.text(x, y, label, fontsize=7.5, ha='center', va='bottom', zorder=10,
                      path_effects=[withStroke(linewidth=2.0, foreground='white')])


def _heading(figure: Figure, run: Trajectory, chosen: Layout, title: str) -> None:
    width, height = figure.get_size_inches()
    robot = run.model.robot
    heading = ', '.join(part for part in (title, robot.name) if part)
    figure.text(_LEFT / width, 1.0 - 0.28 / height, heading, fontsize=11, weight='bold')
    words = [f'true to scale, ball {2.0 * robot.ball_radius:.3g} m across']
    if chosen.of > len(chosen.rows):
        first, last = (run['time'][row.samples[end]]
                       for row, end in ((chosen.rows[0], 0), (chosen.rows[-1], -1)))
        words.append(f'from {first:.4g} to {last:.4g} s of {run["time"][-1]:.4g} s')
    elif math.isclose(run['time'][0], run['time'][-1]):
        words.append('at rest')
    words.append(legend(robot.has_pendulum))
    figure.text(_LEFT / width, 1.0 - 0.47 / height, '; '.join(words), fontsize=7.5,
                color=canvas.GREY)
