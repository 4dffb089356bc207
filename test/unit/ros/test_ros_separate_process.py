# SPDX-License-Identifier: Apache-2.0
"""Results and refusals of a separate process are those of the function."""
from dataclasses import replace
import subprocess
import sys
import time

import pytest
from refusals import refused

from ballbot_ros.bridge.feasibility import check_feasible, onboard_lag
from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.control import check_loop, load_tuning, Mode
from ballbot_ros.errors import ConfigurationError, RefusedError, UnstableLoopError
from ballbot_ros.ros import separate_process
from ballbot_ros.ros.separate_process import run_in_process


@pytest.mark.slow
def test_a_refusal_is_raised_again_unchanged(gimball):
    wild = replace(load_tuning('published'), position_kd=40.0)
    with refused('unstable', error=UnstableLoopError) as caught:
        run_in_process(check_loop, gimball, wild, Mode.HOLD, 500.0, 0)
    assert '1101 Hz' in str(caught.value) and 'position_kd' in str(caught.value)


@pytest.mark.slow
def test_an_error_keeps_its_reason_and_field():
    with refused('unknown_name', 'tuning', error=ConfigurationError):
        run_in_process(load_tuning, 'gentel')


@pytest.mark.slow
def test_the_main_module_is_not_run_again(tmp_path):
    script = tmp_path / 'unguarded'
    script.write_text('from ballbot_ros.control import load_tuning\n'
                      'from ballbot_ros.ros.separate_process import run_in_process\n'
                      'print("main", run_in_process(load_tuning, "gentle").position_kp)\n')
    found = subprocess.run([sys.executable, script], capture_output=True, text=True)
    assert (found.returncode, found.stdout) == (0, f'main {load_tuning("gentle").position_kp}\n')


@pytest.mark.slow
def test_a_hardware_file_can_be_sent(gimball):
    hardware = load_hardware('gimball_odrive')
    lowest = run_in_process(check_feasible, hardware, gimball, load_tuning('gentle'), 0,
                            onboard_lag(hardware, gimball))
    assert 0.0 < lowest < hardware.connection.loop_rate


def test_an_unexpected_error_is_reported_in_one_line():
    with refused('failed', error=RefusedError) as caught:
        run_in_process(divmod, 1, 0)
    assert 'ZeroDivisionError' in str(caught.value)


def test_a_calculation_beyond_the_time_limit_is_ended_and_refused(monkeypatch):
    monkeypatch.setattr(separate_process, 'CALCULATION_TIMEOUT', 0.05)
    with refused('timeout', error=RefusedError):
        run_in_process(time.sleep, 60.0)
