# SPDX-License-Identifier: Apache-2.0
"""
Keep the tables of docs/nodes.md and docs/hardware.md equal to the code.

    .venv/bin/python scripts/tables.py            # rewrite them
    .venv/bin/python scripts/tables.py --check    # fail if they differ
"""
from dataclasses import fields, MISSING
from pathlib import Path
import sys

from ballbot_ros.config.fields import allowed
from ballbot_ros.decision import DecisionTuning
from ballbot_ros.drives import driver_class, DRIVES
from ballbot_ros.drives.odrive.firmware import GENERATIONS, WATCHDOG, WATCHDOG_TIMEOUT
from ballbot_ros.emulator.control import FAULTS, LINE_FAULTS
from ballbot_ros.ros.motor_health import VALUES
from ballbot_ros.ros.settings import (
    BridgeSettings, ControllerSettings, DecisionSettings, EmulatedRobotSettings, SimulatorSettings)

DOCS = Path(__file__).resolve().parent.parent / 'docs'
KINDS = {str: 'text', bool: 'true or false'}


def table(cls):
    """Return the Markdown table of the described fields of a dataclass."""
    lines = ['| parameter | default | allowed | meaning |', '|---|---|---|---|']
    for item in fields(cls):
        metadata = item.metadata
        if metadata['kind'] in (float, int):
            span = allowed(metadata)
        else:
            span = ', '.join(metadata.get('choices', ())) or KINDS[metadata['kind']]
        default = f'`{item.default}`' if item.default not in ('', MISSING) else ''
        lines.append(f'| `{item.name}` | {default} | {span} | {metadata["doc"]} |')
    return '\n'.join(lines)


def drivers():
    """Return the Markdown table of the drivers."""
    lines = ['| protocol | makes the torque by | bytes out, in | rate at 115200 | '
             'rate at 460800 | rate at 921600 |', '|---|---|---|---|---|---|']
    for name in sorted(DRIVES):
        found = driver_class(name)
        budget = found(None, found.Options(torque_limit=0.08)).budget()
        rates = (f'{budget.highest_rate(baud):.0f} Hz' if baud in found.baud_rates else ''
                 for baud in (115200, 460800, 921600))
        way = 'measured current' if found.closes_torque_loop else 'a computed voltage'
        lines.append(f'| `{name}` | {way} | {budget.bytes_out}, {budget.bytes_in} | '
                     f'{" | ".join(rates)} |')
    return '\n'.join(lines)


def options():
    """Return the Markdown tables of the options of each drive."""
    return '\n\n'.join(f'`{name}`\n\n{table(driver_class(name).Options)}'
                       for name in sorted(DRIVES))


def faults():
    """Return the Markdown table of what the emulator does on demand."""
    lines = ['| line | what it does |', '|---|---|']
    for name, metadata in LINE_FAULTS.items():
        number = {'1': 'PART', 's': 'SECONDS', '1/s': 'BYTES_PER_S'}[metadata['unit']]
        lines.append(f'| `{name} {number} [to\\|from]` | {metadata["doc"]} |')
    for name, fault in FAULTS.items():
        number = f' ({fault.argument})' if fault.argument else ''
        lines.append(f'| `{name}`{number} | {fault.effect} |')
    return '\n'.join(lines)


def odrive_settings():
    """Return the Markdown table of what an ODrive must be set to, by generation."""
    lines = ['| firmware | setting | property | must be |', '|---|---|---|---|']
    for generation in GENERATIONS:
        bounds = ', '.join(f'`{name}`' for name in generation.torque_limits)
        lines += [
            f'| {generation.name} | torque limit | {bounds}; `{generation.current_limit}` x '
            f'`{generation.torque_constant}` | one of the two at most `torque_limit` |',
            f'| {generation.name} | watchdog | `{WATCHDOG}`, `{WATCHDOG_TIMEOUT}` | on, at most '
            '`watchdog` |']
        lines += [f'| {generation.name} | {rule.setting} | `{rule.name}` | ' + ' or '.join(
            f'{value} ({rule.words[value]})' for value in rule.wanted) + ' |'
            for rule in generation.rules]
    return '\n'.join(lines)


def health_values():
    """Return the Markdown table of what the bridge publishes on /diagnostics."""
    return '\n'.join(['| key | value |', '|---|---|',
                      *(f'| `{key}` | {meaning} |' for key, meaning in VALUES.items())])


NODES = {'simulator': SimulatorSettings, 'controller': ControllerSettings,
         'obstacle_decision': DecisionSettings, 'decision tuning': DecisionTuning,
         'bridge': BridgeSettings, 'bridge health': health_values,
         'emulated_robot': EmulatedRobotSettings}
HARDWARE = {'drivers': drivers, 'faults': faults, 'odrive settings': odrive_settings,
            'options': options}
DOCUMENTS = {DOCS / 'nodes.md': NODES, DOCS / 'hardware.md': HARDWARE}


def rewritten(text, tables):
    """Return a document with every table as the code has it."""
    for name, source in tables.items():
        begin, end = f'<!-- table: {name} -->\n', '<!-- end -->'
        head, rest = text.split(begin, 1)
        content = table(source) if isinstance(source, type) else source()
        text = head + begin + content + '\n' + end + rest.split(end, 1)[1]
    return text


def main():
    """Rewrite or check the documents."""
    for path, tables in DOCUMENTS.items():
        text = path.read_text(encoding='utf-8')
        new = rewritten(text, tables)
        if '--check' not in sys.argv:
            path.write_text(new, encoding='utf-8')
        elif new != text:
            sys.exit(f'{path.name}: run scripts/tables.py')


if __name__ == '__main__':
    main()
