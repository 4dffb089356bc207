# SPDX-License-Identifier: Apache-2.0
"""What compiles says so, once."""
import pytest

from ballbot_ros.ros.first_start import announce_compilation, SENTENCE


def test_the_first_compilation_is_told_and_no_other():
    numba = pytest.importorskip('numba')
    told = []
    announce_compilation(told.append)
    for number in range(2):
        kernel = numba.njit(lambda value: value + 1.0)
        kernel(1.0)
        kernel(2.0)
        assert told == [SENTENCE]


def test_what_runs_compiled_already_tells_nothing():
    numba = pytest.importorskip('numba')
    kernel = numba.njit(lambda value: value + 1.0)
    kernel(1.0)
    told = []
    announce_compilation(told.append)
    kernel(2.0)
    assert not told
