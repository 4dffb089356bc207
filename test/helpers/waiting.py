# SPDX-License-Identifier: Apache-2.0
"""A wait for a condition."""
import time

# Nothing takes this long on an idle machine; on a busy one no test fails for lack of time [s].
TIMEOUT = 180.0


def wait_until(condition, act=lambda: None):
    """Return the result of a condition once it is true; `act` is called after each failure."""
    deadline = time.monotonic() + TIMEOUT
    while not (found := condition()):
        assert time.monotonic() < deadline
        act()
        time.sleep(0.005)
    return found
