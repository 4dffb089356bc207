# SPDX-License-Identifier: Apache-2.0
"""Sweeps: cases of a plan, interruption and resumption, units and provenance in the file."""
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
import gc
import json
import logging
import math
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
from threading import Event

import numpy as np
import pytest
from refusals import refused
from waiting import wait_until

from ballbot_ros.cli import main
from ballbot_ros.crossing import held_at, max_step_height, rolling, Site, try_step
from ballbot_ros.physics import Actuation, load_robot
from ballbot_ros.studies.parallel_map import checkpointed_map, worker_pool
from ballbot_ros.studies.sweep import BLOCK_SIZE, columns, run_block, run_sweep
from ballbot_ros.studies.sweep_plan import SweepPlan

parquet = pytest.importorskip('pyarrow.parquet', reason='sweeps are written with pyarrow')
GIMBALL, SHELLBALL = load_robot('gimball'), load_robot('shellball')
RANGES = {'speed': (0.4, 1.2), 'height': (0.005, 0.06), 'ball_mass': (3.3, 4.15)}


def sweep(plan, out, block=50):
    with ThreadPoolExecutor(2) as pool:
        return run_sweep(plan, out, pool, 2, block=block)


def test_a_grid_contains_every_combination_and_each_case_agrees_with_the_search():
    plan = SweepPlan(GIMBALL, held_at(0.3), fixed={}, grid={
        'speed': [0.5, 0.9], 'edge_friction': [0.1, 0.2, 0.3], 'slope_before': [-0.1, 0.0]})
    assert plan.size == 12 and plan.searches
    table = run_block(plan, 0, 12)
    found = set(zip(table['speed'], table['edge_friction'], table['slope_before']))
    assert len(found) == 12
    row = found_at(table, speed=0.9, edge_friction=0.3, slope_before=-0.1)
    best = max_step_height(replace(GIMBALL, edge_friction=0.3), 0.9, held_at(0.3),
                           site=Site(slope_before=-0.1))
    assert (table['max_height'][row], table['error'][row]) == (best.height, best.error)
    assert table['failure'] == [None] * 12


def found_at(table, **values):
    """Return the row with the given values."""
    return next(row for row in table['case'] if all(
        table[name][row] == value for name, value in values.items()))


@pytest.mark.parametrize('design', ['sobol', 'random'])
def test_cases_of_a_design_depend_only_on_its_seed(design):
    plan = SweepPlan(GIMBALL, design=design, cases=300, seed=4, ranges=RANGES)
    whole = plan.block(0, 300)
    parts = np.vstack([plan.block(first, first + 70) for first in range(0, 300, 70)])
    np.testing.assert_array_equal(whole, parts)
    low, high = np.array(list(RANGES.values())).T
    assert ((whole >= low) & (whole <= high)).all()
    np.testing.assert_allclose(whole.mean(axis=0), 0.5 * (low + high), rtol=0.05)
    other = SweepPlan(GIMBALL, design=design, cases=300, seed=5, ranges=RANGES)
    assert (other.block(0, 300) != whole).all()


def test_given_heights_are_simulated_with_a_joint_rate_that_depends_on_the_speed():
    plan = SweepPlan(GIMBALL, rolling(GIMBALL)(1.0), fixed={'height': 0.02},
                     grid={'speed': [0.5, 0.7], 'contact_damping': [52.0, 100.0]})
    table = run_block(plan, 0, 4)
    assert table['passes'] == [
        try_step(replace(GIMBALL, contact_damping=damping), speed, 0.02,
                 rolling(GIMBALL)(speed))[0]
        for speed, damping in zip(table['speed'], table['contact_damping'])]
    assert set(table['passes']) == {True, False}


def test_a_failed_case_contains_its_reason_and_the_others_continue():
    plan = SweepPlan(GIMBALL, fixed={'speed': 3.0}, grid={'contact_stiffness': [300.0, 33000.0]})
    table = run_block(plan, 0, 2)
    assert 'under the ground' in table['failure'][0] and table['max_height'][0] is None
    assert table['failure'][1] is None and table['max_height'][1] > 0.05


def test_the_command_warns_of_failed_cases(tmp_path, capsys):
    words = ['sweep', '--vary', 'speed=0.5', '--workers', '1', '--quiet', '--out']
    assert main([*words, str(tmp_path / 'a.parquet'), '--vary', 'voltage=0.0,5']) == 0
    warning, = capsys.readouterr().err.splitlines()
    assert warning.startswith('Warning: 1 of 2 cases failed') and 'law' in warning
    assert main([*words, str(tmp_path / 'b.parquet'), '--vary', 'height=0.01']) == 0
    assert capsys.readouterr().err == ''


