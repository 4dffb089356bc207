# SPDX-License-Identifier: Apache-2.0
"""Tables as text."""
from typing import Iterable, List, Sequence


def table(rows: Iterable[Sequence[str]]) -> str:
    """
    Return rows of cells as lines of aligned columns; the first row is the heading.

    A column is right-aligned if all its cells are numbers (with units) or ``-``.
    """
    lines = list(rows)
    columns = list(zip(*lines))
    sides = ['>' if all(cell[:1] in '+-.0123456789' for cell in column[1:]) else '<'
             for column in columns]
    widths = [max(map(len, column)) for column in columns]
    return '\n'.join('  '.join(map('{:{}{}}'.format, row, sides, widths)).rstrip()
                     for row in lines)


def markdown(titles: Sequence[str], rows: Iterable[Sequence[object]]) -> List[str]:
    """Return the lines of a table in Markdown."""
    lines = [f'| {" | ".join(map(str, cells))} |' for cells in (titles, *rows)]
    return [lines[0], '|' + '---|' * len(titles), *lines[1:]]
