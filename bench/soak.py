# SPDX-License-Identifier: Apache-2.0
"""
Run the bridge for a long time on an idle or overloaded machine, and count events.

    .venv/bin/python bench/soak.py --seconds 600
    .venv/bin/python bench/soak.py --seconds 600 --busy 4
    .venv/bin/python bench/soak.py --seconds 600 --busy 4 --realtime 20
    .venv/bin/python bench/soak.py --seconds 600 --busy 4 --realtime 20 --workers 25

Link and drive have no faults, so each e-stop is spurious.  A real drive does not compete for the
processor, so the emulated drive, and with `--realtime` the bridge, get real-time priority, which
the system must permit (docs/realtime.md).  `--workers` also raises the priority of the kernel
threads that deliver the bytes of the line.  After an e-stop, the run continues with a release.
A program that repeatedly sleeps for 2 ms runs in parallel: gaps that it shares are caused by the
machine, for example by the host of a virtual machine.
"""
import argparse
from collections import Counter
from contextlib import contextmanager
import os
from pathlib import Path
import subprocess
import sys
from tempfile import TemporaryDirectory
from threading import Event, Thread

from bridge import applied, emulated_apart, running
from loop import processor_time
import numpy as np

from ballbot_ros.clock import steady_time

DRIVE_PRIORITY = 50
GAPS = (0.005, 0.01, 0.02, 0.05, 0.1)  # between two torques in the drive [s]
WAITING = """
import signal, sys, time
from ballbot_ros.clock import steady_time
times = [steady_time()]
def end(number, frame):
    print(*times, sep='\\n')
    sys.exit()
signal.signal(signal.SIGTERM, end)
while True:
    time.sleep(0.002)
    times.append(steady_time())
"""


@contextmanager
def busy_processes(number):
    """Load the machine with a number of busy processes."""
    processes = [subprocess.Popen([sys.executable, '-c', 'while True: pass'])
                 for _ in range(number)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def schedule_workers(policy, priority):
    """Set the scheduling of all kernel threads of unbound workqueues."""
    for comm in Path('/proc').glob('[0-9]*/comm'):
        try:
            if comm.read_text().startswith('kworker/u'):
                os.sched_setscheduler(int(comm.parent.name), policy, os.sched_param(priority))
        except (FileNotFoundError, ProcessLookupError):
            continue  # it has ended


@contextmanager
def kernel_workers(priority):
    """Give kernel workers, which come and go, a SCHED_FIFO priority, or 0 for none."""
    if not priority:
        yield
        return
    schedule_workers(os.SCHED_FIFO, priority)
    ended = Event()

    def repeat():
        while not ended.wait(0.5):
            schedule_workers(os.SCHED_FIFO, priority)

    thread = Thread(target=repeat)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        schedule_workers(os.SCHED_OTHER, 0)


@contextmanager
def waiting(found):
    """Run a sleeping program; add its wake-up times [s] to `found`."""
    process = subprocess.Popen([sys.executable, '-c', WAITING], stdout=subprocess.PIPE, text=True)
    try:
        yield
    finally:
        process.terminate()
        found += [float(line) for line in process.communicate()[0].split()]


def stolen():
    """Return the steal time of all cores [s]."""
    words = Path('/proc/stat').read_text().splitlines()[0].split()
    return int(words[8]) / os.sysconf('SC_CLK_TCK')


def periods_of(times):
    """Return the differences between consecutive times [s]."""
    return [after - before for before, after in zip(times, times[1:])]


def line_of(periods):
    """Return the statistics of periods as two lines of text."""
    counts = ', '.join(f'{sum(period > gap for period in periods)} above {1e3 * gap:g} ms'
                       for gap in GAPS)
    return (f'median {1e3 * np.quantile(periods, 0.5):.2f} ms, '
            f'p99 {1e3 * np.quantile(periods, 0.99):.2f} ms, longest {1e3 * max(periods):.1f} ms\n'
            f'      gaps: {counts}')


@contextmanager
def drive(folder):
    """Yield an emulated drive with real-time priority, if permitted."""
    with emulated_apart(folder) as emulator:
        # The drive is the last child that this process started.
        children = Path(f'/proc/self/task/{os.getpid()}/children').read_text().split()
        try:
            for thread in Path(f'/proc/{children[-1]}/task').iterdir():
                os.sched_setscheduler(
                    int(thread.name), os.SCHED_FIFO, os.sched_param(DRIVE_PRIORITY))
        except PermissionError:
            print('the drive has no real-time priority: expect gaps that are its own')
        yield emulator


def run(folder, arguments):
    """Return start, end, e-stops by reason and processor load of the bridge [% of a core]."""
    stops, parameters = Counter(), {'realtime_priority': arguments.realtime}
    with running(folder, drive, arguments.control, rearm=False, **parameters) as bench, \
            busy_processes(arguments.busy), kernel_workers(arguments.workers):
        bench.spin(1.0)
        used, begin = processor_time(bench.process), steady_time()
        while steady_time() - begin < arguments.seconds:
            bench.spin(0.1)
            if bench.status is not None and bench.status.e_stop:
                stops[bench.status.e_stop_reason] += 1
                bench.release(timeout=60.0)
        end = steady_time()
        used = 100.0 * (processor_time(bench.process) - used) / (end - begin)
    return begin, end, stops, used


def main():
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--seconds', type=float, default=600.0, help='how long')
    parser.add_argument('--busy', type=int, default=0, help='processes that compute meanwhile')
    parser.add_argument('--realtime', type=int, default=0, help='realtime_priority of the bridge')
    parser.add_argument('--workers', type=int, default=0,
                        help='SCHED_FIFO priority of the unbound kernel workers, as root')
    parser.add_argument('--control', choices=('onboard', 'direct'), default='onboard')
    arguments = parser.parse_args()
    woken, steal = [], stolen()
    with TemporaryDirectory() as name:
        folder = Path(name)
        with waiting(woken):
            begin, end, stops, used = run(folder, arguments)
        times = [when for when, _ in applied(folder / 'log.csv', begin, end)]
    print(f'{end - begin:.0f} s, {arguments.control}, {arguments.busy} busy processes, real-time '
          f'priority {arguments.realtime}, of kernel workers {arguments.workers}: '
          f'{used:.1f} % of a core')
    print(f'e-stops: {sum(stops.values())}')
    for reason, count in stops.most_common():
        print(f'{count:6}  {reason}')
    print(f'torques in the drive: {line_of(periods_of(times))}')
    own = periods_of([when for when in woken if begin <= when <= end])
    print(f'a program that waits: {line_of(own)}')
    print(f'the host of this machine took {stolen() - steal:.1f} s of its cores')


if __name__ == '__main__':
    main()
