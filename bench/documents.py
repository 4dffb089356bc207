# SPDX-License-Identifier: Apache-2.0
"""Store measured results, and write their tables to the documents."""
import json
from pathlib import Path
import re

from ballbot_ros.table import markdown

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / 'docs' / 'bench.json'


def keep(**parts):
    """Update parts of docs/bench.json."""
    stored = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    stored.update(parts)
    RESULTS.write_text(json.dumps(stored, indent=1) + '\n')


def show(document, name, text):
    """Write text to a document between ``<!-- bench: NAME -->`` and ``<!-- end -->``."""
    path = ROOT / document
    marks = f'<!-- bench: {name} -->\n', '<!-- end -->'
    found, count = re.subn(
        f'({re.escape(marks[0])}).*?({marks[1]})',
        lambda match: f'{match[1]}{text.rstrip()}\n{match[2]}', path.read_text(), flags=re.DOTALL)
    if count != 1:
        raise SystemExit(f'{path}: {count} places for "{name}", one is wanted')
    path.write_text(found)


def table(head, rows):
    """Return a table in Markdown."""
    return '\n'.join(markdown(head, rows))
