# SPDX-License-Identifier: Apache-2.0
"""Wait for a condition."""
import time

# Far more than an idle machine needs, so that no test fails on a busy one [s].
TIMEOUT = 180.0


def wait_until(condition, act=lambda: None):
    """Return the result of a condition once it is true; call `act` after each failure."""
    deadline = time.monotonic() + TIMEOUT
    while not (found := condition()):
        assert time.monotonic() < deadline
        act()
        time.sleep(0.005)
    return found