def test_the_file_contains_all_cases_with_units_and_provenance(tmp_path):
    plan = SweepPlan(GIMBALL, design='sobol', cases=128, ranges=RANGES)
    out = tmp_path / 'sweep.parquet'
    assert sweep(plan, out) == (0, 0, '')
    table = parquet.read_table(out)
    assert table.column('case').to_pylist() == list(range(128))
    assert {field.name: field.metadata[b'unit'].decode() for field in table.schema} \
        == columns(plan)
    assert columns(plan)['ball_mass'] == 'kg' and columns(plan)['speed'] == 'm/s'
    metadata = json.loads(table.schema.metadata[b'ballbot_sweep'])
    assert metadata['plan']['robot_digest'] == GIMBALL.digest and metadata['digest'] == plan.digest
    assert not out.with_name('sweep.parquet.blocks').exists()
    pandas = pytest.importorskip('pandas', reason='pandas only checks that the file opens')
    frame = pandas.read_parquet(out)
    assert len(frame) == 128 and frame.passes.dtype == bool
    assert frame[frame.passes].height.mean() < frame[~frame.passes].height.mean()


def test_the_block_size_does_not_change_the_results(tmp_path):
    plan = SweepPlan(GIMBALL, design='random', cases=90, ranges=RANGES)
    sweep(plan, tmp_path / 'a.parquet', block=7)
    sweep(plan, tmp_path / 'b.parquet', block=40)
    assert parquet.read_table(tmp_path / 'a.parquet') == parquet.read_table(
        tmp_path / 'b.parquet')


@pytest.mark.slow
def test_a_killed_sweep_resumes_without_loss_of_results(tmp_path):
    words = ['--vary', 'speed=0.3:1.2', '--vary', 'height=0.003:0.06', '--design', 'sobol',
             '--workers', '2']
    cases = 4 * BLOCK_SIZE
    killed, whole = tmp_path / 'killed.parquet', tmp_path / 'whole.parquet'
    command = [sys.executable, '-m', 'ballbot_ros.cli', 'sweep', *words, '--cases', str(cases)]
    process = subprocess.Popen([*command, '--out', str(killed)], stderr=subprocess.DEVNULL,
                               cwd=Path(__file__).resolve().parents[3])
    blocks = tmp_path / 'killed.parquet.blocks'
    wait_until(lambda: len(list(blocks.glob('[0-9]*.parquet'))) >= 2 or process.poll() is not None)
    process.send_signal(signal.SIGKILL)
    process.wait()
    done = {path: path.stat().st_mtime_ns for path in blocks.glob('[0-9]*.parquet')}
    assert 2 <= len(done) and not killed.exists()
    stamps = {}

    def look(path=blocks):
        stamps.update({part: part.stat().st_mtime_ns for part in path.glob('[0-9]*.parquet')})
    plan = SweepPlan(GIMBALL, design='sobol', cases=cases,
                     ranges={'speed': (0.3, 1.2), 'height': (0.003, 0.06)})
    with ThreadPoolExecutor(1) as pool:
        found = run_sweep(plan, killed, pool, 1, lambda _: look())
        run_sweep(plan, whole, pool, 1)
    assert found.resumed == BLOCK_SIZE * len(done)
    # Completed blocks are not computed again.
    assert {path: stamps[path] for path in done} == done
    assert parquet.read_table(killed) == parquet.read_table(whole)


def test_ctrl_c_keeps_the_blocks_that_the_workers_have_started(tmp_path):
    pressed = Event()

    def compute(number):
        return number if number == 0 or pressed.wait(60.0) else None

    def press(done):
        if done:
            pressed.set()
            raise KeyboardInterrupt

    blocks = {str(number): (1, (number,)) for number in range(100)}
    with ThreadPoolExecutor(2) as pool, pytest.raises(KeyboardInterrupt):
        checkpointed_map(compute, blocks, tmp_path, pool, 2,
                         lambda number, path: path.write_text(str(number)), press)
    written = {path.name for path in tmp_path.glob('[0-9]*')}
    assert {'0', '1'} <= written and len(written) < 100
    assert all((tmp_path / name).read_text() == name for name in written)


def test_ctrl_c_is_acknowledged_before_the_started_blocks_end(tmp_path):
    acknowledged = Event()

    class Acknowledged(logging.Handler):
        def emit(self, record):
            acknowledged.set()

    def compute(number):
        return number if number == 0 or acknowledged.wait(60.0) else None

    def press(done):
        if done:
            raise KeyboardInterrupt

    blocks = {str(number): (1, (number,)) for number in range(100)}
    log, handler = logging.getLogger('ballbot_ros'), Acknowledged()
    log.addHandler(handler)
    try:
        with ThreadPoolExecutor(2) as pool, pytest.raises(KeyboardInterrupt):
            checkpointed_map(compute, blocks, tmp_path, pool, 2,
                             lambda number, path: path.write_text(str(number)), press)
    finally:
        log.removeHandler(handler)
    written = {path.name for path in tmp_path.glob('[0-9]*')}
    assert {'0', '1'} <= written and len(written) < 100
    assert all((tmp_path / name).read_text() == name for name in written)


