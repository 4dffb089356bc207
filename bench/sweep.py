# SPDX-License-Identifier: Apache-2.0
"""Time sweeps of increasing size on all cores: the cost per case must stay constant."""
import os
from pathlib import Path
from tempfile import TemporaryDirectory
import time

import kernels

from ballbot_ros.crossing.max_step_height import WORKSPACE
from ballbot_ros.physics import load_robot
from ballbot_ros.studies.parallel_map import worker_pool
from ballbot_ros.studies.sweep import run_block, run_sweep
from ballbot_ros.studies.sweep_plan import SweepPlan

SIZES = (5_000, 10_000, 20_000, 40_000)
REPEATS = 3
MILLION = 1e6


def planned(size):
    """Return a sweep over four parameters."""
    return SweepPlan(load_robot('gimball'), design='sobol', cases=size, ranges={
        'speed': (0.3, 1.2), 'height': (0.003, 0.06), 'ball_inertia': (0.05, 0.116),
        'edge_friction': (0.1, 0.3)})


def alone(size=2000):
    """Return processor time [s] and right-hand sides of one crossing, without a pool."""
    WORKSPACE.spent[:] = 0
    begin = time.process_time()
    run_block(planned(size), 0, size)
    return (time.process_time() - begin) / size, WORKSPACE.spent[1] / size


def measure():
    cores = os.cpu_count() or 1
    times = {size: [] for size in SIZES}
    with TemporaryDirectory() as folder, worker_pool(cores) as (pool, _):
        def spent(size):
            plan = planned(size)
            begin = time.perf_counter()
            run_sweep(plan, Path(folder) / 'sweep.parquet', pool, cores)
            return time.perf_counter() - begin
        spent(SIZES[0])
        for _ in range(REPEATS):
            for size in SIZES:
                times[size].append(spent(size))
    for size, values in times.items():
        yield f'sweep of {size} crossings, each', 'us', [
            1e6 * value / size for value in values], None
    alone()
    spent, calls = zip(*(alone() for _ in range(REPEATS)))
    yield 'one crossing, time of a processor', 'us', [1e6 * value for value in spent], None
    yield 'one crossing, right-hand sides', '', calls, None
    yield 'cost of a case, largest sweep / smallest', 'x', [
        many / few * SIZES[0] / SIZES[-1]
        for few, many in zip(times[SIZES[0]], times[SIZES[-1]])], None
    yield f'a million crossings on {cores} cores, at that rate', 'min', [
        value / SIZES[-1] * MILLION / 60.0 for value in times[SIZES[-1]]], 0.25
    # A lower bound, see docs/speed_and_accuracy.md.
    least = min(map(min, kernels.step_times().values()))
    yield f'a million crossings on {cores} cores, right-hand sides alone', 'min', [
        value * least * MILLION / cores / 60.0 for value in calls], None
