# SPDX-License-Identifier: Apache-2.0
"""Fixtures of the tests of the hardware layer."""
from drive_bench import Bench, KINDS
import pytest


@pytest.fixture(params=KINDS)
def kind(request):
    """Return each kind of drive in turn."""
    return request.param


@pytest.fixture
def bench(kind):
    """Return a bench whose driver has completed its handshake."""
    made = Bench(kind)
    made.driver.identify()
    return made
