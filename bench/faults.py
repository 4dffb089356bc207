# SPDX-License-Identifier: Apache-2.0
"""
Measure the time to zero torque of every fault, worst of 20, in onboard and in direct control.

Faults that end a node are measured ten times per control mode.

    make bench ARGS='--only faults'                       # about ten minutes
    .venv/bin/python bench/faults.py --repeats 3          # shorter
    .venv/bin/python bench/faults.py --only 'e-stop' --control direct
    .venv/bin/python bench/faults.py --write              # also updates docs/hardware_bridge.md

The time is from the fault to the last torque in the log of an emulated ODrive at 921600 baud.
Most faults act on the loop of the bridge in this process, signals and the e-stop on a node.
Results are stored in a file: the same command resumes an interrupted run.
"""
import argparse
from dataclasses import replace
import json
import logging
import os
from pathlib import Path
import random
import signal
from statistics import median
import subprocess
import sys
import tempfile
import threading
import time
from typing import NamedTuple

from documents import show, table

from ballbot_ros.bridge.condition import Battery
from ballbot_ros.bridge.drive_line import connector
from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.bridge.loop import Loop
from ballbot_ros.bridge.session import Session
from ballbot_ros.clock import steady_time
from ballbot_ros.control import (
    load_tuning, Mode, PendulumController, SetPoint, SupervisedController, Supervision)
from ballbot_ros.emulator.control import execute
from ballbot_ros.emulator.emulator import Emulator
from ballbot_ros.errors import BallbotError, MessageError, RefusedError
from ballbot_ros.estimation import ImuReading
from ballbot_ros.physics.simulation.scene import load_scene

REPEATS = 20
# Fewer, because a node takes seconds to start and its end is independent of the control mode.
PART_OF_NODES = 0.5
KEPT = Path('ballbot_output/faults.json')
TORQUE, ANGLE = 0.3, 0.3  # commanded in direct control [N m], set-point in onboard control [rad]
FEED = 0.004  # between IMU readings and commands; every fifth time a set-point [s]
QUIET = 0.2  # duration without torque that counts as zero [s]
LONGEST = 6.0  # timeout for zero torque [s]
HOUR = 3600.0


class Fault(NamedTuple):
    """Action of a fault, and the bound of the time to zero."""

    name: str
    act: object  # called with the rig; returns the start of the fault [s], None for the call
    bound: str
    onboard: bool = True
    direct: bool = True


class Rig:
    """An emulated robot and a session that drives it, for single trials."""

    def __init__(self, control, emulator, scene, folder):
        self.control, self.emulator, self.robot = control, emulator, scene.model.robot
        found = load_hardware('gimball_odrive').at(str(folder / 'motor'))
        self.hardware = replace(found, battery=Battery())
        self.session = self.loop = None
        self.busy = []

    def law(self):
        """Return the onboard controller, None in direct control."""
        if self.control == 'direct':
            return None
        limits = self.hardware.limits
        return SupervisedController(
            PendulumController(self.robot, load_tuning('gentle')),
            Supervision(20.0, 0.5, let_down_time=limits.damping_time))

    def trial(self, fault):
        """Trigger a fault under torque, and return the time to zero [s]."""
        self.imu = self.commands = True
        self.explode, self.shift, self.ahead = False, 0.0, 0.0
        self.last, self.pushing, self.ending = 0.0, False, False
        for line in ('clear', 'plug', 'reset'):
            execute(self.emulator, line)
        self.until(lambda: steady_time() > self.emulator.device.booted_at, 'the drive is up')
        self.session = Session(self.hardware, self.robot, connector(self.hardware),
                               law=self.law())
        self.session.configure()
        self.session.activate()
        self.loop = Loop(self.session, self.hardware.connection.loop_rate, self.take)
        feeder = threading.Thread(target=self.feed)
        feeder.start()
        try:
            self.until(self.released, 'the e-stop is released')
            self.pushing = True
            self.until(lambda: self.emulator.torque, 'the motor applies a torque')
            time.sleep(random.uniform(0.1, 0.15))
            begin = steady_time()
            begin = fault.act(self) or begin
            return zero(self.emulator) - begin
        finally:
            self.ending = True
            feeder.join()
            self.loop.end()
            while self.busy:
                process = self.busy.pop()
                process.kill()
                process.wait()

    def take(self, report):
        """Raise the injected exception, if any."""
        if self.explode:
            raise ZeroDivisionError('planted')

    def feed(self):
        """Feed the session with IMU readings, and commands or set-points."""
        turn = 0
        while not self.ending:
            now, turn = steady_time(), turn + 1
            sample = self.emulator.imu()
            try:
                if self.imu:
                    self.session.imu(ImuReading(
                        now + self.shift, sample.turn_rate, sample.forward, sample.upward))
                if self.commands and self.pushing:
                    if self.control == 'direct':
                        self.last = now
                        self.session.command(TORQUE, now + self.shift + self.ahead)
                    elif turn % 5 == 0:
                        self.last = now
                        self.session.give(SetPoint(Mode.HOLD, ANGLE, now + self.shift))
            except MessageError:
                pass  # counted by the session
            time.sleep(FEED)

    def released(self):
        """Try to release the e-stop; return whether it succeeded."""
        try:
            self.session.release()
        except RefusedError:
            return False
        return True

    def until(self, condition, description, timeout=10.0):
        """Wait for a condition; raise TimeoutError with its description."""
        end = steady_time() + timeout
        while not condition():
            if steady_time() > end:
                cause = self.session.supervisor.e_stop if self.session else None
                raise TimeoutError(
                    f'not reached: {description}: {cause.text if cause else ""}')
            time.sleep(0.005)

    # Faults

    def stop_commands(self):
        """Stop the commands; return the time of the last one."""
        self.commands = False
        time.sleep(2.0 * FEED)
        return self.last

    def stamp_ahead(self):
        """Stamp the last command 49 ms in the future."""
        self.ahead = 0.049
        time.sleep(3.0 * FEED)
        return self.stop_commands()

    def make_busy(self):
        """Stop the commands while four other programs load the processor."""
        self.busy = [subprocess.Popen([sys.executable, '-c', 'while True: pass'])
                     for _ in range(4)]
        time.sleep(0.3)
        return self.stop_commands()


