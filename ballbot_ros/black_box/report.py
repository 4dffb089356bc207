# SPDX-License-Identifier: Apache-2.0
"""A black box as text, and as tables for other programs."""
import math
from pathlib import Path
from typing import Iterator, List, Sequence, Tuple

import numpy as np

from ballbot_ros.black_box.read import BlackBoxRecording, date, RecordedEvent
from ballbot_ros.black_box.ring import CHANNELS, COMMANDS, STATES
from ballbot_ros.bridge.observer import Level
from ballbot_ros.bridge.supervisor import ZERO_TORQUE
from ballbot_ros.drives.capture import HEADER
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.results.files import PathLike, write_columns, write_text

# Time before a fault that the summary covers [s], and largest number of listed events.
BEFORE = 1.0
MOST_EVENTS = 25
# An event that is repeated within this is listed once [s].
REPETITION_TIME = 1.0


def summary(recording: BlackBoxRecording) -> str:
    """Return the content and the events around the fault as text."""
    rows = [*_origin(recording), ('', ''), *_before(recording)]
    width = max(len(label) for label, _ in rows)
    lines = [f'{label:<{width}}  {text}'.rstrip() for label, text in rows]
    lines += ['', f'Events from {BEFORE:g} s before the fault on', *_events(recording)]
    return '\n'.join([*lines, *(f'Damaged: {text}' for text in recording.damage)])


def _origin(recording: BlackBoxRecording) -> Iterator[Tuple[str, str]]:
    about, (begin, end) = recording.about, recording.span
    yield 'hardware', ', '.join(f'{name} {value}' for name, value in about.items())
    yield 'fault', recording.reason
    yield 'at', f'{date(recording.fault_time):%Y-%m-%d %H:%M:%S.%f} UTC'
    yield 'kept', (f'{recording.fault_time - begin:.1f} s before it and '
                   f'{end - recording.fault_time:.1f} s after: '
                   + ', '.join(f'{len(table["time"])} of {name}'
                               for name, table in recording.tables.items())
                   + f', {len(recording.traffic)} pieces of traffic')


def _before(recording: BlackBoxRecording) -> Iterator[Tuple[str, str]]:
    fault = recording.fault_time
    periods = _cut(recording, 'period', fault - BEFORE, fault)
    yield f'In the last {BEFORE:g} s', ''
    measured = np.isfinite(periods['pendulum_angle'])
    if not measured.any():
        yield 'motion', 'not measured'
    else:
        degrees = np.degrees(periods['pendulum_angle'][measured])
        sd = math.degrees(periods['angle_sd'][measured][-1])
        yield 'pendulum angle', (
            f'{_range(degrees, "degrees")}, standard deviation {sd:.1f} degrees')
        yield 'joint rate', _range(periods['joint_rate'][measured], 'rad/s')
        yield 'ball rate', _range(periods['ball_rate'][measured], 'rad/s')
        yield 'last measured', _ago(fault - periods['time'][measured][-1])
    yield 'torque requested', _range(periods['requested'], 'N m')
    yield 'torque applied', _range(periods['torque'], 'N m')
    yield from _slow(recording, periods)
    yield 'gaps of the loop', _gap(periods['time'], fault)
    commands = _cut(recording, 'command', fault - BEFORE, fault)
    yield 'commands', _last_command(commands, fault)
    imu = _cut(recording, 'imu', fault - BEFORE, fault)['time']
    yield 'IMU readings', f'{len(imu)}, the last {_ago(fault - imu[-1])}' if len(imu) else 'none'
    for side, words in (('>', 'to the drive'), ('<', 'from the drive')):
        pieces = [item for item in recording.traffic
                  if item.direction == side and item.time <= fault]
        yield words, 'nothing' if not pieces else (
            f'last {_ago(fault - pieces[-1].time)}: {_printable(pieces[-1].data)}')
    after = _cut(recording, 'period', fault, math.inf)
    yield 'torque at zero', _zero_after(after, fault)


def _slow(recording: BlackBoxRecording, periods: dict[str, Array]) -> Iterator[Tuple[str, str]]:
    fault = recording.fault_time
    drive = _cut(recording, 'drive', fault - BEFORE, fault)
    for label, values, unit in (
            ('motor current', periods['current'], 'A'), ('supply', drive['bus_voltage'], 'V'),
            ('supply current', drive['bus_current'], 'A'),
            ('power stage', drive['temperature'], 'degC'),
            ('motor', drive['motor_temperature'], 'degC')):
        known = values[np.isfinite(values)]
        if len(known):
            yield label, _range(known, unit)


def _events(recording: BlackBoxRecording) -> Iterator[str]:
    fault = recording.fault_time
    events = [event for event in merge_repeated(recording.events) if event.time >= fault - BEFORE]
    for event in events[:MOST_EVENTS]:
        mark = {Level.LOG: 'log  ', Level.FAULT: 'FAULT'}.get(Level(event.level), '     ')
        yield f'{event.time - fault:+9.3f} s  {mark}  {event.text}'
    if len(events) > MOST_EVENTS:
        yield f'{"":13}and {len(events) - MOST_EVENTS} more'


