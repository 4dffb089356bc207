# SPDX-License-Identifier: Apache-2.0
"""
Keep the tables of docs/nodes.md, hardware.md, robot.md and files.md equal to the code.

    .venv/bin/python scripts/tables.py            # rewrite them
    .venv/bin/python scripts/tables.py --check    # fail if they differ
"""
from dataclasses import fields, MISSING
from functools import partial
from pathlib import Path
import sys

from ballbot_ros.bridge.condition import Battery, Thermal
from ballbot_ros.cli import file_kinds
from ballbot_ros.cli.new import span
from ballbot_ros.config.fields import allowed, why_fixed
from ballbot_ros.config.files import yaml_of
from ballbot_ros.control import ControlTuning
from ballbot_ros.decision import DecisionTuning
from ballbot_ros.decision.planning.curve import Band, CurveProvenance, HeightCurve
from ballbot_ros.drives import CAN, device_class, driver_class, DRIVES, line_of, SERIAL
from ballbot_ros.drives.can_frames import RECORD_SIZE
from ballbot_ros.drives.contract import RUNAWAY
from ballbot_ros.drives.odrive.firmware import (
    BACK_ALLOWED, GENERATIONS, LIMITS_TORQUE_MODE, MAX_BACK, OVERSPEED, VELOCITY_GAIN,
    VELOCITY_LIMIT, VELOCITY_TOLERANCE, WATCHDOG, WATCHDOG_TIMEOUT)
from ballbot_ros.emulator.control import FAULTS, LINE_FAULTS
from ballbot_ros.estimation import OdometryTuning
from ballbot_ros.nodes.bridge.health import VALUES
from ballbot_ros.nodes.bridge.settings import BridgeSettings
from ballbot_ros.nodes.controller.settings import ControllerSettings
from ballbot_ros.nodes.emulated_robot.node import EmulatedRobotSettings
from ballbot_ros.nodes.imu.node import ImuSettings
from ballbot_ros.nodes.imu.publisher import VALUES as IMU_VALUES
from ballbot_ros.nodes.navigator.settings import NavigatorSettings
from ballbot_ros.nodes.obstacle_decision.settings import DecisionSettings
from ballbot_ros.nodes.simulator.settings import SimulatorSettings
from ballbot_ros.physics.model.terrain import PIECES
from ballbot_ros.ros.settings import Settings
from ballbot_ros.ros.topics import TOPICS
from ballbot_ros.table import markdown

DOCS = Path(__file__).resolve().parent.parent / 'docs'
KINDS = {str: 'text', bool: 'true or false', object: 'names with values'}


def table(cls, prefix='', at_run_time=False):
    """Return the Markdown table of the described fields of a dataclass."""
    titles = ['parameter', 'default', 'allowed', 'meaning', *(['can change'] * at_run_time)]
    return '\n'.join(markdown(titles, table_rows(cls, prefix, at_run_time)))


def table_rows(cls, prefix, at_run_time):
    """Return the rows of `table`."""
    rows = []
    for item in fields(cls):
        metadata = item.metadata
        if metadata.get('source'):
            continue  # the values of a file have a separate table
        if 'prefix' in metadata:
            rows += table_rows(metadata['cls'], metadata['prefix'], at_run_time)
            continue
        if metadata['kind'] in (float, int):
            span = allowed(metadata)
        else:
            span = ', '.join(metadata.get('choices', ())) or KINDS[metadata['kind']]
        default = f'`{item.default}`' if item.default not in ('', None, MISSING) else ''
        row = [f'`{prefix}{item.name}`', default, span, metadata['doc']]
        if at_run_time:
            # Values of a file can change unless marked as fixed; other fields, only if marked.
            why = why_fixed(metadata if issubclass(cls, Settings) else {'fixed': '', **metadata})
            row.append(f'no: {why}' if why else 'yes')
        rows.append(row)
    return rows


