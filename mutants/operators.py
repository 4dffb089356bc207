# SPDX-License-Identifier: Apache-2.0
"""
The ways to change a file a little: those of cosmic-ray, less what mostly makes noise.

One of our own leaves a statement out.  parso reads the file, for it knows the places inside
f-strings on every Python.
"""
import ast
from dataclasses import dataclass

import parso

# What an operator is replaced by.  All other replacements are killed by any test.
BINARY = {'+': '-', '-': '+', '*': '/', '/': '*', '//': ('*', '%'), '%': ('*', '//'), '**': '*',
          '>>': '<<', '<<': '>>', '|': '&^', '&': '|^', '^': '&|'}
COMPARISON = {'<': ('<=', '>='), '<=': ('<', '>'), '>': ('>=', '<='), '>=': ('>', '<'),
              '==': ('!=',), '!=': ('==',), 'is': ('is not',), 'is not': ('is',)}
UNARY = {'-': '+', '~': '', 'not': ''}
KEYWORDS = {'True': 'False', 'False': 'True', 'and': 'or', 'or': 'and', 'break': 'continue',
            'continue': 'break'}
# Where a sign or a star is no operation between two values.
NOT_BINARY = ('factor', 'argument', 'star_expr', 'import_from', 'param')
UNRELATED = 'StopAsyncIteration'  # in place of the exception that a handler waits for


@dataclass(frozen=True)
class Way:
    """One text in place of another; lines from 1, columns in characters from 0."""

    name: str
    start: tuple
    end: tuple
    text: str

    def apply(self, text):
        """Return the text of a file with this change."""
        lines = text.split('\n')
        after = lines[self.end[0] - 1][self.end[1]:]
        before = lines[self.start[0] - 1][:self.start[1]]
        lines[self.start[0] - 1:self.end[0]] = [before + self.text + after]
        return '\n'.join(lines)

    @property
    def whole(self):
        """Return whether this changes a statement or a condition, and not its first word."""
        return self.name in ('leave out', 'negate')


def ways(text):
    """List all ways to change the text of a file."""
    waiting = [parso.parse(text)]
    while waiting:
        node = waiting.pop()
        waiting += getattr(node, 'children', ())
        for name, part, replacement in _changes(node):
            yield Way(name, part.start_pos, part.end_pos, replacement)


def _changes(node):
    """Yield name, part and text of what a single node can become."""
    kind, children, value = node.type, getattr(node, 'children', ()), getattr(node, 'value', '')
    if kind == 'operator' and value in BINARY and node.parent.type not in NOT_BINARY:
        for other in BINARY[value]:
            yield f'{value} -> {other}', node, other
    elif kind == 'comparison':
        for part in children[1::2]:
            word = ' '.join(part.get_code().split())
            for other in COMPARISON.get(word, ()):
                yield f'{word} -> {other}', part, other
    elif kind in ('factor', 'not_test') and children[0].value in UNARY:
        yield f'{children[0].value} dropped', children[0], UNARY[children[0].value]
    elif kind == 'keyword' and value in KEYWORDS:
        yield f'{value} -> {KEYWORDS[value]}', node, KEYWORDS[value]
    elif kind == 'number':
        for offset in (1, -1):
            yield f'number {offset:+d}', node, str(ast.literal_eval(value) + offset)
    elif kind == 'for_stmt':
        yield 'no iteration', children[3], '[]'
    elif kind == 'except_clause':
        part = children[1]
        names = part.children[1:-1] if part.type == 'atom' else [part]
        names = names[0].children[::2] if names[0].type == 'testlist_comp' else names
        for name in names:
            yield 'exception', name, UNRELATED
    elif kind == 'simple_stmt':
        first = children[0]
        target = first.children[0] if first.type == 'expr_stmt' else first
        # A call whose value nobody takes, or a change of an object.
        if target.type == 'atom_expr' or first.type == 'expr_stmt' \
                and first.children[1].type == 'operator' and first.children[1].value != '=':
            yield 'leave out', first, 'pass'
    if kind in ('if_stmt', 'while_stmt', 'assert_stmt', 'test', 'ternary'):
        part = children[2 if kind in ('test', 'ternary') else 1]
        yield 'negate', part, f'not {part.get_code(include_prefix=False)}'
