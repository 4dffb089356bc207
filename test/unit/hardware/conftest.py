# SPDX-License-Identifier: Apache-2.0
"""What the tests of the hardware layer share."""
from drive_bench import Bench, DEVICES
import pytest


@pytest.fixture(params=sorted(DEVICES))
def protocol(request):
    """Return each protocol in turn."""
    return request.param


@pytest.fixture
def bench(protocol):
    """Return a bench whose driver has done its handshake."""
    made = Bench(protocol)
    made.driver.identify()
    return made
