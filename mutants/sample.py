# SPDX-License-Identifier: Apache-2.0
"""
Find the places where a package can be mutated, and draw a sample of them by a seed.

The operators are those of cosmic-ray, less those that mostly make noise, and one of our own that
leaves a statement out.  One mutant is drawn for each place, so that an operator with many
replacements does not crowd out the others.  Each place is ranked by a digest of the seed, its
function and its line: a change elsewhere in the package, or a file that moves, leaves the rest of
the sample as it was.
"""
import ast
from collections import Counter
from dataclasses import dataclass
import difflib
import hashlib

from cosmic_ray.operators.operator import Operator
from cosmic_ray.operators.provider import OperatorProvider
import parso
from parso.python.tree import Keyword

import skip

# What an operator is replaced by.  The other replacements of cosmic-ray are killed by any test.
BINARY = {'Add': ('Sub',), 'Sub': ('Add',), 'Mul': ('Div',), 'Div': ('Mul',),
          'FloorDiv': ('Mul', 'Mod'), 'Mod': ('Mul', 'FloorDiv'), 'Pow': ('Mul',),
          'RShift': ('LShift',), 'LShift': ('RShift',), 'BitOr': ('BitAnd', 'BitXor'),
          'BitAnd': ('BitOr', 'BitXor'), 'BitXor': ('BitAnd', 'BitOr')}
COMPARISON = {'Lt': ('LtE', 'GtE'), 'LtE': ('Lt', 'Gt'), 'Gt': ('GtE', 'LtE'),
              'GtE': ('Gt', 'Lt'), 'Eq': ('NotEq',), 'NotEq': ('Eq',), 'Is': ('IsNot',),
              'IsNot': ('Is',)}
OTHERS = ('ReplaceUnaryOperator_USub_UAdd', 'ReplaceUnaryOperator_Delete_Invert',
          'ReplaceUnaryOperator_Delete_Not', 'AddNot', 'ReplaceTrueWithFalse',
          'ReplaceFalseWithTrue', 'ReplaceAndWithOr', 'ReplaceOrWithAnd',
          'ReplaceBreakWithContinue', 'ReplaceContinueWithBreak', 'ExceptionReplacer',
          'NumberReplacer', 'ZeroIterationForLoop')


class LeaveOut(Operator):
    """Replace a call whose value nobody takes, or a change of an object, by `pass`."""

    def mutation_positions(self, node):
        if node.type == 'simple_stmt':
            first = node.children[0]
            target = first.children[0] if first.type == 'expr_stmt' else first
            if target.type == 'atom_expr' or first.type == 'expr_stmt' \
                    and first.children[1].type == 'operator' and first.children[1].value != '=':
                yield first.start_pos, first.end_pos

    def mutate(self, node, index):
        first = node.children[0]
        prefix = first.get_first_leaf().prefix
        node.children[0] = Keyword('pass', first.start_pos, prefix)
        return node

    @classmethod
    def examples(cls):
        return ()


@dataclass(frozen=True)
class Mutant:
    """One change of one file."""

    package: str
    path: str  # from the root of the checkout
    module: str  # from the folder of the package
    function: str
    number: int  # of the first line that changes
    line: str  # what stands there, without the space around it
    to: str  # what is put there
    operator: str
    source: str  # the whole file with the change

    @property
    def name(self):
        """Name the mutant, wherever its file and its line are."""
        return self.function, self.line, self.to

    def told(self):
        """Say it as file:line with a small diff."""
        lines = [f'{self.path}:{self.number} in {self.function}  [{self.operator}]']
        lines += [f'    - {text}' for text in self.line.split('\n')]
        lines += [f'    + {text}' for text in self.to.split('\n')]
        return '\n'.join(lines)


def operators():
    """Make one of each operator, by its name."""
    known = OperatorProvider()
    names = [f'Replace{kind}Operator_{one}_{other}'
             for kind, table in (('Binary', BINARY), ('Comparison', COMPARISON))
             for one, others in table.items() for other in others]
    return {**{name: known[name]() for name in (*names, *OTHERS)}, 'LeaveOut': LeaveOut()}


