# SPDX-License-Identifier: Apache-2.0
"""
Run the bridge for a long time, or unplug it often; monitor its memory, threads and open files.

    .venv/bin/python bench/node_resources.py --seconds 600
    .venv/bin/python bench/node_resources.py --unplugs 1000

The black box is disabled, since it would fill its 64 MiB over the first ten minutes: any growth is
a leak.  Ctrl-C ends the run and prints the results so far.
"""
import argparse
from pathlib import Path
import sys
from tempfile import TemporaryDirectory
import time

from bridge import running

from ballbot_ros.emulator.control import execute

HEAD = f'{"":>10}{"MiB":>8}{"threads":>9}{"files":>7}{"most ms between torques":>25}'


def resources(process):
    """Return resident memory [MiB], threads and open files of a process."""
    status = dict(line.split(':', 1) for line in
                  Path(f'/proc/{process}/status').read_text().splitlines())
    files = len(list(Path(f'/proc/{process}/fd').iterdir()))
    return int(status['VmRSS'].split()[0]) / 1024.0, int(status['Threads']), files


def row(label, bench, mark):
    """Print one line; `mark` is the last read position of the log of torques."""
    memory, threads, files = resources(bench.process)
    times = [when for when, _ in list(bench.emulator.log)[mark:]]
    most = max((after - before for before, after in zip(times, times[1:])), default=float('nan'))
    print(f'{label:>10}{memory:8.1f}{threads:9}{files:7}{1e3 * most:25.1f}', flush=True)
    bench.emulator.call(bench.emulator.log.clear)


def last(bench, seconds):
    """Run the bridge; print a line after each tenth."""
    begin = time.monotonic()
    for part in range(1, 11):
        bench.spin(max(0.0, begin + seconds * part / 10.0 - time.monotonic()))
        row(f'{seconds * part / 10.0:.0f} s', bench, 0)


def unplug(bench, times):
    """Unplug and replug, with `rearm`; print a line after each tenth."""
    longest = 0.0
    for number in range(1, times + 1):
        execute(bench.emulator, 'unplug')
        while bench.emulator.torque:  # until the watchdog of the drive stops the motor
            bench.spin(0.01)
        execute(bench.emulator, 'plug')
        begin = time.monotonic()
        bench.emulator.call(bench.emulator.log.clear)
        while not bench.emulator.torque:
            bench.spin(0.01)
            if time.monotonic() > begin + 10.0:
                sys.exit(f'after unplug {number} the motor was not driven again within 10 s: '
                         f'{bench.status.state} {bench.status.e_stop}\n'
                         + bench.nodes.log('bridge').read_text()[-600:])
        longest = max(longest, time.monotonic() - begin)
        if number % max(1, times // 10) == 0:
            row(f'{number} times', bench, 0)
    print(f'back in service after {longest:.2f} s at the longest')


def main():
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument('--seconds', type=float, help='duration of the drive [s]')
    what.add_argument('--unplugs', type=int, help='number of unplugs')
    arguments = parser.parse_args()
    print(HEAD)
    try:
        with TemporaryDirectory() as folder, running(
                Path(folder), black_box='') as bench:
            bench.spin(1.0)
            row('start', bench, 0)
            if arguments.seconds:
                last(bench, arguments.seconds)
            else:
                unplug(bench, arguments.unplugs)
    except KeyboardInterrupt:
        print('interrupted')


if __name__ == '__main__':
    main()