def emulator_command(line):
    """Return an action that sends a line to the emulated drive."""
    return lambda rig: execute(rig.emulator, line) and None


def put(**values):
    """Return an action that changes the feeder or the loop."""
    return lambda rig: [setattr(rig, name, value) for name, value in values.items()] and None


TIMEOUT = 'command_timeout, 0.1 s'
DRIVE = 'watchdog of the drive, 0.1 s'
FAULTS = (
    Fault('last command', Rig.stop_commands, TIMEOUT, onboard=False),
    Fault('last set-point', Rig.stop_commands,
          'set_point_timeout 0.5 s, let down 2 s, and the load, at most 0.1 s', direct=False),
    Fault('last command stamped 49 ms ahead', Rig.stamp_ahead, TIMEOUT, onboard=False),
    Fault('last command, four busy programs', Rig.make_busy, f'{TIMEOUT}, and the load',
          onboard=False),
    Fault('IMU silent', put(imu=False), 'IMU_TIMEOUT 0.05 s and a period'),
    Fault('stamps of all senders an hour ahead', put(shift=HOUR), 'IMU_TIMEOUT 0.05 s'),
    Fault('unplugged', emulator_command('unplug'), DRIVE),
    Fault('drive silent', emulator_command('silence 1'), 'MEASUREMENT_AGE_MAX 0.1 s and a period'),
    Fault('drive takes no bytes', emulator_command('slow_reader 0'), DRIVE),
    Fault('drive reboots', emulator_command('reboot'), 'the drive, immediately'),
    Fault('over-current in the drive', emulator_command('over_current'), 'the drive, immediately'),
    Fault('power stage too hot', emulator_command('temperature 120'), 'the drive, immediately'),
    Fault('exception in the loop', put(explode=True), 'the stop at the end of the loop'),
    Fault('e-stop engaged, in the session', lambda rig: rig.session.engage('bench'),
          'one write'))
# Signals that end a node.
NODES = {'SIGINT': signal.SIGINT, 'SIGTERM': signal.SIGTERM, 'SIGKILL': signal.SIGKILL}
BOUNDS = {'SIGINT': 'the stop at the end', 'SIGTERM': 'the stop at the end', 'SIGKILL': DRIVE,
          'e-stop, by service': 'one call and one write', 'process frozen': DRIVE}


class Book:
    """Stores and prints the results."""

    def __init__(self, path):
        self.path, self.times = path, {}
        if path.exists():
            self.times = json.loads(path.read_text())
            print(f'going on with {path}; remove it to start again', file=sys.stderr)

    def have(self, control, fault):
        """Return the stored times [s]."""
        return self.times.setdefault(f'{control}: {fault}', [])

    def add(self, control, fault, seconds, repeats):
        """Store a time and print the progress; negative times are discarded."""
        if seconds < 0.0:
            print(f'\n{control}: {fault}: the torque had ended before, held up by others?',
                  file=sys.stderr)
            return
        times = self.have(control, fault)
        times.append(round(seconds, 5))
        self.path.parent.mkdir(parents=True, exist_ok=True)
        draft = self.path.with_suffix('.part')
        draft.write_text(json.dumps(self.times, indent=1))
        os.replace(draft, self.path)
        print(f'\r\033[K{control}: {fault} {len(times)}/{repeats}, {1e3 * seconds:.1f} ms',
              end='' if len(times) < repeats else '\n', file=sys.stderr, flush=True)


