# SPDX-License-Identifier: Apache-2.0
"""Time searches for the maximum step height by number of threads: kernels release the GIL."""
import os
import time

import numpy as np

from ballbot_ros.crossing import max_step_heights
from ballbot_ros.physics import load_robot

SPEEDS = np.linspace(0.3, 1.2, 600)
REPEATS = 3


def measure():
    """Yield name, unit, values and target of each measurement."""
    robot, cores = load_robot('gimball'), os.cpu_count() or 1

    def spent(threads):
        begin = time.perf_counter()
        max_step_heights(robot, SPEEDS, threads=threads)
        return time.perf_counter() - begin
    spent(cores)
    alone = [spent(1) for _ in range(REPEATS)]
    yield 'one height, one thread, each', 'ms', [1e3 * t / len(SPEEDS) for t in alone], None
    threads = 2
    while threads <= cores:
        many = [spent(threads) for _ in range(REPEATS)]
        yield f'{threads} threads, times as fast as one', 'x', [
            one / several for one, several in zip(alone, many)], None
        threads *= 2
