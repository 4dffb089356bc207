# SPDX-License-Identifier: Apache-2.0
"""Time the nodes: the closed loop over real topics, in real time and in lockstep."""
from contextlib import contextmanager
import os
from pathlib import Path
import subprocess
import sys
import tempfile
import time

import numpy as np
from rclpy.node import Node
import round_trip

from ballbot_ros.bags.writer import stamp_of
from ballbot_ros.demo.processes import environment, NodeProcesses, own_domain, parameter_arguments
from ballbot_ros.ros import qos
from ballbot_ros.ros.endpoints import create_subscription

SETTLE = 2.0  # wall time before the measurement, for discovery and caches [s]
WINDOW = 6.0  # wall time of the measurement [s]
REPEATS = 3


def processor_time(process_id):
    """Return user and system time that a process has used [s]."""
    fields = Path(f'/proc/{process_id}/stat').read_text().rsplit(')', 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


@contextmanager
def running(folder, domain, parameters, together):
    """Yield the process id of a simulator with a controller, in one process or in two."""
    if not together:
        with NodeProcesses(folder, domain) as nodes:
            nodes.start('simulator', parameters)
            nodes.start('controller')
            yield nodes._running['simulator'].pid
        return
    words = parameter_arguments({f'simulator:{key}': one for key, one in parameters.items()})
    process = subprocess.Popen(
        [sys.executable, '-m', 'ballbot_ros.cli', 'run', 'simulator', 'controller', *words],
        env=environment(domain, folder), stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL)
    try:
        yield process.pid
    finally:
        process.terminate()
        process.wait()


def watch(lockstep, together=False):
    """
    Run simulator and controller and record the commands.

    Returns arrival times [s], stamps [s], and the processor load of the simulator [cores].
    """
    domain, arrivals, stamps = own_domain(), [], []

    def note(data):
        arrivals.append(time.perf_counter())
        stamps.append(1e-9 * stamp_of(data))

    with round_trip.joined(domain, lambda: Node('bench')) as (executor, node), \
            tempfile.TemporaryDirectory() as folder, \
            running(Path(folder), domain, {
                'lockstep': lockstep, 'real_time_factor': 0.0 if lockstep else 1.0},
                together) as process:
        create_subscription(node, 'joint_commands', note, profile=qos.STATE, raw=True)
        deadline = time.perf_counter() + 60.0
        while not arrivals and time.perf_counter() < deadline:
            executor.spin_once(timeout_sec=0.1)
        round_trip.spin(executor, SETTLE)
        arrivals.clear()
        stamps.clear()
        before = processor_time(process)
        begin = time.perf_counter()
        round_trip.spin(executor, WINDOW)
        spent = time.perf_counter() - begin
        used = (processor_time(process) - before) / spent
    return arrivals, stamps, used


def measure():
    middle, late, used, factors, together = [], [], [], [], []
    for _ in range(REPEATS):
        arrivals, stamps, share = watch(lockstep=False)
        periods = [1e3 * (after - before) for before, after in zip(arrivals, arrivals[1:])]
        middle.append(np.quantile(periods, 0.5))
        late.append(np.quantile(periods, 0.99))
        used.append(100.0 * share)
        for found, one in ((factors, False), (together, True)):
            arrivals, stamps, _ = watch(lockstep=True, together=one)
            found.append((stamps[-1] - stamps[0]) / (arrivals[-1] - arrivals[0]))
    yield 'closed loop at 500 Hz in real time, median period', 'ms', middle, None
    yield 'closed loop at 500 Hz in real time, p99 period', 'ms', late, 4.0
    yield 'simulator node in real time, part of a core', '%', used, 15.0
    yield 'lockstep at 500 Hz control, times real time', 'x', factors, -8.0
    yield 'the same, both nodes in one process', 'x', together, -8.0
    yield from round_trip.measure()
