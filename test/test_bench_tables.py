# SPDX-License-Identifier: Apache-2.0
"""The benchmarks write their results to the documents, including missed targets."""
from pathlib import Path
import sys

import pytest

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / 'bench'))

import compiled_tables  # noqa: E402, I100, I201
import documents  # noqa: E402, I100, I201

# Time [s], tolerance, right-hand sides.
FOUND = {
    ('near_critical', 1e-4): {'ours': (40e-6, 1e-5, 500), 'LSODA': (160e-6, 1e-5, 800),
                              'CVODE BDF': (300e-6, 1e-6, 600)},
    ('near_critical', 1e-6): {'ours': (50e-6, 1e-7, 900), 'LSODA': (100e-6, 1e-7, 1600)},
    ('roll_60_s', 1e-4): {'ours': (10e-6, 1e-4, 100), 'LSODA': (120e-6, 1e-3, 300)},
    ('roll_60_s', 1e-6): {'ours': (20e-6, 1e-6, 200)},
}


def test_the_ratio_is_relative_to_the_best_peer_of_each_scene():
    table = compiled_tables.ratios(FOUND)
    assert table[1e-4] == pytest.approx({'near_critical': 4.0, 'roll_60_s': 12.0})
    assert table[1e-6] == pytest.approx({'near_critical': 2.0})  # no peer in the other


def test_a_missed_target_is_reported_with_its_scene():
    rows = {target: (reached, verdict)
            for target, reached, verdict in compiled_tables.target_rows(FOUND)}
    assert rows['5 x the best compiled peer at 0.1 mm, median of 2 scenes'][1] == 'met'
    assert rows['3 x in each scene at 1 um'] == (
        '1 of 1 below; least 2.0 x, `near_critical`', '**missed**')
    assert rows['10 x in `roll_60_s` at 0.1 mm'] == ('12 x', 'met')
    assert rows['`near_critical` at 0.1 mm, 30 us'] == ('40 us', '**missed**')
    assert rows['`near_critical` at 1 um, 50 us'] == ('50 us', 'met')


def test_a_bound_uses_the_fewest_right_hand_sides_of_all_solvers():
    rows = {scene: rest for scene, *rest in compiled_tables.bound_rows(FOUND, 20e-9)}
    assert rows['`near_critical`'] == ['500, ours', '10', '16 x', '900, ours', '18', '5.6 x']
    assert rows['`roll_60_s`'][3:] == ['200, ours', '4', '']  # no peer achieves the error


def test_a_text_is_written_between_its_markers_only(tmp_path, monkeypatch):
    monkeypatch.setattr(documents, 'ROOT', tmp_path)
    page = tmp_path / 'page.md'
    page.write_text('a\n<!-- bench: one -->\nold\n<!-- end -->\nb\n<!-- bench: two -->\n'
                    '<!-- end -->\nc\n')
    documents.show('page.md', 'one', documents.table(['x', 'y'], [[1, 2]]))
    assert page.read_text() == (
        'a\n<!-- bench: one -->\n| x | y |\n|---|---|\n| 1 | 2 |\n<!-- end -->\nb\n'
        '<!-- bench: two -->\n<!-- end -->\nc\n')
    with pytest.raises(SystemExit, match='three'):
        documents.show('page.md', 'three', '')
