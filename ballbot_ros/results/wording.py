# SPDX-License-Identifier: Apache-2.0
"""The summary of a run as text for people."""
import math
from textwrap import wrap
from typing import Iterator

from ballbot_ros.results.faces import FaceMeeting
from ballbot_ros.results.summary import Summary

_WIDTH = 88


def report(summary: Summary) -> str:
    """Return a summary as aligned lines with units."""
    rows = list(_rows(summary))
    width = max(len(label) for label, _ in rows)
    lines = [f'{label:<{width}}  {value}'.rstrip() for label, value in rows]
    if summary.faces:
        lines += ['', *_table(summary.faces)]
    for warning in summary.warnings:
        lines += ['', *wrap(f'Warning: {warning}.', _WIDTH, subsequent_indent='         ')]
    return '\n'.join(lines)


def _rows(summary: Summary) -> Iterator[tuple[str, str]]:
    """Yield label and value of each line."""
    ended = '' if summary.complete else ', ended early'
    yield 'scene', f'{summary.name}, robot {summary.robot}'
    yield 'simulated', (f'{summary.duration:.6g} s, {summary.samples} samples, '
                        f'{summary.steps} steps{ended}')
    yield 'at the end', (f'x = {summary.x:.3f} m, y = {summary.y:.3f} m, '
                         f'{summary.speed:.3f} m/s')
    yield 'speed', f'{summary.lowest_speed:.3f} to {summary.highest_speed:.3f} m/s'
    yield 'largest normal force', (f'{summary.surface_normal_force:.0f} N on surfaces, '
                                   f'{summary.edge_normal_force:.0f} N on edges')
    yield 'largest penetration', f'{1e3 * summary.penetration:.2f} mm'
    if summary.pendulum_angle is not None and summary.pendulum_torque is not None:
        yield 'largest pendulum angle', f'{math.degrees(summary.pendulum_angle):.1f} deg'
        yield 'largest pendulum torque', f'{summary.pendulum_torque:.2f} N m'
    yield 'in flight', (f'{summary.flight_fraction:.1%} of the time, '
                        f'{plural(summary.landings, "landing")}')
    if summary.energy_residual is not None:
        yield 'energy balance error', (f'{summary.energy_residual:.1e}, relative to '
                                       f'{summary.energy_in_play:.3g} J')
    if summary.accuracy is not None and summary.error_estimate is not None:
        yield 'accuracy', (f'{summary.accuracy:g} m requested, error estimated at '
                           f'{summary.error_estimate:.1e} m up to {summary.horizon:.4g} s')
        yield 'effort', (f'{summary.evaluations} evaluations, {summary.events} events located, '
                         'in all runs')
    if summary.wall_time is not None and summary.real_time_factor is not None:
        yield 'run time', (f'{summary.wall_time:.3g} s, {summary.real_time_factor:.3g} times as '
                       'fast as real time')


def plural(number: int, what: str) -> str:
    """Return a number with its noun."""
    return f'{number} {what}{"" if number == 1 else "s"}'


def _table(faces: tuple[FaceMeeting, ...]) -> Iterator[str]:
    """Yield the lines of the table of steps."""
    yield 'step edge at      height    contact at    with speed    passed'
    for face in faces:
        start = f'{face.x:11.3f} m  {1e3 * face.height:5.1f} mm'
        if face.touch_time is None or face.touch_speed is None:
            yield f'{start}    {"not reached":<10}'.rstrip()
        else:
            yield (f'{start}    {face.touch_time:8.3f} s  {face.touch_speed:8.3f} m/s    '
                   f'{"yes" if face.passed else "no"}')
