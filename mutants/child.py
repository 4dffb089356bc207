# SPDX-License-Identifier: Apache-2.0
"""
What a forked child does: put one mutated module in the place of the original, run the tests.

The module is mutated in memory as it is imported; no file is changed.  A process that a test
starts anew sees the original: the unit tests of the packages start none.
"""
import importlib.abc
import importlib.machinery
import importlib.util
import json
import os
from pathlib import Path
import resource
import signal
import sys
import traceback

import pytest

MEMORY = 4 * 2**30  # bytes, for a mutant that never stops appending
FILE = 2**30


class Overlay(importlib.abc.MetaPathFinder):
    """Import one module from a text instead of from its file."""

    def __init__(self, name, path, source):
        self._name, self._path, self._source = name, str(path), source

    def find_spec(self, fullname, path=None, target=None):
        if fullname != self._name:
            return None
        source = self._source

        class Loader(importlib.machinery.SourceFileLoader):
            def get_code(self, fullname):
                return compile(source, self.path, 'exec', dont_inherit=True)

        return importlib.util.spec_from_file_location(
            fullname, self._path, loader=Loader(fullname, self._path))


class Watcher:
    """Note what fails and what each file takes; end a test that takes far too long."""

    def __init__(self, limits, end):
        self.failed, self.seconds, self.longest, self.tests = [], {}, {}, 0
        self._limits, self._end = limits, end

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection(self):
        """Let hypothesis try the same examples in each run, and not look for a simpler one."""
        if 'hypothesis' in sys.modules:  # conftest.py has chosen its profile by now
            from hypothesis import Phase, settings
            settings.register_profile('mutants', settings(), derandomize=True, database=None,
                                      deadline=None, phases=(Phase.explicit, Phase.generate))
            settings.load_profile('mutants')

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item):
        self.tests += 1
        file = item.nodeid.split('::')[0]
        if file in self._limits:
            signal.signal(signal.SIGALRM, lambda *_: self._end(item.nodeid))
            signal.setitimer(signal.ITIMER_REAL, self._limits[file])
        try:
            return (yield)
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)

    def pytest_runtest_logreport(self, report):
        file = report.nodeid.split('::')[0]
        self.seconds[file] = self.seconds.get(file, 0.0) + report.duration
        self.longest[file] = max(self.longest.get(file, 0.0), report.duration)
        if report.failed:
            self.failed.append(report.nodeid)

    def pytest_collectreport(self, report):
        if report.failed:
            self.failed.append(report.nodeid or 'collection')


def run(tree, folder, files, overlay=None, limits=None, without=()):
    """Run the tests and leave result.json in a folder; does not return."""
    try:
        os.setsid()
        _shut_in(tree, folder)
        result = folder / 'result.json'

        def end(test):
            _write(result, outcome='timeout', killer=test)
            os._exit(0)

        watcher = Watcher(limits or {}, end)
        sys.dont_write_bytecode = overlay is not None
        if overlay is not None:
            sys.meta_path.insert(0, overlay)
        (folder / 'ready').touch()  # what goes wrong from here on is the work of the mutant
        code = int(pytest.main(
            ['-q', *['-x'] * (overlay is not None), '-p', 'no:cacheprovider', '--rootdir',
             str(tree), '--basetemp', str(folder / 'tmp'),
             *[f'--deselect={test}' for test in without], *files], plugins=[watcher]))
        killer = watcher.failed[0] if watcher.failed else ''
        _write(result, outcome='killed' if code else 'survived', code=code, killer=killer,
               failed=watcher.failed, seconds=watcher.seconds, longest=watcher.longest,
               tests=watcher.tests)
    except BaseException:  # noqa: BLE001  (a child must never return into its parent)
        traceback.print_exc()
        sys.stderr.flush()
    finally:
        os._exit(0)


def _write(path, **said):
    partial = Path(f'{path}.new')
    partial.write_text(json.dumps(said), encoding='utf-8')
    partial.replace(path)


def _shut_in(tree, folder):
    """Keep what a mutant does in its folder, and within bounds."""
    log = os.open(folder / 'log', os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
    for stream in (1, 2):
        os.dup2(log, stream)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.chdir(tree)
    sys.path.insert(0, str(tree))
    temporary = folder / 'tmpdir'
    temporary.mkdir()
    os.environ.update(CI='1', PYTHONPATH=str(tree), TMPDIR=str(temporary))
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_FSIZE, (FILE, FILE))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
