# SPDX-License-Identifier: Apache-2.0
"""Compiled and plain kernels return the same values, and machine code is cached safely."""
from collections import OrderedDict
import errno
import fcntl
import json
import os
from pathlib import Path
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest
from tiers import slow

from ballbot_ros import jit

# Simulates each robot and law at a step and prints samples of the trajectories.
PROGRAM = """
import json
from ballbot_ros import jit
from ballbot_ros.physics import Actuation, load_robot, Model, simulate, Terrain

ends = {}
for name, laws in (('gimball', ('free', 'position', 'velocity', 'voltage', 'torque')),
                   ('shellball', ('free',))):
    robot = load_robot(name)
    for law in laws:
        model = Model(robot, Terrain.step(0.021))
        start = model.at_rest(-0.4 * robot.ball_radius - 0.02, 0.8)
        actuation = Actuation(law, set_angle=1.0, set_rate=4.0, velocity_ki=1.0, voltage=6.0,
                              torque=0.5)
        run = simulate(model, start, actuation, 0.06)
        ends[f'{name} {law}'] = [list(values[[20, 40, 60]]) for values in run.columns.values()]
print(json.dumps([jit.COMPILED, ends]))
"""


@pytest.mark.parametrize('variable', ['NUMBA_DISABLE_JIT', *slow('BALLBOT_UNCOMPILED')])
def test_compilation_can_be_switched_off(variable):
    done = subprocess.run(
        [sys.executable, '-c', 'from ballbot_ros import crossing, jit\n'
         'from ballbot_ros.physics.model.actuation import limited\n'
         'print(jit.COMPILED, limited(3.0, 2.0), type(limited).__name__)'],
        check=True, capture_output=True, text=True,
        env={**os.environ, variable: '1',
             'PYTHONPATH': os.pathsep.join(path for path in sys.path if path)})
    assert done.stdout.split() == ['False', '2.0', 'function']


def outcome(uncompiled):
    """Return the parsed output of the program, run in a separate process."""
    done = subprocess.run(
        [sys.executable, '-c', PROGRAM], check=True, capture_output=True, text=True,
        env={**os.environ, 'BALLBOT_UNCOMPILED': uncompiled,
             'PYTHONPATH': os.pathsep.join(path for path in sys.path if path)})
    return json.loads(done.stdout)


needs_numba = pytest.mark.skipif(
    not jit.COMPILED, reason='numba is not installed or switched off')


@pytest.mark.slow
@needs_numba
def test_compiled_and_plain_kernels_agree():
    (machine, fast), (source, plain) = outcome('0'), outcome('1')
    assert machine and not source
    assert set(fast) == set(plain) and len(fast) == 6
    for name, columns in plain.items():
        # Relative to the largest value of the column: forces near 0 are differences.
        for one, two in zip(np.array(columns), np.array(fast[name])):
            np.testing.assert_allclose(
                two, one, rtol=1e-12, atol=1e-12 * max(1.0, np.abs(one).max()), err_msg=name)


@pytest.fixture
def writing(monkeypatch, tmp_path):
    """Return a function that sets a hook to run before numba writes machine code to a folder."""
    caching = pytest.importorskip('numba.core.caching')
    monkeypatch.setattr(jit, '_FOLDER', str(tmp_path))
    write = caching.IndexDataCacheFile.save

    def replace(first):
        def save(*arguments):
            first(tmp_path)
            write(*arguments)
        monkeypatch.setattr(caching.IndexDataCacheFile, 'save', save)
    return replace


def double(number):
    return 2.0 * number


@needs_numba
def test_only_one_process_at_a_time_writes_machine_code(writing, tmp_path):
    refused = []

    def try_as_well(folder):
        with open(folder / 'lock') as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                refused.append(error)
    writing(try_as_well)
    assert jit.compiled(double)(2.0) == 4.0
    assert len(refused) == len(list(tmp_path.rglob('*.nbc'))) == 1


@needs_numba
def test_a_full_disk_prevents_caching_but_not_the_call(writing, tmp_path):
    def fail(folder):
        raise OSError(errno.ENOSPC, 'no space left on device')
    writing(fail)
    assert jit.compiled(double)(2.0) == 4.0
    assert not list(tmp_path.rglob('*.nbc'))


def test_machine_code_is_found_without_hashing_the_types_of_a_kernel():
    # The hash of these nested tuples takes longer than many calls.
    class Types:
        hashes = 0

        def __hash__(self):
            self.hashes += 1
            return 0

    class Kernel:
        overloads = OrderedDict()

    class Machine:
        entry_point = 'code'
    types, kernel = Types(), Kernel()
    assert jit.direct(kernel) is kernel
    kernel.overloads[types] = Machine
    before = types.hashes
    assert jit.direct(kernel) == 'code' and types.hashes == before
    kernel.overloads[Types()] = Machine
    assert jit.direct(kernel) is kernel


@needs_numba
def test_only_old_caches_of_machine_code_are_removed(tmp_path, monkeypatch):
    base = tmp_path / 'ballbot_ros'
    for age, name in enumerate(['capability', *(16 * digit for digit in '0123456')]):
        (base / name).mkdir(parents=True)
        os.utime(base / name, (age, age))
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    own = os.path.basename(jit._cache_folder())
    assert {path.name for path in base.iterdir() if path.is_dir()} == {
        'capability', own, *(16 * digit for digit in '456')}


def test_each_file_with_kernels_is_part_of_the_digest(tmp_path):
    jit._kernel_sources(tmp_path / 'sources.json')
    known = set(json.loads((tmp_path / 'sources.json').read_text()))
    package = Path(jit.__file__).parent
    assert {str(path) for path in package.rglob('*.py') if re.search(
        r'^@(compiled|unlocked|outlined)$', path.read_text(encoding='utf-8'), re.M)} <= known


def test_each_copy_of_the_package_is_parsed_once_and_forgotten_after_its_removal(
        tmp_path, monkeypatch):
    parse, parsed, known = jit._kernel_source, [], tmp_path / 'sources.json'
    monkeypatch.setattr(
        jit, '_kernel_source', lambda path: (parsed.append(path), parse(path))[1])

    def digests(copy):
        monkeypatch.setattr(jit, '__file__', str(tmp_path / copy / 'jit.py'))
        return jit._kernel_sources(known)
    for copy in ('one', 'other'):
        kernel = tmp_path / copy / 'control' / 'kernel.py'
        kernel.parent.mkdir(parents=True)
        kernel.write_text('from ballbot_ros.jit import compiled\n')
        (tmp_path / copy / 'jit.py').touch()
    assert digests('one') == digests('other') == digests('one') == digests('other') != []
    assert len(parsed) == len(set(parsed)) == 4
    shutil.rmtree(tmp_path / 'one')
    kernel.write_text('from ballbot_ros.jit import outlined\n')
    digests('other')
    assert set(json.loads(known.read_text())) == {
        str(kernel), str(tmp_path / 'other' / 'jit.py')}
