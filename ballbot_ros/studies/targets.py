# SPDX-License-Identifier: Apache-2.0
"""Figures of an evaluation and their targets."""
from typing import Any, Dict, List, Optional, Sequence

from ballbot_ros.table import markdown


def target(name: str, wanted: str, found: str, met: Optional[bool]) -> Dict[str, Any]:
    """Return a line of the table of targets; `met` is None if nothing was measured."""
    return {'figure': name, 'target': wanted, 'found': found, 'met': met}


def table_of_targets(lines: Sequence[Dict[str, Any]]) -> List[str]:
    """Return the table of the figures and their targets."""
    marks = {None: '-', True: 'met', False: '**missed**'}
    return markdown(('figure', 'target', 'found', ''), (
        (line['figure'], line['target'], line['found'], marks[line['met']]) for line in lines))
