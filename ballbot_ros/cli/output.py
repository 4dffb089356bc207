# SPDX-License-Identifier: Apache-2.0
"""What several verbs write and print."""
import json
from pathlib import Path
import sys
from typing import Any, Sequence


def print_json(content: Any) -> None:
    """Print values as JSON, which knows no NaN."""
    json.dump(content, sys.stdout, indent=2, allow_nan=False)
    print()


def table_row(cells: Sequence[str], widths: Sequence[int]) -> str:
    """Return a line of a table in Markdown."""
    return f'| {" | ".join(f"{cell:<{width}}" for cell, width in zip(cells, widths))} |'


def table_rule(widths: Sequence[int]) -> str:
    """Return the line below the heading of a table in Markdown."""
    return f'|{"|".join("-" * (width + 2) for width in widths)}|'


def save_figure(figure: Any, folder: Path, name: str, kind: str = 'both') -> list[str]:
    """Write a figure as SVG, PNG or both, and return the names of the files."""
    from ballbot_ros.figures.canvas import FORMATS, save
    names = [f'{name}.{ending}' for ending in (FORMATS if kind == 'both' else (kind,))]
    for file in names:
        save(figure, folder / file)
    return names