def driver_table(line, size, bauds, unit):
    """Return the table of the drivers on one kind of line."""
    rows = []
    for name in sorted(name for name in DRIVES if line_of(name) is line):
        found = driver_class(name)
        budget = found(None, found.Options(torque_limit=0.08)).budget()
        rates = (f'{budget.highest_rate(baud):.0f} Hz' if baud in found.baud_rates else ''
                 for baud in bauds)
        law = 'measured current' if found.closes_torque_loop else 'computed voltage'
        rows.append([f'`{name}`', law, f'{budget.bytes_out // unit}, {budget.bytes_in // unit}',
                     *rates])
    return '\n'.join(markdown(
        ['protocol', 'torque control by', size, *(f'rate at {baud}' for baud in bauds)], rows))


def options():
    """Return the Markdown tables of the options of each drive."""
    return '\n\n'.join(f'`{name}`\n\n{table(driver_class(name).Options)}'
                       for name in sorted(DRIVES))


def faults():
    """Return the Markdown table of the faults of the emulated line."""
    lines = ['| line | effect |', '|---|---|']
    for name, metadata in LINE_FAULTS.items():
        number = {'1': 'PART', 's': 'SECONDS', '1/s': 'BYTES_PER_S'}[metadata['unit']]
        lines.append(f'| `{name} {number} [to\\|from]` | {metadata["doc"]} |')
    for name, fault in FAULTS.items():
        number = f' ({fault.argument})' if fault.argument else ''
        lines.append(f'| `{name}`{number} | {fault.effect} |')
    return '\n'.join(lines)


def quirks():
    """Return the Markdown table of the quirks of the emulated drives."""
    return '\n'.join(markdown(('protocol', 'quirk', 'effect', 'after'), (
        (f'`{protocol}`', f'`{name}`', quirk.effect, quirk.source)
        for protocol in sorted(DRIVES)
        for name, quirk in sorted(device_class(protocol).quirks.items()))))


def odrive_settings():
    """Return the Markdown table of the required settings of an ODrive, by generation."""
    lines = ['| firmware | setting | property | required value |', '|---|---|---|---|']
    for generation in GENERATIONS:
        def row(setting, properties, wanted, name=generation.name):
            quoted = ', '.join(f'`{item}`' for item in properties)
            return f'| {name} | {setting} | {quoted} | {wanted} |'
        bounds = ', '.join(f'`{name}`' for name in generation.torque_limits)
        lines += [
            f'| {generation.name} | torque limit | {bounds}; `{generation.current_limit}` x '
            f'`{generation.torque_constant}` | one of the two at most `torque_limit` |',
            row('watchdog', (WATCHDOG, WATCHDOG_TIMEOUT), 'on, at most `watchdog`'),
            row('velocity limit in torque mode',
                (LIMITS_TORQUE_MODE, VELOCITY_LIMIT, VELOCITY_GAIN),
                f'off, or at least {RUNAWAY:g} x `speed_limit` + `torque_limit` / gain'),
            row('overspeed error', (OVERSPEED, VELOCITY_TOLERANCE, VELOCITY_LIMIT),
                f'off, or tolerance x limit at least {RUNAWAY:g} x `speed_limit`'),
            row('braking', (MAX_BACK, BACK_ALLOWED, generation.brake_enabled,
                            generation.brake_resistance),
                f'the supply accepts {RUNAWAY:g} x `speed_limit` x `torque_limit`, or a brake '
                'resistor absorbs it')]
        lines += [f'| {generation.name} | {rule.setting} | `{rule.name}` | ' + ' or '.join(
            f'{value} ({rule.words[value]})' for value in rule.wanted) + ' |'
            for rule in generation.rules]
    return '\n'.join(lines)


def keys(values):
    """Return the Markdown table of the keys on /diagnostics."""
    return '\n'.join(markdown(('key', 'value'), (
        (f'`{key}`', meaning) for key, meaning in values.items())))


def topics():
    """Return the Markdown table of the topics."""
    def names(nodes):
        return ', '.join(f'`{name}`' for name in nodes.split(', ') if name)
    titles = 'topic', 'type', 'published by', 'QoS', 'subscribed to by', 'QoS', 'content'
    return '\n'.join(markdown(titles, (
        (f'`{name}`', topic.type.replace('/msg/', '/'),
         names(topic.publishers), topic.offered if topic.publishers else '',
         names(topic.subscribers), topic.requested if topic.subscribers else '', topic.meaning)
        for name, topic in TOPICS.items())))


