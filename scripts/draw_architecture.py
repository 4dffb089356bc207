# SPDX-License-Identifier: Apache-2.0
"""
Draw the folders of the package and their imports.

    python scripts/draw_architecture.py [FOLDER]

Boxes and arrows come from the code; where a box stands is said in `PLACES`.
"""
import ast
import math
from pathlib import Path
import re
import sys

from matplotlib.patches import FancyBboxPatch, PathPatch, Polygon
from matplotlib.path import Path as Line

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / 'scripts')]

from house import edges, folders, modules  # noqa: E402, I100, I201

from ballbot_ros.figures import canvas  # noqa: E402

# What every folder may import; no arrows are drawn to it.
GROUND = ('errors', 'config', 'jit')
GROUPS = {
    'ground': ('#D9D4CC', 'everything imports these'), 'model': ('#CFE8DD', 'the model'),
    'robot': ('#FBE6C2', 'the robot, simulated or real'),
    'offline': ('#F4D9C9', 'offline: runtime code never imports it'),
    'ros': ('#D3E6F5', 'with ROS'), 'face': ('#E9DDEC', 'what people start')}

# A box so wide has room for what it is for.
WIDE = 8.0

# Folder -> left and right end, floor of its lower side, height in floors, group.
PLACES = {
    'physics.model': (0.5, 9.5, 1, 1, 'model'), 'physics.mechanics': (0.5, 9.5, 2, 1, 'model'),
    'physics.solvers': (0.5, 9.5, 3, 1, 'model'),
    'physics.simulation': (0.5, 9.5, 4, 1, 'model'), 'physics': (0.5, 9.5, 5, 1, 'model'),
    'drives': (10.6, 13.8, 1, 5, 'robot'),
    'results': (0.2, 1.7, 9.3, 1, 'offline'), 'crossing': (3.3, 5.0, 6, 1, 'model'),
    'control': (5.4, 7.6, 6, 1, 'robot'), 'plant': (8.1, 9.6, 6, 1, 'robot'),
    'decision': (3.3, 5.9, 7, 1, 'robot'), 'estimation': (6.2, 7.7, 7, 1, 'robot'),
    'sensors': (11.1, 12.2, 6, 1, 'robot'),
    'emulator': (8.9, 12.2, 7, 1, 'robot'), 'bridge': (6.2, 7.8, 8, 1, 'robot'),
    'studies': (1.2, 2.9, 10.3, 1, 'offline'), 'figures': (0.2, 2.9, 11.3, 1, 'offline'),
    'ros': (3.9, 9.6, 9.3, 1, 'ros'), 'nodes': (5.4, 11.4, 10.3, 1, 'ros'),
    'demo': (1.6, 4.3, 12.3, 1, 'face'), 'view': (4.7, 7.3, 12.3, 1, 'face'),
     'cli': (0.2, 13.8, 13.3, 1, 'face')}

# Importer, imported -> x of an upright arrow, or the corners of another way.
WAYS = {
    ('figures', 'results'): 1.05, ('figures', 'studies'): 2.0,
    ('results', 'crossing'): [(0.6, 9.47), (0.6, 6.5), (3.3, 6.5)],
    ('results', 'bridge'): [(1.1, 9.47), (1.1, 8.5), (6.2, 8.5)],
    ('crossing', 'physics'): 4.15, ('control', 'physics'): 6.5, ('plant', 'physics'): 8.8,
    ('decision', 'crossing'): 4.15, ('decision', 'control'): 5.65, ('estimation', 'control'): 6.9,
    ('emulator', 'plant'): 9.25, ('emulator', 'drives'): 11.4, ('bridge', 'estimation'): 7.0,
    ('bridge', 'drives'): [(7.8, 8.5), (13.6, 8.5), (13.6, 5.83)],
    ('ros', 'decision'): 5.0, ('ros', 'bridge'): 7.4, ('ros', 'plant'): 8.55,
    ('ros', 'sensors'): [(9.6, 9.8), (12.7, 9.8), (12.7, 6.5), (12.2, 6.5)],
    ('emulator', 'sensors'): 11.65, ('sensors', 'drives'): 11.65,
    ('nodes', 'ros'): 7.5, ('nodes', 'emulator'): 10.6,
    ('studies', 'results'): 1.35,
    ('studies', 'decision'): [(2.1, 10.47), (2.1, 7.5), (3.3, 7.5)],
    ('studies', 'emulator'): [(2.55, 10.47), (2.55, 9.15), (9.3, 9.15), (9.3, 7.83)],
    ('demo', 'figures'): 2.2, ('demo', 'ros'): 4.1, ('cli', 'demo'): 3.0,
    ('view', 'decision'): 5.0, ('view', 'ros'): 5.0, ('cli', 'view'): 6.0}


