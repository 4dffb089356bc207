# SPDX-License-Identifier: Apache-2.0
"""
Draw the folders of the package as rows of boxes and their imports as arrows, from the code.

    .venv/bin/python scripts/draw_architecture.py [FOLDER]
"""
import ast
from pathlib import Path
import re
import sys
import textwrap

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / 'scripts')]

from stages import path_argument  # noqa: E402, I100, I201
from structure import edges, folders, modules  # noqa: E402, I100, I201

from ballbot_ros.figures import canvas  # noqa: E402

# Every folder may import these; the picture omits their arrows.
BASE = {'errors', 'config', 'jit', 'compile_notice'}


def reduced(graph):
    """Return {folder: imports} without imports that a chain of others implies."""
    def reach(folder):
        return set().union({folder}, *map(reach, graph[folder]))
    return {folder: {name for name in names
                     if not any(name in reach(other) for other in names - {name})}
            for folder, names in graph.items()}


def folder_graph():
    """Return {folder: imported folders} without the base; physics counts as one folder."""
    graph = {}
    for folder, names in folders(edges()).items():
        top = folder.split('.')[0]
        if top not in BASE:
            graph.setdefault(top, set()).update(
                {name.split('.')[0] for name in names} - BASE - {top})
    return graph


def ranks(graph):
    """Return {folder: row}; the row is one above the highest imported folder."""
    found = {}

    def rank(folder):
        if folder not in found:
            found[folder] = 1 + max(map(rank, graph[folder]), default=-1)
        return found[folder]
    for folder in graph:
        rank(folder)
    return found


def purpose(folder):
    """Return the first clause of a folder's docstring."""
    text = modules()[f'ballbot_ros.{folder}'].read_text(encoding='utf-8')
    first = (ast.get_docstring(ast.parse(text)) or '').split('\n')[0]
    return re.split(r'[.;:]', first)[0].replace('`', '')


def draw():
    """Return the figure and the set of arrows (importer, imported) in it."""
    graph = reduced(folder_graph())
    rows = {}
    for folder, row in ranks(graph).items():
        rows.setdefault(row, []).append(folder)
    # Each folder is placed near the mean position of its imports.
    place = {}
    for row in sorted(rows):
        rows[row].sort(key=lambda folder: (sum(place[name][0] for name in graph[folder])
                                           / max(len(graph[folder]), 1), folder))
        for index, folder in enumerate(rows[row]):
            place[folder] = (12.0 * (index + 0.5) / len(rows[row]), 1.5 * row)
    with canvas.drawing(11.0, 1.0 * len(rows) + 0.8) as figure:
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set(xlim=(0.0, 12.0), ylim=(-1.5, 1.5 * max(rows) + 0.7))
        axes.axis('off')
        width = min(2.5, 12.0 / max(map(len, rows.values())) - 0.15)
        for folder, (x, y) in place.items():
            axes.text(x, y, folder + '\n', ha='center', va='center', weight='bold', fontsize=10,
                      zorder=4)
            axes.text(x, y - 0.06,
                      '\n' + textwrap.shorten(
                          purpose(folder), round(15 * width), placeholder=' ...'),
                      ha='center', va='center', fontsize=6.5, color=canvas.GREY, zorder=4)
            axes.add_patch(canvas_box(x - 0.5 * width, y - 0.36, width, 0.72))
        arrows = {(folder, name) for folder, names in graph.items() for name in names}
        for folder, name in arrows:
            (x, y), (other_x, other_y) = place[folder], place[name]
            axes.annotate('', (other_x, other_y + 0.38), (x, y - 0.38), zorder=2,
                          arrowprops={'arrowstyle': '-|>', 'color': canvas.BLUE, 'lw': 0.9,
                                      'shrinkA': 0, 'shrinkB': 0})
        axes.add_patch(canvas_box(0.1, -1.2, 11.8, 0.5))
        axes.text(6.0, -0.95, ', '.join(sorted(BASE)), ha='center', va='center', fontsize=10,
                  weight='bold', zorder=4)
        axes.text(0.1, -1.4, 'An arrow means "imports". Imports of the lowest row, and those that '
                  'a chain of arrows implies, are left out.', fontsize=7, color=canvas.GREY)
    return figure, arrows


def canvas_box(x, y, width, height):
    """Return a rounded box."""
    from matplotlib.patches import FancyBboxPatch
    return FancyBboxPatch((x, y), width, height, boxstyle='round,pad=0,rounding_size=0.08',
                          facecolor='#EFF4F8', edgecolor=canvas.GREY, lw=0.8, zorder=3)


def main():
    """Draw into the folder on the command line, docs/figures by default."""
    from draw_docs import save_small
    folder = path_argument('folder', ROOT / 'docs' / 'figures')
    save_small(draw()[0], folder / 'architecture.png')


if __name__ == '__main__':
    main()
