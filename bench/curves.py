# SPDX-License-Identifier: Apache-2.0
"""Work-precision curves: time a run, and read the time for an error off a curve."""
import math
import time


def timed(run, setting):
    """Return time [s] and result of a run, short ones several times over."""
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

    The error of a run is the largest of all finer ones, which excludes chance hits.
    """
    worst, found = 0.0, []
    for point in reversed(curve):
        worst = max(worst, point['error'], 1e-15)
        found.append((worst, point['setting'], point['times']))
    return found


def time_at(curve, level, repeat):
    """Return the least time for an error, on the line between runs above and below [s]."""
    least, finer = math.nan, None
    for error, _, times in honest(curve):
        spent = times[repeat]
        if error > level:
            if finer is not None:
                part = math.log(error / level) / math.log(error / finer[0])
                least = min(least, spent * (finer[1] / spent)**part)
            break
        # Coarser is not always quicker: steps are rejected more often.
        least, finer = min(spent, least) if finer else spent, (error, spent)
    return least