def drawn_edges(graph):
    """Return the imports between folders that no chain of other imports implies."""
    graph = {folder: names - set(GROUND) for folder, names in graph.items()
             if folder not in GROUND}
    # From outside, physics is one house; its own floors show inside.
    graph = {folder: names if folder.startswith('physics') else
             {name.split('.')[0] for name in names} for folder, names in graph.items()}

    def reach(folder):
        found, waiting = set(), set(graph[folder])
        while waiting:
            found |= waiting
            waiting = set().union(*map(graph.get, waiting)) - found
        return found
    return sorted((folder, name) for folder, names in graph.items() for name in names
                  if not any(name in reach(other) for other in names - {name}))


def draw_box(axes, folder):
    """Draw a folder with its name and, where there is room, its purpose."""
    left, right, floor, height, group = PLACES[folder]
    rooms = sorted({module.split('.')[2] for module in modules() if module.count('.') > 2
                    and module.split('.')[1] == folder}) if height > 1 else []
    for number, room in enumerate(reversed(rooms)):
        base = floor + 0.4 + number * (height - 1.6) / len(rooms)
        axes.add_patch(FancyBboxPatch(
            (left + 0.3, base), right - left - 0.6, 0.75 * (height - 1.6) / len(rooms), lw=0.8,
            boxstyle='round,pad=0,rounding_size=0.09', facecolor='white', zorder=4,
            edgecolor=canvas.GREY))
        axes.text((left + right) / 2, base + 0.375 * (height - 1.6) / len(rooms), room,
                  ha='center', va='center', fontsize=9, zorder=5)
    axes.add_patch(FancyBboxPatch(
        (left, floor + 0.17), right - left, height - 0.34, lw=0.8, edgecolor=canvas.GREY,
        boxstyle='round,pad=0,rounding_size=0.09', facecolor=GROUPS[group][0], zorder=3))
    middle = floor + height - 0.5
    wide = right - left > WIDE
    axes.text((left + right) / 2, middle + (0.13 if wide else 0.0), folder, ha='center',
              va='center', zorder=5, fontsize=10, weight='bold')
    if wide:
        axes.text((left + right) / 2, middle - 0.16, purpose_of(folder), ha='center',
                  va='center', fontsize=7.5, color=canvas.GREY, zorder=5)


def purpose_of(folder):
    """Return the first sentence of a folder's docstring."""
    text = modules()[f'ballbot_ros.{folder}'].read_text(encoding='utf-8')
    first = ast.get_docstring(ast.parse(text)).split('\n')[0]
    return re.split(r'[.;]', first)[0].replace('`', '')


def way_of(edge):
    """Return the corners of an arrow, from the lower side of a box to the upper of another."""
    (left, right, floor, _, _), (low, high, below, height, _) = map(PLACES.get, edge)
    top = below + height - 0.17
    way = WAYS.get(edge, (max(left, low) + min(right, high)) / 2)
    if isinstance(way, list):
        return way
    x = min(max(way, left + 0.1), right - 0.1)
    return [(x, floor + 0.17), (min(max(x, low + 0.1), high - 0.1), top)]


