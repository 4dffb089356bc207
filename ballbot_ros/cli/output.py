# SPDX-License-Identifier: Apache-2.0
"""Output of the verbs: JSON, tables, figures, folders and files."""
import json
from pathlib import Path
import sys
from typing import Any, Iterable, Optional, Sequence

from ballbot_ros.errors import ConfigurationError


def print_json(content: Any) -> None:
    """Print values as JSON, without NaN."""
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
    from ballbot_ros.figures.canvas import save
    names = figure_files([name], kind)
    for file in names:
        save(figure, folder / file)
    return names


def result_folder(given: Optional[Path], default: Path, names: Sequence[str],
                  overwrite: bool) -> Path:
    """
    Return the folder that a verb writes to: without results in it, unless these are replaced.

    No folder is created; a missing one above a given folder is reported.

    Parameters
    ----------
    given : Path or None
        From the command line.
    default : Path
        Without it; with ``_2``, ``_3``, ... while it contains results.
    names : sequence of str
        Files that the verb writes.
    overwrite : bool
        Replace existing results.

    Raises
    ------
    ConfigurationError
        If the given folder contains results, or cannot be written.

    """
    from ballbot_ros.results.files import check_writable

    def there(folder: Path) -> list[str]:
        return [name for name in names if (folder / name).exists()]
    folder = default if given is None else given
    if given is None and not overwrite:
        number = 1
        while there(folder):
            number += 1
            folder = default.with_name(f'{default.name}_{number}')
    check_writable(folder / names[0])
    if there(folder) and not overwrite:
        raise ConfigurationError(
            f'{folder} contains results ({", ".join(there(folder)[:3])}); add --overwrite to '
            'replace them, or choose another folder with --out', 'exists', '--out')
    if given is not None:
        report_new_folders(folder)
    return folder


def report_new_folders(path: Path) -> None:
    """Report on standard error that folders above a path do not exist and will be created."""
    missing = [folder for folder in path.absolute().parents if not folder.exists()]
    if missing:
        print(f'Note: {path.parent} does not exist and will be created', file=sys.stderr,
              flush=True)


def check_new_file(path: Path, overwrite: bool, option: str = '--out') -> None:
    """
    Refuse a file that exists, unless it is replaced, and one that cannot be written.

    A missing folder is reported.

    """
    from ballbot_ros.results.files import check_writable
    check_writable(path)
    if path.exists() and not overwrite:
        raise ConfigurationError(
            f'{path} exists; add --overwrite to replace it, or choose another {option}', 'exists',
            option)
    report_new_folders(path)


def figure_files(names: Iterable[str], kind: str = 'both') -> list[str]:
    """Return the files of figures; see `save_figure`."""
    from ballbot_ros.figures.canvas import FORMATS
    return [f'{name}.{ending}' for name in names
            for ending in (FORMATS if kind == 'both' else (kind,))]