@pytest.mark.slow
def test_workers_end_with_their_parent():
    script = ('import os, time\n'
              'from ballbot_ros.studies.parallel_map import worker_pool\n'
              'with worker_pool(1) as (pool, _):\n'
              '    print(pool.submit(os.getpid).result(), flush=True)\n'
              '    time.sleep(60)\n')
    process = subprocess.Popen([sys.executable, '-c', script], stdout=subprocess.PIPE, text=True,
                               cwd=Path(__file__).resolve().parents[3])
    worker = int(process.stdout.readline())
    process.kill()
    process.wait()
    process.stdout.close()
    wait_until(lambda: not _alive(worker))


def test_a_worker_does_not_collect_the_modules_that_it_inherits():
    with worker_pool(1) as (pool, _):
        assert pool.submit(gc.get_freeze_count).result() > 1000


def _alive(process):
    """Return whether a process runs and is not a zombie."""
    try:
        os.kill(process, 0)
        state = Path(f'/proc/{process}/stat').read_text().rsplit(')', 1)[1].split()[0]
    except (OSError, IndexError):
        return False
    return state != 'Z'


def test_another_sweep_with_the_same_output_is_refused(tmp_path):
    out = tmp_path / 'x.parquet'
    blocks = tmp_path / 'x.parquet.blocks'
    blocks.mkdir()
    (blocks / 'blocks.json').write_text('{"digest": "other"}')
    plan = SweepPlan(GIMBALL, design='sobol', cases=10, ranges=RANGES)
    with refused('inconsistent', str(blocks)):
        sweep(plan, out)
    (blocks / 'blocks.json').write_text('{')
    with refused('unreadable', str(blocks)):
        sweep(plan, out)


def test_a_sweep_is_refused_while_another_process_computes_the_same_blocks(tmp_path):
    out, plan = tmp_path / 'x.parquet', SweepPlan(
        GIMBALL, fixed={}, grid={'speed': [0.5], 'height': [0.01]})
    blocks = tmp_path / 'x.parquet.blocks'
    script = ('from pathlib import Path\n'
              'import sys\n'
              'from ballbot_ros.studies.parallel_map import claimed\n'
              'with claimed(Path(sys.argv[1]), sys.argv[2]):\n'
              '    print(flush=True)\n'
              '    sys.stdin.read()\n')
    with subprocess.Popen([sys.executable, '-c', script, str(blocks), plan.digest],
                          stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                          cwd=Path(__file__).resolve().parents[3]) as other:
        other.stdout.readline()
        with refused('unavailable', str(blocks)):
            sweep(plan, out)
        other.communicate()
    assert sweep(plan, out) == (0, 0, '') and out.exists()


def test_only_the_result_of_a_sweep_is_overwritten(tmp_path, capsys):
    plan = SweepPlan(GIMBALL, fixed={}, grid={'speed': [0.5], 'height': [0.01]})
    out = tmp_path / 'x.parquet'
    sweep(plan, out)
    before = out.read_bytes()
    sweep(replace(plan, grid={'speed': [0.6], 'height': [0.01]}), out)
    assert out.read_bytes() != before
    foreign = tmp_path / 'mine.parquet'
    parquet.write_table(parquet.read_table(out).replace_schema_metadata({}), foreign)
    (tmp_path / 'notes.parquet').write_text('mine')
    for path in (foreign, tmp_path / 'notes.parquet'):
        before = path.read_bytes()
        with refused('inconsistent', 'out'):
            sweep(plan, path)
        assert main(['sweep', '--vary', 'speed=0.5', '--out', str(path)]) == 2
        assert f'{path.name} exists' in capsys.readouterr().err
        assert path.read_bytes() == before
    assert not list(tmp_path.glob('*.blocks'))


@pytest.mark.parametrize('given, reason, field', [
    ({'grid': {'sped': [1.0]}}, 'unknown_name', 'sped'), ({}, 'inconsistent', 'design'),
    ({'design': 'sobol', 'grid': {'speed': [1.0]}}, 'inconsistent', 'design'),
    ({'grid': {'ball_mass': [1.0]}}, 'missing', 'speed'),
    ({'grid': {'speed': []}}, 'missing', 'speed'),
    ({'grid': {'speed': [1.0], 'clearance': [0.2]}}, 'inconsistent', 'clearance'),
    ({'grid': {'speed': [-1.0]}}, 'out_of_range', 'speed'),
    ({'grid': {'speed': [1.0]}, 'fixed': {'speed': 2.0}}, 'inconsistent', 'speed'),
    ({'design': 'sobol', 'ranges': {'speed': (1.0, 2.0)}}, 'out_of_range', 'cases'),
    ({'design': 'sobol', 'cases': 3, 'ranges': {'speed': (2.0, 1.0)}}, 'out_of_range', 'speed'),
    ({'robot': SHELLBALL, 'grid': {'speed': [1.0], 'motor.resistance': [1.0]}}, 'inconsistent',
     'motor.resistance')])
