# SPDX-License-Identifier: Apache-2.0
"""Stamps use a clock that may be set, and timeouts a steady clock."""
from types import SimpleNamespace

import pytest

from ballbot_ros.nodes.bridge import motor
from ballbot_ros.nodes.bridge.motor import Clocks

START = 1.8e9


class Time:
    """Both clocks of a machine."""

    def __init__(self):
        self.steady, self.offset, self.held_up = 100.0, START, 0.0

    def time(self):
        stamp = self.steady + self.offset
        self.steady += self.held_up  # preempted between the two readings
        return stamp


@pytest.fixture
def machine(monkeypatch):
    """Return the clocks of a machine."""
    made = Time()
    monkeypatch.setattr(motor, 'time', made)
    monkeypatch.setattr(motor, 'steady_time', lambda: made.steady)
    return made


@pytest.fixture
def logged(monkeypatch):
    """Return the warnings of a logger whose records wait for the executor."""
    assert motor.LOG.name.startswith('ballbot_ros.bridge.')  # see nodes/bridge/node.py
    found = []
    monkeypatch.setattr(motor, 'LOG', SimpleNamespace(warning=found.append))
    return found


def error(clocks, machine):
    """Return the error of the steady time of a current stamp [s]."""
    now = machine.steady
    return clocks.steady(now + machine.offset) - now


def test_a_current_stamp_converts_to_the_current_time(machine):
    clocks = Clocks()
    assert error(clocks, machine) == pytest.approx(0.0, abs=1e-6)
    assert clocks.stamp(machine.steady) == pytest.approx(machine.steady + START)


@pytest.mark.parametrize('change', [3600.0, -3600.0, 1.8e9, 0.5, -0.02])
def test_a_clock_that_is_set_is_followed_after_twenty_ms_and_logged(machine, logged, change):
    clocks = Clocks()
    error(clocks, machine)
    machine.offset += change
    machine.steady += 0.021
    assert error(clocks, machine) == pytest.approx(0.0, abs=1e-6)
    assert len(logged) == (abs(change) > 0.1)
    assert not logged or f'set by {change:+.3f} s' in logged[0]


def test_a_sample_during_which_the_process_is_preempted_is_dropped(machine, logged):
    clocks = Clocks()
    error(clocks, machine)
    machine.held_up = 0.03
    for _ in range(5):
        machine.steady += 0.1
        assert error(clocks, machine) == pytest.approx(0.0, abs=1e-6)
    assert not logged


def test_drift_between_the_clocks_is_followed_without_a_log_record(machine, logged):
    clocks = Clocks()
    for _ in range(1000):
        machine.steady += 0.03
        machine.offset += 15e-6
        assert abs(error(clocks, machine)) < 0.0021
    assert not logged
