# SPDX-License-Identifier: Apache-2.0
"""Work-precision curves: time a run, and read the time for an error off a curve."""
import math
import time


def timed(run, setting):
    """Return time [s] and result of a run; a short run is repeated."""
    begin = time.perf_counter()
    found = run(setting)
    spent, calls = time.perf_counter() - begin, 1
    while spent < 2e-3:
        run(setting)
        spent, calls = time.perf_counter() - begin, calls + 1
    return spent / calls, found


def honest(curve):
    """
    Return error, setting and times of each run, from fine to coarse.

    The error is the largest of this and all finer runs, which excludes accidentally small errors.
    """
    worst, found = 0.0, []
    for point in reversed(curve):
        worst = max(worst, point['error'], 1e-15)
        found.append((worst, point['setting'], point['times']))
    return found


def time_at(curve, level, repeat):
    """Return the minimum time for an error, interpolated between the adjacent runs [s]."""
    least, finer = math.nan, None
    for error, _, times in honest(curve):
        spent = times[repeat]
        if error > level:
            if finer is not None:
                part = math.log(error / level) / math.log(error / finer[0])
                least = min(least, spent * (finer[1] / spent)**part)
            break
        # A coarser run is not always faster: more steps are rejected.
        least, finer = min(spent, least) if finer else spent, (error, spent)
    return least