def merge_repeated(events: Sequence[RecordedEvent]) -> List[RecordedEvent]:
    """
    Return events without repetition.

    A log line that repeats the text of a preceding event is omitted; an event that is repeated
    within `REPETITION_TIME` is listed once, with the number of its occurrences.
    """
    kept: List[RecordedEvent] = []
    times: List[List[float]] = []  # of each kept event
    places: dict[str, int] = {}
    for event in events:
        place = places.get(event.text)
        if place is not None and event.time - times[place][-1] < REPETITION_TIME:
            times[place].append(event.time)
        elif not any(event.text in other.text for other in kept[-3:]
                     if event.time - other.time < 0.05):
            places[event.text] = len(kept)
            kept.append(event)
            times.append([event.time])
    return [event if len(when) == 1 else event._replace(
        text=f'{event.text} ({len(when)} times in {when[-1] - when[0]:.1f} s)')
        for event, when in zip(kept, times)]


def _cut(recording: BlackBoxRecording, table: str, begin: float, end: float) -> dict[str, Array]:
    columns = recording.tables[table]
    inside = (columns['time'] >= begin) & (columns['time'] <= end)
    return {name: column[inside] for name, column in columns.items()}


def gaps(times: Array) -> Tuple[Array, Array]:
    """Return the ends of the gaps between periods, and their lengths [s]."""
    return times[1:], np.diff(times)


def _gap(times: Array, fault: float) -> str:
    if len(times) < 2:
        return f'{len(times)} periods'
    ends, lengths = gaps(times)
    longest = int(np.argmax(lengths))
    return (f'{len(times)} periods, median {1e3 * float(np.median(lengths)):.2f} ms, longest '
            f'{1e3 * lengths[longest]:.1f} ms, ended {_ago(fault - ends[longest])}')


def _last_command(commands: dict[str, Array], fault: float) -> str:
    if not len(commands['time']):
        return 'none'
    what, unit = COMMANDS[int(commands['kind'][-1])]
    return (f'{len(commands["time"])}, the last {_ago(fault - commands["time"][-1])}: {what} '
            f'{commands["value"][-1]:.3f} {unit}'.rstrip())


def _zero_after(after: dict[str, Array], fault: float) -> str:
    if not len(after['time']):
        return 'no records after the fault'
    pushing = np.abs(after['torque']) > ZERO_TORQUE
    if not pushing.any():
        return 'at the detection of the fault'
    last = int(np.flatnonzero(pushing)[-1])
    if last + 1 == len(pushing):
        return 'not within the recorded time'
    return f'{1e3 * (after["time"][last + 1] - fault):.1f} ms after it'


def _range(values: Array, unit: str) -> str:
    known = values[np.isfinite(values)]
    if not len(known):
        return 'unknown'
    return f'{known.min():.3g} to {known.max():.3g} {unit}, {known[-1]:.3g} at the end'


def _ago(seconds: float) -> str:
    return f'{1e3 * seconds:.1f} ms before' if seconds < 1.0 else f'{seconds:.1f} s before'


def _printable(data: bytes) -> str:
    """Return the first bytes as text if printable, otherwise in hexadecimal."""
    text = data[-60:].decode('ascii', 'replace')
    if ''.join(text.split()).isprintable() and '\ufffd' not in text:
        return repr(text)
    return data[:40].hex(' ') + (' ...' if len(data) > 40 else '')


def write_tables(recording: BlackBoxRecording, folder: PathLike) -> List[Path]:
    """
    Write tables and events as CSV, and the traffic as a capture.

    Times are relative to the fault, negative before it [s]; those of the capture, which
    test/helpers/replay.py plays back, are relative to its first piece.

    Raises `ConfigurationError` if a file cannot be written.
    """
    target, fault = Path(folder), recording.fault_time
    files = []
    for name, table in recording.tables.items():
        files.append(target / f'{name}.csv')
        units = {'time': 's', **{title: unit for kind in CHANNELS.values() if kind.name == name
                                 for _, title, unit in kind.fields}}
        columns = {**table, 'time': table['time'] - fault}
        if 'state' in table:
            columns['state'] = np.array([state.name for state in STATES])[
                np.minimum(table['state'].astype(int), len(STATES) - 1)]
        write_columns(columns, units, files[-1])
    files.append(target / 'events.csv')
    write_text('time [s],level [],text\n' + ''.join(
        f'{event.time - fault:.6f},{event.level},"{_quoted(event.text)}"\n'
        for event in recording.events), files[-1])
    files.append(target / 'traffic.txt')
    begin = recording.traffic[0].time if recording.traffic else 0.0
    write_text(f'{HEADER}\n' + ''.join(
        f'{item.time - begin:.6f} {item.direction} {item.data.hex()}\n'
        for item in recording.traffic), files[-1])
    return files


def _quoted(text: str) -> str:
    return text.replace('"', '""').replace('\n', ' ')