def file_tables(sections, but=()):
    """Return the Markdown tables of the keys of a file, one for each section."""
    return '\n\n'.join(
        (f'Section `{part.key}`: {part.doc}.\n\n' if part.key else '') + key_table(part)
        for part in sections if part.keys and part.key not in but)


def key_table(part):
    """Return the table of one section."""
    rows = []
    for name, metadata in part.keys.items():
        default = metadata.get('default', MISSING)
        shown = 'required' if default is MISSING else \
            '' if default in (None, '', ()) else f'`{yaml_of(default)}`'
        value = 'a mapping or a list' if metadata['kind'] is object else span(metadata)
        example = f'`{name}: {yaml_of(part.given[name])}`' if name in part.given else ''
        rows.append((f'`{name}`', value, shown, metadata['doc'], example))
    return '\n'.join(markdown(('key', 'value', 'default', 'meaning', 'example'), rows))


def pieces():
    """Return the table of the pieces of a terrain."""
    rows = []
    for name, (_, values, optional) in PIECES.items():
        words = [f'`{key}` ({item.metadata["doc"]}, {span(item.metadata)}'
                 + ('; optional)' if key in optional else ')')
                 for key, item in values.items()]
        rows.append((f'`{name}`', '; '.join(words)))
    return '\n'.join(markdown(('piece', 'values'), rows))


NODES = {'topics': topics, 'simulator': SimulatorSettings, 'controller': ControllerSettings,
         'navigator': NavigatorSettings, 'obstacle_decision': DecisionSettings,
         'decision tuning': partial(table, DecisionTuning, at_run_time=True),
         'gains': partial(table, ControlTuning, 'gains.', True),
         'bridge': BridgeSettings, 'bridge health': partial(keys, VALUES),
         'imu': ImuSettings, 'imu health': partial(keys, IMU_VALUES),
         'emulated_robot': EmulatedRobotSettings}
HARDWARE = {
    'drivers': partial(driver_table, SERIAL, 'bytes out, in', (115200, 460800, 921600), 1),
    'can drivers': partial(
        driver_table, CAN, 'frames out, in', (250000, 500000, 1000000), RECORD_SIZE),
    'faults': faults, 'odrive settings': odrive_settings, 'options': options, 'quirks': quirks}
ROBOT = {'odometry': OdometryTuning, 'battery': Battery, 'thermal': Thermal}
CURVE = [
    file_kinds.Section('', file_kinds.described(HeightCurve, ('made', 'band')), '', {}),
    file_kinds.Section('made', file_kinds.described(CurveProvenance), 'its conditions', {}),
    file_kinds.Section('band', file_kinds.described(Band),
                       'for robots drawn from the parameter ranges', {})]
FILES = {'robot': partial(file_tables, file_kinds.robot_file('my_robot')),
         'scene': partial(file_tables, file_kinds.scene_file('my_scene')), 'pieces': pieces,
         # The omitted sections have other tables.
         'hardware': partial(file_tables, file_kinds.hardware_file('my_motor'),
                             ('odometry', 'battery', 'thermal', 'drive')),
         'curve': partial(file_tables, CURVE),
         'experiment': partial(key_table, file_kinds.Section(
             '', file_kinds.described(file_kinds.Experiment), '',
             {'scene': 'doorstep', 'duration': 4.0}))}
DOCUMENTS = {DOCS / 'nodes.md': NODES, DOCS / 'hardware.md': HARDWARE, DOCS / 'robot.md': ROBOT,
             DOCS / 'files.md': FILES}


def rewritten(text, tables):
    """Return a document with every table regenerated from the code."""
    for name, source in tables.items():
        begin, end = f'<!-- table: {name} -->\n', '<!-- end -->'
        head, rest = text.split(begin, 1)
        content = table(source, at_run_time=issubclass(source, Settings)) \
            if isinstance(source, type) else source()
        text = head + begin + content + '\n' + end + rest.split(end, 1)[1]
    return text


def main():
    for path, tables in DOCUMENTS.items():
        text = path.read_text(encoding='utf-8')
        new = rewritten(text, tables)
        if '--check' not in sys.argv:
            path.write_text(new, encoding='utf-8')
        elif new != text:
            sys.exit(f'{path.name}: run scripts/tables.py')


if __name__ == '__main__':
    main()
