# SPDX-License-Identifier: Apache-2.0
"""What the tests of the hardware layer share."""
from drive_bench import Bench, KINDS
import pytest


@pytest.fixture(params=KINDS)
def kind(request):
    """Return each kind of drive in turn."""
    return request.param


@pytest.fixture
def bench(kind):
    """Return a bench whose driver has done its handshake."""
    made = Bench(kind)
    made.driver.identify()
    return made
