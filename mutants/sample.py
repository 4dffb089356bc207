# SPDX-License-Identifier: Apache-2.0
"""
Find the places where a package can be mutated, and draw a sample of them by a seed.

One mutant is drawn for each place, so that an operator with many replacements does not crowd out
the others.  Each place is ranked by a digest of the seed, its function and its line: a change
elsewhere in the package, or a file that moves, leaves the rest of the sample as it was.
"""
import ast
from collections import Counter
from dataclasses import dataclass
import difflib
import hashlib

import operators
import skip

# Files that begin so stand in for a device in tests: a mutant there changes the test.
STAND_IN = 'emulated'


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
    way: str
    source: str  # the whole file with the change

    @property
    def name(self):
        """Name the mutant, wherever its file and its line are."""
        return self.function, self.line, self.to

    def told(self):
        """Say it as file:line with a small diff."""
        lines = [f'{self.path}:{self.number} in {self.function}  [{self.way}]']
        lines += [f'    - {text}' for text in self.line.split('\n')]
        lines += [f'    + {text}' for text in self.to.split('\n')]
        return '\n'.join(lines)


def digest(*words):
    """Rank something by chance that is the same in each run."""
    return hashlib.sha256('\0'.join(map(str, words)).encode()).hexdigest()


def places(text, seed):
    """Yield rank, start, function and the ways to mutate of each place in a file."""
    file = skip.File(text)
    lines = text.split('\n')
    found = {}
    for way in operators.ways(text):
        if not file.skips(way.start, way.end):
            # Left out or negated as a whole is another place than its first word.
            found.setdefault((way.start, way.whole), []).append(way)
    seen = Counter()
    for (start, whole), ways in sorted(found.items()):
        line = lines[start[0] - 1]
        key = (file.function(start[0]), line.strip(), whole,
               start[1] - len(line) + len(line.lstrip()))
        seen[key] += 1
        ways.sort(key=lambda way: digest(seed, *key, seen[key], way.name, way.text))
        yield digest(seed, *key, seen[key]), start, key[0], ways


def mutated(text, way):
    """Return the text with one change; None if that does not compile or changes nothing."""
    source = way.apply(text)
    try:
        compile(source, 'mutant', 'exec')
    except SyntaxError:
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

    If names of mutants are given in `again`, those are drawn, whatever their seed was.
    """
    begins = None if again is None else {(name[0], name[1].split('\n')[0]) for name in again}
    ranked = []
    for path in sorted((root / folder).rglob('*.py')):
        module = path.relative_to(root / folder).as_posix()
        if only in module and not path.name.startswith(STAND_IN):
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
            if source is None:
                continue
            number, line, to = changes(text, source)
            mutant = Mutant(package, path.relative_to(root).as_posix(), module, function,
                            number, line, to, way.name, source)
            if again is None or mutant.name in again:
                drawn.append(mutant)
            if again is None:
                break
    return drawn


def changes(text, source):
    """Return where two texts begin to differ, and the lines of each, stripped."""
    one, other = text.split('\n'), source.split('\n')
    blocks = [block for block in difflib.SequenceMatcher(None, one, other, False).get_opcodes()
              if block[0] != 'equal']
    first, last = blocks[0], blocks[-1]
    cut = ['\n'.join(line.strip() for line in lines)
           for lines in (one[first[1]:last[2]], other[first[3]:last[4]])]
    return first[1] + 1, *cut
