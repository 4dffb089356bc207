# SPDX-License-Identifier: Apache-2.0
"""
Measure the structure of ``ballbot_ros/``: size, fan-in, import cycles and reading paths.

    .venv/bin/python scripts/structure.py                     # this checkout
    .venv/bin/python scripts/structure.py ../before . --markdown
    .venv/bin/python scripts/structure.py --paths             # modules of four reading paths
"""
import argparse
import ast
from collections import Counter
import fnmatch
from functools import cache
import io
import json
import os
from pathlib import Path
import subprocess
import sys
import tokenize

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
NAME = 'ballbot_ros'
KERNEL_DECORATORS = {'compiled', 'outlined', 'unlocked'}

# Each task runs in a separate process without compilation, so that the profiler records kernels.
PATHS = {
    'scene file to trajectory': """
from ballbot_ros.physics import load_scene
def task():
    load_scene('fig7_top').simulate(0.003)
""",
    'set-point to bytes on the line': """
import sys
from pathlib import Path
sys.path.append(str(next(Path('test').rglob('virtual_robot.py')).parent))
from virtual_robot import VirtualRobot
from ballbot_ros.control import Mode, SetPoint
robot = VirtualRobot('odrive', onboard='gentle').ready()
for name in ('pass_time', 'read', 'write', 'wait', 'live'):  # drive and ball, not the bridge
    if hasattr(robot, name):
        leave_out(robot, name)
def task():
    robot.loop(0.05, SetPoint(Mode.HOLD, 0.1, robot.now))
""",
    'terrain observation to set angle': """
from ballbot_ros.decision import *
from ballbot_ros.physics import load_scene
from ballbot_ros.plant import TerrainSensor
scene = load_scene('doorstep')
robot, state = scene.model.robot, scene.start
knowledge = Knowledge(robot, load_curve('gimball_down'), load_decision_tuning('decision_default'))
decider = Decider(knowledge, planner='rollout')
camera = TerrainSensor(scene.model.terrain, reach=3.0, height_sd=0.001)
seen = [camera.measure(state.x, state.y, number) for number in range(20)]
def task():
    for number, view in enumerate(seen):
        time = 0.02 * number
        decider.observe(
            TerrainObservation(time, view.x, view.z, view.z_sd, view.x_min, view.x_max))
        decider.move(Motion(time, state.x, 0.0))
        decider.decide()
""",
    '`max-step-height` to its number': """
import ballbot_ros.cli.max_step_height, ballbot_ros.crossing, ballbot_ros.physics
from ballbot_ros.cli.command import main
def task():
    main(['max-step-height', '--speed', '0.8', '--json'])
""",
}


# Functions that import the module named by their first argument.
LOADERS = {'import_module', 'load_optional', 'from_ros'}
# `Trajectory.plot`, `save` and `summary`, shortcuts for users, import upper layers when called.
LATE = {('ballbot_ros.physics.simulation.trajectory', name) for name in (
    'ballbot_ros.results.summary.summarise', 'ballbot_ros.results.files.write_trajectory',
    'ballbot_ros.figures.canvas', 'ballbot_ros.figures.panels')}


def modules(root=ROOT):
    """Return {dotted name: path} of each module of the package in a checkout."""
    found = {}
    for path in sorted((root / NAME).rglob('*.py')):
        parts = path.relative_to(root).with_suffix('').parts
        found['.'.join(parts[:-1] if parts[-1] == '__init__' else parts)] = path
    return found


@cache
def tree_of(path):
    """Return the syntax tree of a file."""
    return ast.parse(path.read_text(encoding='utf-8'))


@cache
def nodes_of(tree):
    """Return the import statements, the calls and the constants of a syntax tree."""
    return [node for node in ast.walk(tree)
            if isinstance(node, (ast.Import, ast.ImportFrom, ast.Call, ast.Constant))]


def imports(module, text, is_package=False):
    """
    Yield (line, dotted name) of each import at any depth; the name may follow the module.

    `text` is source text or its syntax tree.
    """
    for node in nodes_of(text if isinstance(text, ast.AST) else ast.parse(text)):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ''
            if node.level:
                parts = module.split('.')
                above = parts[:len(parts) - node.level + is_package]
                base = '.'.join([*above, *filter(None, [base])])
            yield from ((node.lineno, f'{base}.{alias.name}') for alias in node.names)
        elif isinstance(node, ast.Call) and node.args and getattr(
                node.func, 'attr', getattr(node.func, 'id', '')) in LOADERS:
            # The variable parts of an f-string are names, but never `__main__`.
            parts = getattr(node.args[0], 'values', [node.args[0]])
            if isinstance(parts[0], ast.Constant):
                yield node.lineno, ''.join(
                    part.value if isinstance(part, ast.Constant) else '[!_]*' for part in parts)


def edges(root=ROOT):
    """Return {module: imported modules of the package}."""
    found = modules(root)
    graph = {}
    for module, path in found.items():
        names = (one for _, name in imports(module, tree_of(path), path.name == '__init__.py')
                 if (module, name) not in LATE
                 for one in fnmatch.filter(found, name) or [name])
        # An imported name counts as an import of its module.
        ours = {name if name in found else name.rpartition('.')[0] for name in names}
        graph[module] = sorted((ours & set(found)) - {module, NAME})
    return graph


def folders(graph):
    """
    Return {folder: imported folders} for a graph of modules.

    A folder is the first name below the package; inside physics, the first two names.
    """
    found = {}
    for module, names in graph.items():
        if module != NAME:
            others = {folder_of(name) for name in names} - {folder_of(module)}
            found.setdefault(folder_of(module), set()).update(others)
    return found


