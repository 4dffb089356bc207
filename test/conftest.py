# SPDX-License-Identifier: Apache-2.0
"""Configuration and fixtures of all tests; this file does not need ROS."""
from collections import Counter
import os
from pathlib import Path
import re
import sys

# Otherwise child processes, such as pytest-xdist workers, would compile all modules at each start.
os.environ.pop('PYTHONDONTWRITEBYTECODE', None)

# Before numpy is imported: two workers whose matrix products take all cores wait for each other.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import hypothesis
import pytest

from ballbot_ros import compile_notice

# It is random which test compiles a kernel first; a separate test checks the notice of a delay.
compile_notice.REPORT_AFTER = float('inf')

# Independent implementations as references, and helpers.
for folder in ('oracles', 'helpers'):
    sys.path.append(str(Path(__file__).resolve().parent / folder))

# The first call of a kernel may compile it, so examples have no deadline.  CI repeats the same
# examples, so that a failure is due to a change of the code and not to chance.
hypothesis.settings.register_profile('local', deadline=None)
hypothesis.settings.register_profile('ci', deadline=None, derandomize=True)
hypothesis.settings.load_profile('ci' if os.environ.get('CI') else 'local')


ROOT = Path(__file__).resolve().parent.parent


def pytest_configure(config):
    """Run the quick tier by default where colcon runs the tests; see docs/packaging.md."""
    # Rewriting the assertions of all tests takes 14 CPU s, only once if bytecode is kept.
    sys.dont_write_bytecode = False
    default = config.args_source is not pytest.Config.ArgsSource.ARGS
    if os.environ.get('COLCON') and default and not config.option.markexpr:
        config.args = [str(ROOT / 'test' / 'unit'), str(ROOT / 'test' / 'test_layers.py')]
        config.option.markexpr = 'not slow'


# Files without kernels, which run while one worker compiles the kernels of the nodes: otherwise
# the other worker would compile the same kernels at the same time.
WITHOUT_KERNELS = ('test_lint.py', 'test_packaging.py')


def pytest_collection_modifyitems(items):
    """Run the system tests first, then the tests without kernels."""
    items.sort(key=lambda item: 'test/system/' not in item.nodeid and
               1 + (item.path.name not in WITHOUT_KERNELS))


@pytest.hookimpl(optionalhook=True)  # of pytest-xdist, with which `make test` runs two workers
def pytest_xdist_make_scheduler(config, log):
    """Distribute the tests by file, in their order; the system tests run on one worker."""
    from xdist.scheduler import LoadFileScheduling

    class Lanes(LoadFileScheduling):
        def _split_scope(self, nodeid):
            folder, found, _ = nodeid.partition('test/system/')
            return folder + found if found else super()._split_scope(nodeid)
    config.option.loadscopereorder = False  # the files are ordered from long to short
    return Lanes(config, log)


def pytest_addoption(parser):
    """Add the option with the list of allowed skips."""
    parser.addoption('--allowed-skips', metavar='FILE', type=Path, help=(
        'fail where a test is skipped for a reason that no line of FILE matches; a line is a '
        'regular expression; the reason for accepting the skip follows two spaces and a #'))


def unexpected_skips(patterns, skips):
    """Return the (test, reason) of all skips whose reason no pattern matches."""
    return sorted({(test, reason) for test, reason in skips
                   if not any(re.search(pattern, reason) for pattern in patterns)})


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session):
    """With --allowed-skips, fail if a test was skipped for another reason."""
    path = session.config.getoption('--allowed-skips')
    reporter = session.config.pluginmanager.get_plugin('terminalreporter')
    if path is None or reporter is None or hasattr(session.config, 'workerinput'):
        return
    patterns = [line.split('  #')[0].strip() for line in path.read_text().splitlines()
                if line.strip() and not line.startswith('#')]
    session.config.unexpected_skips = unexpected_skips(patterns, (
        (report.nodeid, str(report.longrepr[2]).removeprefix('Skipped: '))
        for report in reporter.stats.get('skipped', ())))
    if session.config.unexpected_skips and session.exitstatus == 0:
        session.exitstatus = 1


def pytest_terminal_summary(terminalreporter, config):
    """Print unexpected skips and, with --durations, the seconds of each folder of tests."""
    unexpected = getattr(config, 'unexpected_skips', ())
    if unexpected:
        terminalreporter.section(f'skipped, and not in {config.getoption("--allowed-skips")}')
        for test, reason in unexpected:
            terminalreporter.write_line(f'{test}: {reason}')
    if config.getoption('durations') is None:
        return
    seconds = Counter()
    for report in (report for kind in terminalreporter.stats.values() for report in kind):
        if hasattr(report, 'duration'):
            path = report.nodeid.split('::')[0]
            seconds[path if path.count('/') < 2 else path.rpartition('/')[0]] += report.duration
    terminalreporter.section('seconds by folder')
    for path, took in seconds.most_common():
        terminalreporter.write_line(f'{took:8.1f}  {path}')


@pytest.fixture(autouse=True)
def scheduling_restored():
    """Reset the real-time priority set by a bridge in this process: children inherit it."""
    yield
    if os.sched_getscheduler(0) != os.SCHED_OTHER:
        for thread in Path('/proc/self/task').iterdir():
            os.sched_setscheduler(int(thread.name), os.SCHED_OTHER, os.sched_param(0))


@pytest.fixture(scope='session')
def gimball():
    """Return the ball with the pendulum."""
    from ballbot_ros.physics import load_robot  # not above: it takes 1.5 s of processor time
    return load_robot('gimball')


@pytest.fixture(scope='session')
def shellball():
    """Return the empty ball."""
    from ballbot_ros.physics import load_robot
    return load_robot('shellball')


@pytest.fixture(params=['gimball', 'shellball'])
def robot(request):
    """Return each robot of the package in turn."""
    return request.getfixturevalue(request.param)
