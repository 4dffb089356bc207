# SPDX-License-Identifier: Apache-2.0
"""What is calculated in another process comes back, and so does what it refuses."""
from dataclasses import replace
import time

import pytest

from ballbot_ros.bridge.feasibility import check_feasible, onboard_lag
from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.control import aside as aside_module
from ballbot_ros.control import check_loop, load_tuning, Mode
from ballbot_ros.control.aside import aside
from ballbot_ros.errors import RefusedError, UnstableLoopError


def test_a_refusal_comes_back_as_it_was_raised(gimball):
    wild = replace(load_tuning('published'), position_kd=40.0)
    with pytest.raises(UnstableLoopError, match='run it at 1101 Hz or more or lower position_kd'):
        aside(check_loop, gimball, wild, Mode.HOLD, 500.0, 0)


def test_a_hardware_file_travels(gimball):
    hardware = load_hardware('gimball_odrive')
    lowest = aside(check_feasible, hardware, gimball, load_tuning('gentle'), 0,
                   onboard_lag(hardware))
    assert 0.0 < lowest < hardware.connection.loop_rate


def test_one_that_breaks_is_told_in_one_line():
    with pytest.raises(RefusedError, match='divmod gave no answer .*: ZeroDivisionError: '):
        aside(divmod, 1, 0)


def test_one_that_takes_too_long_is_ended_and_refused_in_a_sentence(monkeypatch):
    monkeypatch.setattr(aside_module, 'PATIENCE', 0.05)
    with pytest.raises(RefusedError, match='sleep was not done within 0.05 s .*nothing has chang'):
        aside(time.sleep, 60.0)
