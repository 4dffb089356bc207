# SPDX-License-Identifier: Apache-2.0
"""
Keep the parameter tables of README.md equal to the code.

    .venv/bin/python scripts/tables.py            # rewrite them
    .venv/bin/python scripts/tables.py --check    # fail if they differ
"""
from dataclasses import fields
from pathlib import Path
import sys

from ballbot_ros.decision import DecisionTuning
from ballbot_ros.fields import allowed
from ballbot_ros.ros.settings import (
    BridgeSettings, ControllerSettings, DecisionSettings, SimulatorSettings)

README = Path(__file__).resolve().parent.parent / 'README.md'
TABLES = {'simulator': SimulatorSettings, 'controller': ControllerSettings,
          'obstacle_decision': DecisionSettings, 'decision tuning': DecisionTuning,
          'bridge': BridgeSettings}

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
        default = f'`{item.default}`' if item.default != '' else ''
        lines.append(f'| `{item.name}` | {default} | {span} | {metadata["doc"]} |')
    return '\n'.join(lines)


def rewritten(text):
    """Return the README with every table as the code has it."""
    for name, cls in TABLES.items():
        begin, end = f'<!-- table: {name} -->\n', '<!-- end -->'
        head, rest = text.split(begin, 1)
        text = head + begin + table(cls) + '\n' + end + rest.split(end, 1)[1]
    return text


def main():
    """Rewrite or check the README."""
    text = README.read_text(encoding='utf-8')
    new = rewritten(text)
    if '--check' in sys.argv:
        sys.exit(0 if new == text else 'README.md: run scripts/tables.py')
    README.write_text(new, encoding='utf-8')


if __name__ == '__main__':
    main()
