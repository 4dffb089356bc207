# SPDX-License-Identifier: Apache-2.0
"""Steady clock of all timeouts of the hardware."""
import time

# Linux stops CLOCK_MONOTONIC while the machine is suspended, so a set-point from before the
# suspension would still be fresh after it.
_CLOCK = getattr(time, 'CLOCK_BOOTTIME', time.CLOCK_MONOTONIC)


def steady_time() -> float:
    """Return the time [s] of a clock that is never set and includes suspensions of the machine."""
    return time.clock_gettime(_CLOCK)
