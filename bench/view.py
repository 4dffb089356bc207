# SPDX-License-Identifier: Apache-2.0
"""
Measure the live page: frames that reach a browser, and the processor load.

    .venv/bin/python bench/view.py

The process of ``ballbot view`` simulates and draws; a client that receives every message replaces
the browser.  Together they have the load of a user's machine without rendering.
"""
from pathlib import Path
import subprocess
import sys
import time

from loop import processor_time
import msgspec.msgpack
import zstandard

WINDOW = 10.0  # of the measurement [s]
REPEATS = 3
SETTLE = 3.0  # after the first frame, while the page is sent and caches fill [s]


def names_in(message):
    """Return the types of the parts of a message, and which nodes of the scene they move."""
    packed = int.from_bytes(message[8:16], 'little')
    content = msgspec.msgpack.decode(
        zstandard.ZstdDecompressor().decompress(message[16:16 + packed]))
    return [(part.get('type'), part.get('name')) for part in content['messages']]


def count(connection, seconds):
    """Receive messages for a number of seconds; return the number that moved the ball."""
    frames, end = 0, time.monotonic() + seconds
    while time.monotonic() < end:
        frames += any(name == '/world/place' and 'Position' in kind
                      for kind, name in names_in(connection.recv(timeout=60)) if name)
    return frames


def watch(scene):
    """Return received frames per second, and the processor load of the process [cores]."""
    import looker
    process = subprocess.Popen(
        [sys.executable, '-m', 'ballbot_ros.cli', 'view', scene, '--no-browser', '--port', '0'],
        stdout=subprocess.PIPE, text=True, cwd=Path(__file__).resolve().parent.parent)
    try:
        url = process.stdout.readline().split()[0]
        with looker.look(url) as connection:
            count(connection, SETTLE)
            begin, used = time.monotonic(), processor_time(process.pid)
            frames = count(connection, WINDOW)
            took = time.monotonic() - begin
            return frames / took, (processor_time(process.pid) - used) / took
    finally:
        process.terminate()
        process.wait()


def measure():
    runs = [watch('voltage_start') for _ in range(REPEATS)]
    yield 'view: frames that reach a browser', '1/s', [run[0] for run in runs], -29.0
    yield 'view: share of a core, simulation included', '1', [run[1] for run in runs], 0.5


if __name__ == '__main__':
    sys.path[:0] = [str(Path(__file__).resolve().parent.parent / 'test' / 'oracles')]
    for name, unit, values, _ in measure():
        print(f'{name}: {", ".join(f"{value:.2f}" for value in values)} {unit}')
