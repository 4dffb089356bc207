# SPDX-License-Identifier: Apache-2.0
"""The common style of all figures, and their output."""
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ContextManager, Iterator, Mapping

import matplotlib
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.results.files import PathLike, replacing

# Colour-blind safe palette of Okabe and Ito; purple is darker, for thin lines.
BLUE, VERMILION, GREEN, ORANGE, SKY, PURPLE = (
    '#0072B2', '#D55E00', '#009E73', '#E69F00', '#56B4E9', '#A0457A')
INK, GREY, SOIL, PALE = '#222222', '#767676', '#D9D4CC', '#EEF3F7'
RESIMULATED = 're-simulated; not digitised from the paper'
# Names of the colours in textual legends.
NAMES: Mapping[str, str] = {BLUE: 'blue', VERMILION: 'orange', GREEN: 'green', ORANGE: 'yellow',
                            SKY: 'light blue', PURPLE: 'purple', GREY: 'grey', INK: 'black'}

# Complete style, independent of the user's matplotlibrc.  The hash salt makes SVG files
# reproducible.
STYLE: Mapping[str, Any] = {
    'font.family': 'sans-serif', 'font.size': 9.0, 'axes.titlesize': 11.0,
    'axes.labelsize': 9.0, 'xtick.labelsize': 8.0, 'ytick.labelsize': 8.0,
    'axes.edgecolor': GREY, 'axes.labelcolor': INK, 'xtick.color': INK, 'ytick.color': INK,
    'text.color': INK, 'axes.linewidth': 0.8, 'lines.linewidth': 1.4, 'text.usetex': False,
    'axes.spines.top': False, 'axes.spines.right': False, 'figure.facecolor': 'white',
    'axes.facecolor': 'white', 'savefig.facecolor': 'white', 'axes.unicode_minus': True,
    'svg.hashsalt': 'ballbot_ros', 'svg.fonttype': 'path', 'path.simplify': True,
}

# Changes to `STYLE` for figures of panels with a grid.
PANELS: Mapping[str, Any] = {
    'axes.grid': True, 'axes.axisbelow': True, 'grid.color': SOIL, 'grid.linewidth': 0.5,
    'axes.titlelocation': 'left', 'axes.titlesize': 9.5, 'axes.titleweight': 'bold',
    'legend.fontsize': 7.5, 'legend.frameon': False}

RESOLUTION = 160
FORMATS = ('png', 'svg')


@contextmanager
def drawing(width: float, height: float, **changes: Any) -> Iterator[Figure]:
    """Provide an empty figure of a size in inches, in this style, independent of any display."""
    with matplotlib.rc_context({**STYLE, **changes}):
        figure = Figure(figsize=(width, height), dpi=RESOLUTION)
        FigureCanvasAgg(figure)
        yield figure


def panels(width: float, height: float, **changes: Any) -> ContextManager[Figure]:
    """Provide an empty figure for panels with a grid, see `PANELS` and `drawing`."""
    return drawing(width, height, **{**PANELS, **changes})


def save(figure: Figure, path: PathLike) -> None:
    """
    Write a figure atomically, as SVG or PNG according to the suffix of `path`.

    Raises `ConfigurationError` for another suffix, or if the file cannot be written.
    """
    kind = Path(path).suffix[1:].lower()
    if kind not in FORMATS:
        raise ConfigurationError(
            f'{path}: a figure must end in .{" or .".join(FORMATS)}, got {kind!r}',
            'not_a_choice', 'path')
    # Without a date, equal runs produce equal files.
    metadata = {'Date': None} if kind == 'svg' else {'Software': None}
    with matplotlib.rc_context(dict(STYLE)), replacing(path) as stream:
        figure.savefig(stream, format=kind, dpi=RESOLUTION, metadata=metadata)


def draw_heading(figure: Figure, title: str, origin: str = RESIMULATED) -> None:
    """Write title and origin at the top of a figure."""
    width, height = figure.get_size_inches()
    figure.text(0.012, 1.0 - 0.24 / height, title, fontsize=11, weight='bold')
    figure.text(1.0 - 0.1 / width, 1.0 - 0.24 / height, origin, fontsize=7.5,
                color=GREY, ha='right')
