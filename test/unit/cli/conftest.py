# SPDX-License-Identifier: Apache-2.0
"""Fixtures that call the command."""
import sys
from types import SimpleNamespace

import pytest


@pytest.fixture
def replace_demo(monkeypatch):
    """Return a function that replaces functions of the demo, which needs ROS."""
    def replace(**functions):
        for module in ('demo', 'hardware', 'house', 'own_act', 'page'):
            monkeypatch.setitem(
                sys.modules, f'ballbot_ros.demo.{module}', SimpleNamespace(**functions))
    return replace
