# SPDX-License-Identifier: Apache-2.0
"""What is not worth a mutant: annotations, decorators, `__all__`, and the texts of errors."""
import ast


class File:
    """The parts of a file by line and column, as parso counts them."""

    def __init__(self, text):
        self._lines = text.split('\n')
        self._skipped = []
        self._functions = []
        self._walk(ast.parse(text), ())

    def skips(self, start, end):
        """Say whether what lies from start to end is part of something that is skipped."""
        return any(begin <= start and end <= stop for begin, stop in self._skipped)

    def function(self, line):
        """Return the full name of the innermost function or class around a line."""
        around = [(first, name) for first, last, name in self._functions if first <= line <= last]
        return max(around)[1] if around else '<module>'

    def _walk(self, node, names):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            names = (*names, node.name)
            self._functions.append((node.lineno, node.end_lineno, '.'.join(names)))
            self._skip(*node.decorator_list)
        if isinstance(node, ast.Raise):
            self._skip(node.exc, node.cause)
        for field in ('annotation', 'returns'):
            self._skip(getattr(node, field, None))
        if isinstance(node, ast.Assign) and not names:
            name = getattr(node.targets[0], 'id', '')
            bar = isinstance(getattr(node.value, 'op', None), ast.BitOr)
            if name == '__all__' or bar:  # a union of types
                self._skip(node)
        for child in ast.iter_child_nodes(node):
            self._walk(child, names)

    def _skip(self, *nodes):
        for node in nodes:
            if node is not None:
                self._skipped.append((self._place(node.lineno, node.col_offset),
                                      self._place(node.end_lineno, node.end_col_offset)))

    def _place(self, line, column):
        """Count the column in characters; ast counts bytes."""
        return line, len(self._lines[line - 1].encode()[:column].decode())
