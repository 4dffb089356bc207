# SPDX-License-Identifier: Apache-2.0
"""Compilation is reported once, and compilation after the start is a warning."""
import pytest

from ballbot_ros import compile_notice, jit as compiled
from ballbot_ros.compile_notice import CompileNotice, COMPILING_NOTICE
from ballbot_ros.ros.run import FirstStart, LATE_KERNEL

pytestmark = pytest.mark.skipif(not compiled.COMPILED, reason='nothing is compiled')


@pytest.fixture
def kernel(monkeypatch, tmp_path):
    """Return a function that returns a kernel as in a new process."""
    monkeypatch.setattr(compiled, '_FOLDER', str(tmp_path))
    monkeypatch.setattr(compile_notice, '_callbacks', [])

    def add_one(number):
        return number + 1.0
    return lambda: compiled.compiled(add_one)


@pytest.fixture
def start(kernel):
    """Return a `FirstStart`, its messages and its warnings."""
    messages, warned = [], []
    return FirstStart(messages.append, warned.append), messages, warned


@pytest.fixture
def reporting(monkeypatch, kernel):
    """Return the same function; each compilation is reported immediately."""
    monkeypatch.setattr(compiled, '_notice', CompileNotice())
    monkeypatch.setattr(compile_notice, 'REPORT_AFTER', -1.0)
    return kernel


def test_a_compilation_in_a_program_is_explained_once(reporting, caplog):
    for argument in (1.0, 1, 1j):
        reporting()(argument)
    assert [record.message for record in caplog.records] == [COMPILING_NOTICE]
    assert caplog.records[0].levelname == 'WARNING'


def test_a_short_compilation_is_not_reported(reporting, monkeypatch, caplog):
    monkeypatch.setattr(compile_notice, 'REPORT_AFTER', 1e9)
    reporting()(1.0)
    assert not caplog.records and compiled._notice.spent > 0.0


def test_a_compilation_during_the_tests_is_not_reported(kernel, monkeypatch, caplog):
    monkeypatch.setattr(compiled, '_notice', CompileNotice())
    compiled._notice.spent = 1e6
    kernel()(1.0)
    assert not caplog.records


def test_a_program_that_shows_compilations_gets_their_number_and_no_warning(reporting, caplog):
    reports = []
    compile_notice.on_compiling(lambda done, more: reports.append((done, more)))
    try:
        for argument in (1.0, 1):
            reporting()(argument)
    finally:
        compile_notice.on_compiling(None)
    assert reports == [(0, True), (1, False), (1, True), (2, False)]
    assert not caplog.records


def test_cached_kernels_are_not_reported_as_compiled(reporting, caplog):
    reporting()(1.0)
    caplog.clear()
    compiled._notice._warned = False
    reporting()(1.0)
    assert not caplog.records


def test_a_node_logs_only_its_own_message(reporting, start, caplog):
    reporting()(1.0)
    assert start[1] == [COMPILING_NOTICE] and not caplog.records


def test_only_the_first_compilation_is_reported(kernel, start):
    _, messages, warned = start
    for argument in (1.0, 1, 2.0):
        kernel()(argument)
        assert messages == [COMPILING_NOTICE] and not warned


def test_a_cached_kernel_causes_no_message_except_that_the_node_is_ready(kernel, start):
    kernel()(1.0)
    start[1].clear()
    again = FirstStart(start[1].append, start[2].append)
    kernel()(1.0)
    again.ready()
    assert len(messages := start[1]) == 1 and messages[0].startswith('ready after ')
    assert 'compiled' not in messages[0]


def test_the_number_of_compiled_kernels_is_reported_when_the_node_is_ready(kernel, start):
    first, messages, _ = start
    kernel()(1.0)
    first.ready()
    assert messages[1].startswith('ready after ') and '1 kernels were compiled' in messages[1]


@pytest.mark.parametrize('kept, how', [(False, 'compiled'), (True, 'read from the disk')])
def test_the_first_call_of_a_kernel_after_the_start_is_a_warning(kernel, start, kept, how):
    if kept:
        kernel()(1.0)
    start[0].ready()
    kernel()(1.0)
    warning, = start[2]
    assert warning.startswith(LATE_KERNEL) and 'add_one' in warning and warning.endswith(how)


def test_a_second_call_of_the_same_kind_is_not_late(kernel, start):
    one = kernel()
    one(1.0)
    start[0].ready()
    one(2.0)
    assert not start[2]
