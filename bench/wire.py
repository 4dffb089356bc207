# SPDX-License-Identifier: Apache-2.0
"""Measure the link to the motor: latency, bytes, codecs, corrupted bytes and unplugging."""
import os
from pathlib import Path
import random
import threading
import time

import numpy as np

from ballbot_ros.drives import codec_of, device_class, driver_class, DRIVES, open_driver, open_line
from ballbot_ros.drives.memory_line import MemoryLine
from ballbot_ros.emulator.ball import settings_for
from ballbot_ros.emulator.emulator import Emulator
from ballbot_ros.errors import LinkError
from ballbot_ros.physics.simulation.scene import load_scene

PROTOCOLS = tuple(sorted(DRIVES))
# The highest baud rate in the manual of each manufacturer.
FASTEST = {protocol: max(driver_class(protocol).baud_rates) for protocol in PROTOCOLS}
RATE = 500.0
FRAMES = 1_000_000
CYCLES = 1_000
LATE = 16  # periods that a VESC packet with the largest short length delays
STEP = 0.08 / 64  # commanded torques are multiples of it [N m]


def measure():
    yield from budgets()
    yield from codecs()
    for protocol in PROTOCOLS:
        yield from latency(protocol)
    for protocol in PROTOCOLS:
        yield from bad_line(protocol)
    yield from plugs()


def options_for(protocol, settings):
    """Return the options of a driver that fits an emulated drive."""
    return driver_class(protocol).Options(torque_limit=settings.torque_limit)


def budgets():
    """Yield bytes per period and the highest loop rate, from the drivers' own budgets."""
    for protocol in PROTOCOLS:
        driver = open_driver(protocol, None, driver_class(protocol).Options(torque_limit=0.08))
        budget = driver.budget()
        yield f'{protocol}: bytes out of a period', 'B', [budget.bytes_out], None
        yield f'{protocol}: bytes in of a period', 'B', [budget.bytes_in], None
        for baud in sorted({115200, FASTEST[protocol]}):
            yield f'{protocol}: highest loop rate at {baud} baud', 'Hz', [
                budget.highest_rate(baud)], None


def codecs():
    """Yield the replies per second that each parser decodes."""
    for protocol in PROTOCOLS:
        codec, rates = codec_of(protocol), []
        reply = codec.reply_of(b'-12.345678 9.876543')
        for _ in range(5):
            parser = codec.parser()
            begin = time.perf_counter()
            found = sum(len(parser.feed(reply)) for _ in range(20_000))
            rates.append(1e-3 * found / (time.perf_counter() - begin))
        yield f'{protocol}: thousand replies parsed per second', 'k/s', rates, None


def latency(protocol):
    """Yield the time from a command to its bytes at the drive, and the period of the loop."""
    emulator = Emulator(protocol, load_scene('flat'), FASTEST[protocol])
    arrivals, waits, periods = [], [], []
    read = emulator.terminal.read

    def noting(*arguments):
        data = read(*arguments)
        if data:
            arrivals.append(time.perf_counter())
        return data
    emulator.terminal.read = noting
    with emulator, open_line(protocol, emulator.path, emulator.baud) as link:
        driver = open_driver(protocol, link, options_for(protocol, emulator.settings))
        driver.identify()
        driver.arm()
        used, due = time.thread_time(), time.perf_counter()
        begin = before = due
        while due - begin < 6.0:
            due += 1.0 / RATE
            time.sleep(max(0.0, due - time.perf_counter()))
            periods.append(1e3 * (time.perf_counter() - before))
            before = time.perf_counter()
            driver.poll()
            count, sent = len(arrivals), time.perf_counter()
            driver.send_torque(STEP)
            waits.append((sent, count))
        used = 100.0 * (time.thread_time() - used) / (time.perf_counter() - begin)
        driver.stop()
    delays = [1e3 * (arrivals[count] - sent) for sent, count in waits if count < len(arrivals)]
    yield f'{protocol}: command to wire, median', 'ms', [np.quantile(delays, 0.5)], 1.0
    yield f'{protocol}: command to wire, p99', 'ms', [np.quantile(delays, 0.99)], None
    yield f'{protocol}: loop at {RATE:g} Hz, p99 period', 'ms', [np.quantile(periods, 0.99)], 4.0
    yield f'{protocol}: driver in that loop, part of a core', '%', [used], 25.0
    lost = 100.0 * driver.counts['lost'] / max(1, driver.counts['sent'])
    yield f'{protocol}: replies lost in that loop', '%', [lost], None


