# SPDX-License-Identifier: Apache-2.0
"""The notebook runs completely, and its saved output is that of the run."""
import json
from pathlib import Path
import sys

import pytest

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / 'scripts'))

from run_notebook import run_cell, run_cells, words  # noqa: E402, I100, I202

NOTEBOOKS = sorted((ROOT / 'examples').glob('*.ipynb'))


def test_a_cell_shows_its_last_expression_and_keeps_its_names():
    names = {}
    assert run_cell('a = 2\na + 1', names) == 3
    assert run_cell('b = a * 2', names) is None and names['b'] == 4


@pytest.mark.slow
@pytest.mark.parametrize('path', NOTEBOOKS, ids=lambda path: path.name)
def test_a_notebook_runs_and_prints_its_saved_output(path, monkeypatch):
    monkeypatch.setitem(sys.modules, 'ipywidgets', None)  # sliders are for interactive use
    cells = json.loads(path.read_text(encoding='utf-8'))['cells']
    drawn = 0
    for cell, _, outputs in run_cells(cells):
        assert words(outputs) == words(cell['outputs']), ''.join(cell['source'])
        drawn += sum('image/png' in item.get('data', ()) for item in outputs)
    assert drawn >= 4