def measure_loop(book, control, repeats, only):
    """Measure the missing faults of the loop."""
    wanted = [fault for fault in FAULTS if getattr(fault, control)
              and (only is None or only in fault.name)
              and len(book.have(control, fault.name)) < repeats]
    if not wanted:
        return
    scene = load_scene('flat')
    with tempfile.TemporaryDirectory() as name, \
            Emulator('odrive', scene, 921600, link=Path(name) / 'motor') as emulator:
        rig = Rig(control, emulator, scene, Path(name))
        for fault in wanted:
            failures = 0
            while len(book.have(control, fault.name)) < repeats:
                try:
                    seconds = rig.trial(fault)
                    if seconds < 0.0:
                        raise TimeoutError('the torque had ended before, held up by others?')
                    book.add(control, fault.name, seconds, repeats)
                except (TimeoutError, BallbotError) as error:
                    failures += 1
                    print(f'\n{control}: {fault.name}: {error}', file=sys.stderr)
                    if failures > repeats:
                        break


def measure_nodes(book, control, repeats, only):
    """Measure the missing faults that end a node."""
    from bridge import running
    from std_srvs.srv import Trigger
    for name, number in NODES.items():
        before = {'SIGTERM': 'e-stop, by service', 'SIGKILL': 'process frozen'}.get(name, '')
        if only is not None and only not in (name, before):
            continue
        while len(book.have(control, name)) < repeats:
            with tempfile.TemporaryDirectory() as folder, \
                    running(Path(folder), control=control) as bench:
                engage = bench.node.create_client(Trigger, 'bridge/engage_e_stop')
                if before:
                    pull(bench)
                    begin = steady_time()
                    if name == 'SIGTERM':
                        engage.call_async(Trigger.Request())
                    else:
                        bench.nodes.signal('bridge', signal.SIGSTOP)
                    book.add(control, before, zero(bench.emulator, bench.spin) - begin, repeats)
                    bench.nodes.signal('bridge', signal.SIGCONT)
                    bench.spin(0.1)
                    bench.release()
                pull(bench)
                begin = steady_time()
                bench.nodes.signal('bridge', number)
                book.add(control, name, zero(bench.emulator, bench.spin) - begin, repeats)


def pull(bench):
    """Run the motor of a node under torque briefly."""
    end = steady_time() + 20.0
    while not bench.emulator.torque:
        bench.spin(0.02)
        if steady_time() > end:
            raise TimeoutError('the motor never applies a torque')
    bench.spin(random.uniform(0.1, 0.15))


def zero(emulator, pause=time.sleep):
    """Wait until the torque remains zero; return the time of the last torque [s]."""
    end = steady_time() + LONGEST
    while steady_time() < end:
        pause(0.005)
        last, torque = emulator.log[-1]
        if torque == 0.0 and steady_time() - last > QUIET:
            return last
    raise TimeoutError(f'torque {LONGEST:g} s after the fault')


def table_of(book):
    """Return the table of docs/hardware_bridge.md."""
    bounds = {**{fault.name: fault.bound for fault in FAULTS}, **BOUNDS}
    rows = []
    for fault, bound in bounds.items():
        cells, numbers = [], []
        for control in ('onboard', 'direct'):
            times = book.times.get(f'{control}: {fault}', [])
            numbers += [len(times)] if times else []
            cells.append(f'{1e3 * max(times):.1f} ms ({1e3 * median(times):.1f})' if times
                         else '')
        if numbers:
            rows.append((fault, *cells, min(numbers), bound))
    return table(('fault', 'laws on board: worst (median)', 'direct: worst (median)', 'n',
                  'bound'), rows)


def run(repeats=REPEATS, control=None, only=None, kept=KEPT):
    """Run the missing measurements; return the book."""
    book = Book(kept)
    logging.disable(logging.WARNING)  # drive failures are expected here
    for name in ('onboard', 'direct') if control is None else (control,):
        measure_loop(book, name, repeats, only)
        if only is None or any(only in fault for fault in BOUNDS):
            measure_nodes(book, name, max(1, round(PART_OF_NODES * repeats)), only)
    return book


def measure():
    for name, times in run().times.items():
        yield f'zero after {name}'[:52], 'ms', [1e3 * seconds for seconds in times], None


def main():
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--repeats', type=int, default=REPEATS)
    parser.add_argument('--control', choices=('onboard', 'direct'))
    parser.add_argument('--only', metavar='FAULT', help='part of the name of a fault')
    parser.add_argument('--kept', type=Path, default=KEPT, metavar='FILE',
                        help='what was measured (default: %(default)s)')
    parser.add_argument('--write', action='store_true', help='write the table into the page')
    arguments = parser.parse_args()
    try:
        book = run(arguments.repeats, arguments.control, arguments.only, arguments.kept)
    except KeyboardInterrupt:
        sys.exit('\ninterrupted; the same command goes on from here')
    print(table_of(book))
    if arguments.write:
        show('docs/hardware_bridge.md', 'time to zero', table_of(book))


if __name__ == '__main__':
    main()