def draw_arrow(axes, edge):
    """Draw an arrow with round corners."""
    way = way_of(edge)
    colour = {'offline': canvas.VERMILION, 'ros': canvas.BLUE, 'face': canvas.PURPLE}.get(
        PLACES[edge[0]][4], canvas.INK)
    points, codes = [way[0]], [Line.MOVETO]
    for before, corner, after in zip(way, way[1:], way[2:]):
        for end, code in ((before, Line.LINETO), (after, Line.CURVE3)):
            far = max(abs(end[0] - corner[0]), abs(end[1] - corner[1]))
            part = min(0.18, far / 2) / far if far else 0.0
            near = tuple(c + part * (e - c) for c, e in zip(corner, end))
            points += [near] if code == Line.LINETO else [corner, near]
            codes += [code] if code == Line.LINETO else [code, code]
    # The line ends inside the head, which points as its last piece runs.
    (x, y), (back_x, back_y) = way[-1], way[-2]
    length = math.hypot(back_x - x, back_y - y)
    along = ((back_x - x) / length, (back_y - y) / length)
    points.append((x + 0.12 * along[0], y + 0.12 * along[1]))
    codes.append(Line.LINETO)
    for width, paint, order in ((4.0, 'white', 1), (1.2, colour, 2)):
        axes.add_patch(PathPatch(Line(points, codes), fill=False, lw=width, edgecolor=paint,
                                 capstyle='butt', zorder=order,
                                 gid='-'.join(edge) if order == 2 else None))
    base = (x + 0.17 * along[0], y + 0.17 * along[1])
    side = (-0.08 * along[1], 0.08 * along[0])
    axes.add_patch(Polygon([(x, y), (base[0] + side[0], base[1] + side[1]),
                            (base[0] - side[0], base[1] - side[1])], color=colour, lw=0,
                           zorder=4))


def draw():
    """Return the figure and the arrows in it."""
    arrows = drawn_edges(folders(edges()))
    with canvas.drawing(9.6, 9.6) as figure:
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_xlim(0.0, 14.0)
        axes.set_ylim(-1.1, 14.4)
        axes.axis('off')
        for folder in PLACES:
            draw_box(axes, folder)
        for edge in arrows:
            draw_arrow(axes, edge)
        axes.add_patch(FancyBboxPatch((0.25, 1.0), 9.5, 4.95, lw=0, facecolor='#EFF7F3', zorder=0,
                                      boxstyle='round,pad=0,rounding_size=0.12'))
        draw_ground(axes)
        draw_legend(axes)
    return figure, arrows


def draw_ground(axes):
    """Draw what all stand on."""
    axes.add_patch(FancyBboxPatch(
        (0.2, 0.17), 13.6, 0.66, lw=0.8, edgecolor=canvas.GREY, zorder=3,
        boxstyle='round,pad=0,rounding_size=0.09', facecolor=GROUPS['ground'][0]))
    for number, folder in enumerate(GROUND):
        x = 13.6 * (number + 0.5) / len(GROUND) + 0.2
        axes.text(x, 0.5, folder, ha='center', va='center', fontsize=10, weight='bold', zorder=5)


def draw_legend(axes):
    """Say what colours and arrows mean."""
    for number, (colour, meaning) in enumerate(GROUPS.values()):
        x, y = 0.2 + 4.7 * (number % 3), -0.2 - 0.32 * (number // 3)
        axes.add_patch(FancyBboxPatch((x, y), 0.22, 0.18, lw=0.5, edgecolor=canvas.GREY,
                                      boxstyle='round,pad=0,rounding_size=0.04',
                                      facecolor=colour))
        axes.text(x + 0.34, y + 0.09, meaning, fontsize=8, va='center')
    axes.text(0.2, -0.85, 'An arrow: imports. Left out are imports of the ground floor, and those '
              'that a chain of arrows implies; from outside, physics is one house.',
              fontsize=8, va='center', color=canvas.GREY)


def main():
    """Draw into the folder on the command line, docs/figures by default."""
    from draw_docs import save_small
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / 'docs' / 'figures'
    figure, _ = draw()
    canvas.save(figure, folder / 'architecture.svg')
    save_small(figure, folder / 'architecture.png')


if __name__ == '__main__':
    main()
