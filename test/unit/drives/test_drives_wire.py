# SPDX-License-Identifier: Apache-2.0
"""Highest rate of a request and its reply on a line."""
import pytest

from ballbot_ros.drives.contract import WireBudget


def test_a_byte_takes_ten_bits_each_way():
    assert WireBudget(30, 18).duration(9600) == pytest.approx(0.05)
    assert WireBudget(30, 18).highest_rate(9600) == pytest.approx(20.0)
