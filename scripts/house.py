# SPDX-License-Identifier: Apache-2.0
"""
Measure the house: lines, kernels, words and arrows of ``ballbot_ros/``, in any checkout.

    .venv/bin/python scripts/house.py                     # this checkout
    .venv/bin/python scripts/house.py ../before . --markdown

Pairs of similar places are counted by pylint (not among the requirements) where it is installed,
or where ``--pylint`` says; without it they are left out.
"""
import argparse
import ast
from collections import Counter
import io
from pathlib import Path
import subprocess
import sys
import tokenize

ROOT = Path(__file__).resolve().parent.parent
NAME = 'ballbot_ros'
KERNEL_MARKS = {'compiled', 'inlined', 'outlined', 'unlocked'}
WORDS = ('contact_stiffness', 'accuracy', 'torque_limit')

SIMILAR = ('--disable=all', '--enable=duplicate-code', '--min-similarity-lines=3',
           '--ignore-imports=y', '--ignore-docstrings=y', '--ignore-comments=y',
           '--ignore-signatures=y')


def modules(root=ROOT):
    """Return {dotted name: path} of each module of the package in a checkout."""
    found = {}
    for path in sorted((root / NAME).rglob('*.py')):
        parts = path.relative_to(root).with_suffix('').parts
        found['.'.join(parts[:-1] if parts[-1] == '__init__' else parts)] = path
    return found


def imports(module, text, is_package=False):
    """Yield (line, dotted name) of each import at any depth: module, or module and name in it."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ''
            if node.level:
                parts = module.split('.')
                above = parts[:len(parts) - node.level + is_package]
                base = '.'.join([*above, *filter(None, [base])])
            yield from ((node.lineno, f'{base}.{alias.name}') for alias in node.names)


def edges(root=ROOT):
    """Return {module: the modules of the package that it imports}."""
    found = modules(root)
    graph = {}
    for module, path in found.items():
        names = (name for _, name in imports(module, path.read_text(encoding='utf-8'),
                                             path.name == '__init__.py'))
        # A name out of a module counts as an import of the module.
        ours = {name if name in found else name.rpartition('.')[0] for name in names}
        graph[module] = sorted((ours & set(found)) - {module, NAME})
    return graph


def folders(graph):
    """
    Return {folder: the folders that it imports} for a graph of modules.

    A folder is a first name below the package; inside physics, also the second.
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


def circles(graph):
    """Return the modules that import each other in a circle: what is left without its ends."""
    left = {module: set(names) for module, names in graph.items()}
    while ends := [module for module, names in left.items() if not names & set(left)]:
        for module in ends:
            del left[module]
    return sorted(left)


def docstring_lines(tree):
    """Return the numbers of the lines that docstrings take."""
    lines = set()
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)) and ast.get_docstring(
                node, clean=False) is not None:
            lines |= set(range(node.body[0].lineno, node.body[0].end_lineno + 1))
    return lines


class Source:
    """One file: its lines of code, the names that it uses, its kernels and classes."""

    def __init__(self, text):
        """Read it once by its tokens, and once by its tree."""
        tree = ast.parse(text)
        prose = docstring_lines(tree)
        skipped = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT,
                   tokenize.DEDENT, tokenize.ENDMARKER}
        self.lines = text.count('\n')
        self.code, self.words = set(), set()
        for token in tokenize.generate_tokens(io.StringIO(text).readline):
            if token.type not in skipped and token.start[0] not in prose:
                self.code |= set(range(token.start[0], token.end[0] + 1))
                self.words.add(token.string.strip('\'"'))
        self.classes = [node.name for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]
        self.kernels = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)
                        and any(isinstance(mark, ast.Name) and mark.id in KERNEL_MARKS
                                for mark in node.decorator_list)]


def kernel_figures(kernels):
    """Return number, most parameters, parameters typed Any, and most lines of kernels."""
    parameters = [kernel.args.posonlyargs + kernel.args.args for kernel in kernels]
    untyped = sum(item.annotation is None or 'Any' in ast.unparse(item.annotation)
                  for items in parameters for item in items)
    return {
        'kernels': len(kernels),
        'parameters of the kernel with most': max(map(len, parameters), default=0),
        'kernels with more than 8 parameters': sum(len(items) > 8 for items in parameters),
        'parameters of kernels typed `Any`': untyped,
        'lines of the longest kernel': max(
            (kernel.end_lineno - kernel.lineno + 1 for kernel in kernels), default=0)}


def similar_pairs(root, python):
    """Return how many pairs of places pylint finds similar, None where there is no pylint."""
    done = subprocess.run([python, '-m', 'pylint', *SIMILAR, NAME], cwd=root,
                          capture_output=True, text=True)
    return None if 'No module named' in done.stderr else done.stdout.count('R0801')


def measure(root, python=sys.executable):
    """Return {what: figure} of a checkout."""
    sources = [Source(path.read_text(encoding='utf-8')) for path in modules(root).values()]
    classes = Counter(name for source in sources for name in source.classes)
    figures = {
        'files': len(sources),
        'lines': sum(source.lines for source in sources),
        'lines of code, without docstrings and comments': sum(
            len(source.code) for source in sources),
        **kernel_figures([kernel for source in sources for kernel in source.kernels]),
        **{f'files through which `{word}` passes': sum(
            word in source.words for source in sources) for word in WORDS},
        'names that more than one class has': sum(times > 1 for times in classes.values()),
        'modules in circles of imports': len(circles(edges(root))),
        'pairs of similar places, by pylint': similar_pairs(root, python)}
    return {what: figure for what, figure in figures.items() if figure is not None}


def main():
    """Print the figures of each checkout side by side."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('checkouts', nargs='*', type=Path, default=[ROOT], metavar='CHECKOUT')
    parser.add_argument('--markdown', action='store_true', help='as a table for a document')
    parser.add_argument('--pylint', default=sys.executable, metavar='PYTHON',
                        help='the Python that has pylint (default: this one)')
    arguments = parser.parse_args()
    columns = [measure(root.resolve(), arguments.pylint) for root in arguments.checkouts]
    if arguments.markdown:
        print('| |' + ' |'.join(f' {root} ' for root in arguments.checkouts) + '|')
        print('|---' * (len(columns) + 1) + '|')
    for what in columns[0]:
        figures = [f'{column.get(what, ""):,}' for column in columns]
        print(f'| {what} | {" | ".join(figures)} |' if arguments.markdown else
              f'{what:48}' + ''.join(f'{figure:>12}' for figure in figures))


if __name__ == '__main__':
    main()
