# SPDX-License-Identifier: Apache-2.0
"""Time the black box per period of the bridge loop and per file."""
from pathlib import Path
import tempfile
import time

from ballbot_ros.black_box.dump import write_file
from ballbot_ros.black_box.read import read_black_box
from ballbot_ros.black_box.ring import BlackBox, MOST_BLOCKS
from ballbot_ros.paper.pulled_plug import RecordedLine

REPEATS, PERIODS, RATE = 5, 20_000, 500.0


def measure():
    line = RecordedLine()
    line.session.configure()
    line.run(line.now + 0.2)
    session, box = line.session, BlackBox()
    estimate, telemetry = session.fusion.estimate, session.line.driver.telemetry
    costs = []
    for repeat in range(REPEATS):
        begin = time.thread_time()
        for count in range(PERIODS):
            box.period(count / RATE, estimate, session.supervisor, telemetry,
                       session.control.power.state)
            box.record('>', b'c 0 0.000001105e4 *9\nf 0\n')
            box.record('<', b'5.363770 5.359529*39\r\n')
            box.command(0.2, count / RATE)
        costs.append(1e6 * (time.thread_time() - begin) / PERIODS)
    yield 'black box: a period with its traffic and command', 'us', costs, None
    yield 'black box: part of a core at 500 Hz', '%', [1e-4 * RATE * cost for cost in costs], 0.5
    while len(box.snapshot()) < MOST_BLOCKS - 1:
        for _ in range(3000):
            box.record('<', b'5.363770 5.359529*39\r\n')
    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        path = write_file(Path(folder), box, box.clock(), 'bench', {})
        wrote = time.perf_counter() - begin
        size = path.stat().st_size / 2**20
        begin = time.perf_counter()
        read_black_box(path)
        read = time.perf_counter() - begin
    yield 'black box: a full file is written in', 's', [wrote], None
    yield 'black box: its size', 'MiB', [size], 96.0
    yield 'black box: and read in', 's', [read], None
