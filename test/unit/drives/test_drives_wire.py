# SPDX-License-Identifier: Apache-2.0
"""How often a line carries a request and its reply."""
import math

import pytest

from ballbot_ros.drives.contract import WireBudget


def test_a_byte_takes_ten_bits_each_way_and_the_drive_its_turnaround():
    assert WireBudget(30, 18, 0.001).duration(9600) == pytest.approx(0.05 + 0.001)
    assert WireBudget(30, 18).highest_rate(9600) == pytest.approx(20.0)


@pytest.mark.parametrize('turnaround', [0.0, 0.002])
def test_the_least_baud_rate_is_the_one_whose_highest_rate_it_is(turnaround):
    budget = WireBudget(30, 18, turnaround)
    assert budget.least_baud(budget.highest_rate(115200)) == pytest.approx(115200)


@pytest.mark.parametrize('rate', [500.0, 1000.0])
def test_no_baud_rate_is_enough_where_the_turnaround_takes_the_period(rate):
    assert WireBudget(1, 1, 0.002).least_baud(rate) == math.inf
