# SPDX-License-Identifier: Apache-2.0
"""Fixtures that call the command."""
import sys
from types import SimpleNamespace

import pytest

from ballbot_ros.cli import main


@pytest.fixture
def error_of(capsys):
    """Return a function that returns the single error line of a refused call."""
    def call(*words):
        assert main(words) == 2
        out, err = capsys.readouterr()
        *notes, error = err.splitlines(keepends=True)
        assert out == '' and error.startswith('ballbot: error: ')
        assert all(note.startswith('Note: ') for note in notes), err
        return error
    return call


@pytest.fixture
def replace_demo(monkeypatch):
    """Return a function that replaces functions of the demo, which needs ROS."""
    def replace(**functions):
        for module in ('demo', 'hardware', 'house', 'own_act', 'page'):
            monkeypatch.setitem(
                sys.modules, f'ballbot_ros.demo.{module}', SimpleNamespace(**functions))
    return replace