def run_bad_line(protocol, frames, part):
    """Send torques over a corrupted line; return the torque of the motor after each."""
    settings = settings_for(load_scene('flat').model.robot)
    line = MemoryLine(device_class(protocol)(settings))
    driver = open_driver(protocol, line, options_for(protocol, settings), line.clock)
    rng, damage = random.Random(7), 0.0

    def damaged(data):
        if not data or rng.random() >= damage:
            return data
        changed = bytearray(data)
        changed[rng.randrange(len(data))] ^= rng.randrange(1, 256)
        return bytes(changed)
    line.to_drive = line.from_drive = damaged
    driver.identify()
    driver.arm()
    damage = part
    torques = []
    for number in range(frames):
        line.pass_time(0.002)
        driver.poll()
        driver.send_torque(STEP * ((number * 37) % 129 - 64))
        torques.append(line.device.torque())
    return torques


def bad_line(protocol):
    """
    Yield the number of wrong torques in a million frames of which 1 % have a corrupted byte.

    A torque is not wrong if it is that of a clean line, the previous one (command refused), that
    of one of the last LATE commands (delayed by a corrupted length), or negligible (less than a
    thousandth of the limit).
    """
    clean = run_bad_line(protocol, 129, 0.0)
    torques = run_bad_line(protocol, FRAMES, 0.01)
    wrong = kept = late = nothing = 0
    before = 0.0
    for number, torque in enumerate(torques):
        if abs(torque - clean[number % 129]) > 1e-9:
            if torque == before:
                kept += 1
            elif abs(torque) < 8e-5:
                nothing += 1
            elif any(abs(torque - clean[(number - ago) % 129]) < 1e-9
                     for ago in range(1, LATE + 1)):
                late += 1
            else:
                wrong += 1
        before = torque
    yield f'{protocol}: wrong torques in a million frames', '', [wrong], 0.5
    yield f'{protocol}: commands refused by the drive', '', [kept], None
    yield f'{protocol}: commands obeyed late', '', [late], None
    yield f'{protocol}: commands cut to nothing', '', [nothing], None


def plugs():
    """Yield the leaks after repeated unplugging."""
    emulator = Emulator('odrive', load_scene('flat'), FASTEST['odrive'])
    back = []
    with emulator:
        for cycle in range(CYCLES):
            if cycle == CYCLES // 10:  # after one-time allocations
                before = used()
            back.append(1e3 * session(emulator))
        after = used()
    for name, unit, first, last in zip(
            ('resident memory', 'threads', 'open files'), ('kB', '', ''), before, after):
        yield f'more {name} after {CYCLES} replugs', unit, [last - first], None
    yield 'from plug to torque', 'ms', [np.quantile(back, 0.5)], 1000.0
    yield 'from plug to torque, longest', 'ms', [max(back)], None


def session(emulator):
    """Open the port, arm, drive, and unplug; return the time until the first torque [s]."""
    begin = time.perf_counter()
    with open_line('odrive', emulator.path, emulator.baud) as link:
        driver = open_driver('odrive', link, options_for('odrive', emulator.settings))
        driver.identify()
        driver.arm()
        driver.send_torque(STEP)
        while emulator.torque == 0.0 and time.perf_counter() < begin + 5.0:
            driver.poll()
            time.sleep(0.0005)
        spent = time.perf_counter() - begin
        emulator.call(emulator.terminal.unplug)
        try:
            driver.send_torque(STEP)
            raise RuntimeError('the unplugged line was not detected')
        except LinkError:
            emulator.call(emulator.terminal.plug)
    return spent


def used():
    """Return resident memory [kB], threads and open files of this process."""
    lines = Path('/proc/self/status').read_text().splitlines()
    status = dict(line.split(':', 1) for line in lines)
    return (int(status['VmRSS'].split()[0]), threading.active_count(),
            len(os.listdir('/proc/self/fd')))
