# SPDX-License-Identifier: Apache-2.0
"""
Run the tests of a package once for each mutant, each in a forked child of this process.

This process has imported what takes long, but nothing of the package that is mutated.  The tests
are those of a private copy of the checkout; the path of the copy stays the same from run to run,
so that the kernels compiled for it are found again.
"""
from collections import Counter
import compileall
from contextlib import suppress
import hashlib
import importlib
import json
import os
from pathlib import Path
import py_compile
import shutil
import signal
import sys
import time

import child

# A test is ended after this many times what the slowest of its file takes, and these seconds.
PATIENCE, GRACE = 5.0, 20.0
LEFT_OUT = ('.*', '__pycache__', '*.egg-info', 'build', 'install', 'log', 'out', 'found')
PRELOADED = ('numpy', 'scipy.linalg', 'scipy.optimize', 'scipy.stats', 'numba', 'yaml', 'serial',
             'hypothesis', 'hypothesis.strategies', 'xdist', 'pytest_cov.plugin')


def copy(root, tree):
    """Copy a checkout, compiled to byte code that knows the text which it was made from."""
    shutil.rmtree(tree, ignore_errors=True)
    shutil.copytree(root, tree, ignore=shutil.ignore_patterns(*LEFT_OUT))
    compileall.compile_dir(tree, quiet=2, workers=1,
                           invalidation_mode=py_compile.PycInvalidationMode.CHECKED_HASH)


def preload(root, tree, modules):
    """Import from the copy, and never from a checkout, what every child needs."""
    sys.path[:] = [str(tree)] + [path for path in sys.path if path not in ('', str(root))
                                 and not (Path(path) / 'setup.py').exists()]
    for name in (*PRELOADED, *modules):
        with suppress(ImportError):
            importlib.import_module(name)


class Package:
    """The tests of one package, and what is known about them."""

    def __init__(self, tree, folder, tests, work):
        self.tree, self.folder, self.work = tree, folder, work
        self.files = sorted(path.relative_to(tree).as_posix() for name in tests
                            for path in ([tree / name] if name.endswith('.py')
                                         else (tree / name).rglob('test_*.py')))
        self.kills = {}
        self.without, self.seconds, self.limits, self.whole = [], {}, {}, GRACE
        top = folder.replace('/', '.')
        loaded = [name for name in sys.modules if f'{name}.'.startswith(f'{top}.')]
        if loaded:
            raise RuntimeError(f'imported before it is mutated: {loaded}')

    def digest(self, tests):
        """Name the sources and the tests that the outcomes hold for."""
        digest = hashlib.sha256()
        for top in (self.folder.split('/')[0], *tests):
            for path in sorted([*(self.tree / top).rglob('*.py'), self.tree / top]):
                if path.is_file():
                    digest.update(path.relative_to(self.tree).as_posix().encode())
                    digest.update(path.read_bytes())
        return digest.hexdigest()[:16]

    def baseline(self):
        """Run the tests without a mutant; tests that fail then are left out and returned."""
        slot = _Slot(self.work / 'baseline')
        slot.start(lambda: child.run(self.tree, slot.folder, self.files), None, 3600.0)
        while not slot.done():
            time.sleep(0.05)
        said = slot.result()
        if said.get('code') not in (0, 1) or len(said['failed']) >= said['tests']:
            raise RuntimeError(f'the tests do not run: see {slot.folder / "log"}')
        self.without, self.seconds = said['failed'], said['seconds']
        self.limits = {file: GRACE + PATIENCE * most for file, most in said['longest'].items()}
        self.whole = GRACE + PATIENCE * sum(self.seconds.values())
        return self.without

    def order(self, module):
        """Put first the tests that killed mutants of a module, or have its name; then the fast."""
        words = set(module.removesuffix('.py').replace('/', '_').split('_'))
        kills = self.kills.get(module, Counter())

        def key(file):
            named = len(words & set(Path(file).stem.split('_')))
            return -named - 2 * kills[file], self.seconds.get(file, 0.0), file
        return sorted(self.files, key=key)

    def run(self, mutants, jobs, tell):
        """Run all mutants, so many at once, and tell each outcome as it comes."""
        waiting = list(reversed(mutants))
        slots = [_Slot(self.work / f'slot{number}') for number in range(jobs)]
        try:
            while waiting or any(slot.mutant for slot in slots):
                for slot in slots:
                    if slot.mutant and slot.done():
                        self._tell(slot, tell)
                    if waiting and not slot.mutant:
                        self._start(slot, waiting.pop())
                time.sleep(0.02)
        finally:
            for slot in slots:
                slot.stop()

    def _start(self, slot, mutant):
        path = self.tree / mutant.path
        name = mutant.path.removesuffix('.py').removesuffix('/__init__').replace('/', '.')
        slot.start(lambda: child.run(
            self.tree, slot.folder, self.order(mutant.module),
            child.Overlay(name, path, mutant.source), self.limits, self.without),
            mutant, self.whole)

    def _tell(self, slot, tell):
        said, mutant = slot.result(), slot.mutant
        slot.mutant = None
        file = said.get('killer', '').split('::')[0]
        if said['outcome'] != 'survived' and file in self.files:
            self.kills.setdefault(mutant.module, Counter())[file] += 1
        tell(mutant, said['outcome'], said.get('killer', ''), time.monotonic() - slot.begin)


class _Slot:
    """A place for one child at a time."""

    def __init__(self, folder):
        self.folder, self.mutant, self._process = folder, None, None
        self.begin, self._limit, self._late = 0.0, 0.0, False

    def start(self, work, mutant, limit):
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir(parents=True)
        self.mutant, self.begin, self._limit = mutant, time.monotonic(), limit
        self._late = False
        sys.stdout.flush()
        sys.stderr.flush()
        self._process = os.fork()
        if self._process == 0:
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            work()
            os._exit(70)

    def done(self):
        process, _ = os.waitpid(self._process, os.WNOHANG)
        if process:
            self._end()
            return True
        if time.monotonic() - self.begin > self._limit:
            self._late = True
            self.stop()
            return True
        return False

    def result(self):
        """Return what the child wrote; one that could not write crashed or hung."""
        if not (self.folder / 'ready').exists():
            raise RuntimeError(f'no test was run: see {self.folder / "log"}')
        try:
            return json.loads((self.folder / 'result.json').read_text(encoding='utf-8'))
        except (OSError, ValueError):
            return {'outcome': 'timeout' if self._late else 'killed', 'killer': 'a crash'}

    def stop(self):
        if self._process:
            with suppress(ProcessLookupError):
                os.kill(self._process, signal.SIGKILL)
            os.waitpid(self._process, 0)
            self._end()

    def _end(self):
        """End what the child has started and left behind: it led a group of its own."""
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process, signal.SIGKILL)
        self._process = None
