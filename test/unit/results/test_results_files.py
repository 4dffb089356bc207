# SPDX-License-Identifier: Apache-2.0
"""Files of a run contain all values to the bit, and are never incomplete."""
import csv

import numpy as np
import pytest
from refusals import refused

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics import load_scene
from ballbot_ros.physics.simulation.trajectory import UNITS
from ballbot_ros.results import files, read_columns, read_units, write_trajectory


@pytest.fixture(scope='module')
def trajectory():
    return load_scene('fig7_bottom').simulate()


@pytest.fixture(params=['csv', 'npz', 'parquet'])
def written(request, trajectory, tmp_path):
    path = tmp_path / f'run.{request.param}'
    write_trajectory(trajectory, path)
    return path


def test_every_number_is_read_back_to_the_last_bit(written, trajectory):
    columns = read_columns(written)
    assert list(columns) == list(UNITS)
    for name in UNITS:
        assert columns[name].tobytes() == trajectory[name].tobytes(), name


def test_units_in_the_file_are_those_of_the_trajectory(written):
    assert read_units(written) == dict(UNITS)


def test_header_is_one_row_of_names_with_units(trajectory, tmp_path):
    write_trajectory(trajectory, tmp_path / 'run.csv')
    with open(tmp_path / 'run.csv', newline='') as stream:
        rows = csv.reader(stream)
        assert next(rows)[:3] == ['time [s]', 'x [m]', 'y [m]']
        assert sum(1 for _ in rows) == len(trajectory)


def test_a_long_run_is_written_in_blocks_without_gaps(trajectory, tmp_path, monkeypatch):
    write_trajectory(trajectory, tmp_path / 'whole.csv')
    monkeypatch.setattr(files, '_BLOCK', 7)
    write_trajectory(trajectory, tmp_path / 'blocks.csv')
    assert (tmp_path / 'whole.csv').read_bytes() == (tmp_path / 'blocks.csv').read_bytes()


def test_nonfinite_numbers_are_preserved(trajectory, tmp_path):
    rows = trajectory.rows[:5].copy()
    rows[3, 3], rows[4, 4] = np.nan, -np.inf
    broken = type(trajectory)(trajectory.model, rows)
    write_trajectory(broken, tmp_path / 'run.csv')
    columns = read_columns(tmp_path / 'run.csv')
    np.testing.assert_array_equal(columns['x'], broken['x'])
    np.testing.assert_array_equal(columns['y'], broken['y'])


@pytest.mark.parametrize('interruption', [KeyboardInterrupt, OSError(28, 'No space left')])
def test_interrupted_writing_keeps_the_old_file_and_leaves_no_other(tmp_path, interruption):
    path = tmp_path / 'run.csv'
    path.write_text('old')
    with pytest.raises((KeyboardInterrupt, ConfigurationError)), files.replacing(path) as stream:
        stream.write(b'half')
        raise interruption
    assert path.read_text() == 'old'
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_that_cannot_be_created_is_named(trajectory, tmp_path):
    (tmp_path / 'taken').write_text('')
    with refused('not_writable', str(tmp_path / 'taken' / 'run.csv')):
        write_trajectory(trajectory, tmp_path / 'taken' / 'run.csv')


@pytest.mark.parametrize('name, reason', [
    ('run.npz', 'unreadable'), ('run.parquet', 'unreadable'), ('run.txt', 'not_a_choice')])
def test_a_file_of_another_kind_is_refused(tmp_path, name, reason):
    (tmp_path / name).write_text('no archive')
    with refused(reason):
        read_columns(tmp_path / name)


def test_a_missing_file_is_named():
    with refused('unreadable', 'path'):
        read_columns('nowhere.csv')


@pytest.mark.parametrize('text, field, words', [
    ('time [s];x [m]\n0,0;1,5\n', 'time [s];x [m]', ('line 1', 'semicolons')),
    ('time [s]\tx [m]\n0.0\t1.5\n', 'time [s]\tx [m]', ('line 1', 'tabs')),
    ('time [s],x\n0,1\n', 'x', ('line 1', "'x'")),
    ('time [s],x [m]\n0,1\n0.1,one\n', 'x [m]', ('line 3', '"x [m]"', "'one'")),
    ('time [s],x [m]\n0,1\n"0,1",2\n', 'time [s]', ('line 3', 'decimal point')),
    ('time [s],x [m]\n0,1,0,5\n', 'line 2', ('line 2', '4 values', 'decimal commas')),
    ('time [s],x [m]\n0\n', 'line 2', ('line 2', '1 values')),
    ('time [s],x [m],x [mm],y [m]\n0,1,1000,2\n', 'x [mm]', ('line 1', "'x'")),
    ('time [s],x [m]\n', 'line 2', ('no rows',)), ('', 'line 1', ('line 1', 'no columns'))])
def test_an_unreadable_csv_file_is_refused_with_line_and_column(tmp_path, text, field, words):
    (tmp_path / 'run.csv').write_text(text)
    with refused('unreadable', field) as error:
        read_columns(tmp_path / 'run.csv')
    assert all(word in str(error.value) for word in ('run.csv', *words))


def test_a_csv_file_in_another_encoding_is_refused(tmp_path):
    (tmp_path / 'run.csv').write_text('time [s],angle [°]\n0,1\n', encoding='latin-1')
    with refused('unreadable', 'path') as error:
        read_columns(tmp_path / 'run.csv')
    assert 'UTF-8' in str(error.value)


@pytest.mark.parametrize('x', [
    np.zeros(2), np.zeros((3, 2)), np.array(['a', 'b', 'c']), np.array([None, 1.0, 2.0])])
def test_an_archive_with_a_column_that_is_not_a_number_for_each_sample_is_refused(tmp_path, x):
    np.savez(tmp_path / 'run.npz', time=np.arange(3.0), x=x, units=[['time', 's'], ['x', 'm']])
    with refused('unreadable'):
        read_columns(tmp_path / 'run.npz')


def test_an_array_that_is_named_as_an_archive_is_refused(tmp_path):
    np.save(tmp_path / 'run.npy', np.zeros(3))
    (tmp_path / 'run.npy').rename(tmp_path / 'run.npz')
    with refused('unreadable'):
        read_columns(tmp_path / 'run.npz')


def test_a_place_that_cannot_be_written_is_named_without_a_temporary_file():
    with refused('not_writable', '/proc/none/run.csv') as error:
        files.check_writable('/proc/none/run.csv')
    assert '/proc/tmp' not in str(error.value)