def folder_of(module):
    """Return the folder of a module."""
    parts = module.split('.')[1:]
    return '.'.join(parts[:2] if parts[0] == 'physics' else parts[:1])


def cycles(graph):
    """Return the sorted modules that are part of an import cycle."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    names = sorted({*graph, *(name for others in graph.values() for name in others)})
    index = {name: number for number, name in enumerate(names)}
    pairs = [(index[name], index[other]) for name, others in graph.items() for other in others]
    matrix = coo_array((np.ones(len(pairs)), np.array(pairs, dtype=int).reshape(-1, 2).T),
                       shape=(len(names), len(names)))
    _, label = connected_components(matrix, connection='strong')
    size = Counter(label)
    return [name for name in names if size[label[index[name]]] > 1]


class Source:
    """Lines of one file by kind, its definitions, and the names that it calls."""

    def __init__(self, text):
        tree = ast.parse(text)
        self.lines = text.count('\n')
        docstrings = set()
        for node in ast.walk(tree):
            if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef,
                                 ast.AsyncFunctionDef)) and ast.get_docstring(node, clean=False):
                docstrings |= set(range(node.body[0].lineno, node.body[0].end_lineno + 1))
        self.docstrings = len(docstrings)
        layout = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT,
                  tokenize.DEDENT, tokenize.ENDMARKER}
        code = set()
        for token in tokenize.generate_tokens(io.StringIO(text).readline):
            if token.type not in layout and token.start[0] not in docstrings:
                code |= set(range(token.start[0], token.end[0] + 1))
        self.code = len(code)
        functions = [node for node in ast.walk(tree)
                     if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))]
        self.kernels = sum(any(getattr(mark, 'id', getattr(getattr(mark, 'func', None), 'id', ''))
                               in KERNEL_DECORATORS for mark in node.decorator_list)
                           for node in functions)
        self.functions = [node.name for node in functions if not node.name.startswith('__')]
        self.uses = Counter(
            node.id if isinstance(node, ast.Name) else node.attr
            for node in ast.walk(tree) if isinstance(node, (ast.Name, ast.Attribute)))


def measure(root):
    """Return {quantity: value} of a checkout."""
    sources = {name: Source(path.read_text(encoding='utf-8'))
               for name, path in modules(root).items()}
    graph = edges(root)
    importers = Counter(name for names in graph.values() for name in names)
    uses = sum((source.uses for source in sources.values()), Counter())
    defined = Counter(name for source in sources.values() for name in source.functions)
    return {
        'files': len(sources),
        'lines': sum(source.lines for source in sources.values()),
        'lines of code': sum(source.code for source in sources.values()),
        'lines of docstrings': sum(source.docstrings for source in sources.values()),
        'functions': sum(defined.values()),
        'kernels': sum(source.kernels for source in sources.values()),
        'modules with one importer': sum(times == 1 for times in importers.values()),
        'functions referred to once': sum(times == 1 and uses[name] == 1
                                          for name, times in defined.items()),
        'modules in import cycles': len(cycles(graph))}


def modules_run(root, task):
    """Return the sorted modules whose functions a task calls in a checkout."""
    program = f"""
import json, os, sys, threading
files_run = set()
def note(frame, event, arg):
    if event == 'call' and frame.f_code.co_name != '<module>':
        files_run.add(frame.f_code.co_filename)
def leave_out(owner, name):
    function = getattr(owner, name)
    def call(*words, **named):
        before = sys.getprofile()
        sys.setprofile(None)
        try:
            return function(*words, **named)
        finally:
            sys.setprofile(before)
    setattr(owner, name, call)
{task}
threading.setprofile(note); sys.setprofile(note)
out = sys.stdout
sys.stdout = open(os.devnull, 'w')
try:
    task()
except SystemExit:
    pass
sys.setprofile(None); threading.setprofile(None)
root = {str(root / NAME) + os.sep!r}
found = (name[len(root):] for name in files_run if name.startswith(root))
print(json.dumps(sorted(found)), file=out)
"""
    done = subprocess.run(
        [sys.executable, '-c', program], cwd=root, capture_output=True, text=True,
        env={**os.environ, 'BALLBOT_UNCOMPILED': '1', 'PYTHONPATH': str(root)})
    if done.returncode:
        sys.exit(done.stderr)
    return json.loads(done.stdout)


def main():
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('checkouts', nargs='*', type=Path, default=[ROOT], metavar='CHECKOUT')
    parser.add_argument('--markdown', action='store_true', help='print a table for a document')
    parser.add_argument('--paths', action='store_true',
                        help='also count the modules that each reading path runs through')
    parser.add_argument('--list', action='store_true', help='list the modules of each path')
    arguments = parser.parse_args()
    columns = []
    for root in (path.resolve() for path in arguments.checkouts):
        column = measure(root)
        if arguments.paths or arguments.list:
            for title, task in PATHS.items():
                found = modules_run(root, task)
                column[f'modules: {title}'] = len(found)
                if arguments.list:
                    print(f'{title}:', *found, sep='\n  ')
        columns.append(column)
    if arguments.markdown:
        print('| |' + ' |'.join(f' {root} ' for root in arguments.checkouts) + '|')
        print('|---' * (len(columns) + 1) + '|')
    for quantity in columns[0]:
        figures = [f'{column.get(quantity, ""):,}' for column in columns]
        print(f'| {quantity} | {" | ".join(figures)} |' if arguments.markdown else
              f'{quantity:48}' + ''.join(f'{figure:>12}' for figure in figures))


if __name__ == '__main__':
    main()