def nodes(node):
    """List a tree of parso from the root down."""
    yield node
    for child in getattr(node, 'children', ()):
        yield from nodes(child)


def digest(*words):
    """Rank something by chance that is the same in each run."""
    return hashlib.sha256('\0'.join(map(str, words)).encode()).hexdigest()


def places(text, seed):
    """Yield rank, start, function and the ways to mutate of each place in a file."""
    file = skip.File(text)
    lines = text.split('\n')
    found = {}
    for ordinal, node in enumerate(nodes(parso.parse(text))):
        for name, operator in operators().items():
            try:
                spots = list(operator.mutation_positions(node))
            except (AttributeError, IndexError):  # what the operator has not thought of
                continue
            for index, (start, end) in enumerate(spots):
                if not file.skips(start, end):
                    # Left out or negated as a whole is another place than its first word.
                    found.setdefault((start, name in ('LeaveOut', 'AddNot')), []).append(
                        (name, ordinal, index))
    seen = Counter()
    for (start, whole), ways in sorted(found.items()):
        line = lines[start[0] - 1]
        key = (file.function(start[0]), line.strip(), whole,
               start[1] - len(line) + len(line.lstrip()))
        seen[key] += 1
        ways.sort(key=lambda way: digest(seed, *key, seen[key], way[0], way[2]))
        yield digest(seed, *key, seen[key]), start, key[0], ways


def mutated(text, way):
    """Return the text with one change; None if that does not compile or changes nothing."""
    name, ordinal, index = way
    tree = parso.parse(text)
    node = next(node for count, node in enumerate(nodes(tree)) if count == ordinal)
    try:
        changed = operators()[name].mutate(node, index)
        if name == 'NumberReplacer':
            node.value = changed.value.strip()  # keeps the space or line before the number
        source = tree.get_code()
        compile(source, 'mutant', 'exec')
    except (AttributeError, IndexError, SyntaxError, AssertionError):
        return None
    return None if ast.dump(ast.parse(source)) == ast.dump(ast.parse(text)) else source


def lines(root, folder):
    """List module, function and text of all lines of a package."""
    for path in (root / folder).rglob('*.py'):
        text = path.read_text(encoding='utf-8')
        file, module = skip.File(text), path.relative_to(root / folder).as_posix()
        for number, line in enumerate(text.split('\n'), 1):
            yield module, file.function(number), line.strip()


def draw(root, package, folder, seed, count, only='', again=None):
    """
    Draw mutants of the files below a folder whose path contains a word; count None: all.

    If names of mutants are given in `again`, none but those are drawn.
    """
    begins = None if again is None else {(name[0], name[1].split('\n')[0]) for name in again}
    ranked = []
    for path in sorted((root / folder).rglob('*.py')):
        module = path.relative_to(root / folder).as_posix()
        if only in module:
            text = path.read_text(encoding='utf-8')
            found = places(text, seed)
            if begins is not None:
                line = [line.strip() for line in text.split('\n')]
                found = (place for place in found if (place[2], line[place[1][0] - 1]) in begins)
            ranked += [(*place, path, module, text) for place in found]
    ranked.sort(key=lambda place: (place[0], place[5], place[1]))
    drawn = []
    for _, start, function, ways, path, module, text in ranked:
        if count is not None and len(drawn) == count:
            break
        for way in ways:
            source = mutated(text, way)
            if source is not None:
                number, line, to = changes(text, source)
                drawn.append(Mutant(package, path.relative_to(root).as_posix(), module, function,
                                    number, line, to, way[0], source))
                break
    return [mutant for mutant in drawn if again is None or mutant.name in again]


def changes(text, source):
    """Return where two texts begin to differ, and the lines of each, stripped."""
    one, other = text.split('\n'), source.split('\n')
    blocks = [block for block in difflib.SequenceMatcher(None, one, other, False).get_opcodes()
              if block[0] != 'equal']
    first, last = blocks[0], blocks[-1]
    cut = [' '.join(lines).strip() if not lines else '\n'.join(text.strip() for text in lines)
           for lines in (one[first[1]:last[2]], other[first[3]:last[4]])]
    return first[1] + 1, *cut