def test_an_invalid_plan_is_refused(given, reason, field):
    with refused(reason, field):
        SweepPlan(**{'robot': GIMBALL, **given})


def test_all_unknown_parameters_are_reported_together():
    with refused('unknown_name') as error:
        SweepPlan(GIMBALL, grid={'sped': [1.0], 'hieght': [0.1]})
    assert "'speed'" in str(error.value) and 'hieght' in str(error.value)


def test_an_angle_may_be_in_degrees_with_the_unit_of_its_column():
    in_degrees = SweepPlan(GIMBALL, Actuation('position'), fixed={'speed': 0.6},
                           grid={'set_angle_deg': [0.0, 90.0], 'slope_before_deg': [-5.0]})
    assert columns(in_degrees)['set_angle_deg'] == columns(in_degrees)['slope_before_deg'] == 'deg'
    _, _, _, actuation, site, _ = in_degrees.case({'set_angle_deg': 90.0, 'slope_before_deg': -5})
    assert actuation.set_angle == math.radians(90.0) and site.slope_before == math.radians(-5.0)
    with refused('out_of_range', 'slope_before_deg'):
        SweepPlan(GIMBALL, fixed={'speed': 1.0}, grid={'slope_before_deg': [-81.0]})
    with refused('inconsistent', 'slope_before'):
        SweepPlan(GIMBALL, fixed={'speed': 1.0, 'slope_before': 0.1},
                  grid={'slope_before_deg': [1.0]})


@pytest.mark.parametrize('words, reason, field', [
    (['--vary', 'speed=1,2', '--workers', '0'], 'out_of_range', '--workers'),
    (['--vary', 'speed=1,2', '--workers', '100000'], 'out_of_range', '--workers'),
    (['--vary', 'speed=1,2', '--workers', '2', '--dask', 'tcp://a:1'], 'usage', '--dask'),
    (['--vary', 'speed=1,2', '--out', 'x.csv'], 'not_a_choice', '--out'),
    (['--vary', 'sped=1,2'], 'unknown_name', 'sped'),
    (['--vary', 'speed=1', '--vary', 'set_angle=0:90:3'], 'inconsistent', 'set_angle'),
    (['--vary', 'speed=1', '--vary', 'speed=2'], 'ambiguous', 'speed'),
    (['--vary', 'speed=1', '--fix', 'speed=2'], 'ambiguous', 'speed'),
    (['--vary', 'speed=1', '--actuation', 'voltage', '--voltage', '0', '--vary', 'voltage=1,2'],
     'inconsistent', '--voltage'),
    (['--vary', 'speed=1', '--slope-behind-deg', '0', '--fix', 'slope_behind_deg=1'],
     'inconsistent', '--slope-behind-deg'),
    (['--vary', 'speed=1', '--actuation', 'held', '--angle-deg', '3', '--fix', 'set_angle_deg=1'],
     'inconsistent', '--angle-deg'),
    (['--vary', 'speed=1,2', '--fix', 'height=1:2'], 'wrong_type', 'height')])
def test_invalid_options_are_refused(refuses, tmp_path, words, reason, field):
    refuses(reason, field, 'sweep', '--out', tmp_path / 'x.parquet', *words)


@pytest.mark.parametrize('word, meant', [
    ('sped=1,2', 'speed'), ('set_angle=0:90:3', 'set_angle_deg')])
def test_the_error_for_a_wrong_parameter_suggests_the_right_one(refusal, tmp_path, word, meant):
    error = refusal('sweep', '--out', tmp_path / 'x.parquet', '--vary', word)
    assert {meant, 'height'}.intersection(re.findall(r'\w+', str(error))) == {meant}


@pytest.mark.slow
def test_a_dask_cluster_gives_the_same_file(tmp_path, capsys):
    distributed = pytest.importorskip('distributed', reason='a cluster needs dask')
    words = ['sweep', '--vary', 'speed=0.4,0.6,0.8', '--quiet', '--out']
    with distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None) as own:
        assert main([*words, str(tmp_path / 'a.parquet'), '--dask', own.scheduler_address]) == 0
    assert main([*words, str(tmp_path / 'b.parquet')]) == 0
    assert parquet.read_table(tmp_path / 'a.parquet') == parquet.read_table(
        tmp_path / 'b.parquet')
