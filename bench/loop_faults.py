# SPDX-License-Identifier: Apache-2.0
"""
Run the bridge loop for ten minutes with an emulated drive and continual faults.

    make bench ARGS='--only loop_faults'      # not part of a plain `make bench`
"""
from array import array
from dataclasses import replace
import math
from pathlib import Path
import random
import tempfile
import time

import numpy as np
from wire import used

from ballbot_ros.bridge.drive_line import connector
from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.bridge.loop import Loop
from ballbot_ros.bridge.motor_state import MotorState
from ballbot_ros.bridge.session import Session
from ballbot_ros.clock import steady_time
from ballbot_ros.emulator.ball import settings_for
from ballbot_ros.emulator.control import execute, LINE_FAULTS
from ballbot_ros.emulator.emulator import Emulator
from ballbot_ros.errors import MessageError, RefusedError
from ballbot_ros.physics.simulation.scene import load_scene

DURATION = 600.0  # [s]
PAUSE = (1.0, 6.0)  # between two events [s]
BAD_LINE = 0.5  # duration of a bad link [s]
EVENTS = ('unplug 0.3', 'reboot', 'silence 0.4', 'corrupt 0.002', 'drop 0.002', 'duplicate 0.002',
          'garbage 3000 from', 'delay 0.005', 'encoder_jump 0.1', 'corrupt 0.05', 'drop 0.05')


class Watcher:
    """Command a slow oscillation and record the results."""

    def __init__(self):
        # Compact and preallocated, so that memory growth comes from the measured code.
        self.periods, self.gaps = array('f', bytes(4 * 600_000)), []
        self.count = 0
        self.before = self.on_until = None
        self.session = None

    def take(self, report):
        """Answer a report with a command."""
        if self.before is not None:
            self.periods[self.count] = 1e3 * (report.time - self.before)
            self.count += 1
        self.before = report.time
        if report.state is MotorState.ARMED:
            if self.on_until is not None and report.time - self.on_until > 0.1:
                self.gaps.append(report.time - self.on_until)
            self.on_until = report.time
        if report.estimate is not None:
            # Zero while the e-stop is engaged: it is not released under other commands.
            torque = 0.0 if report.e_stop else 0.3 * math.sin(report.time)
            try:
                self.session.command(torque, report.time)
            except MessageError:
                pass  # counted by the supervisor


def measure():
    hardware = load_hardware('gimball_odrive')
    scene = load_scene('flat')
    limit = hardware.options().torque_limit
    settings = settings_for(scene.model.robot, torque_limit=limit)
    link = Path(tempfile.mkdtemp()) / 'ttyBall'
    hardware = replace(
        hardware, limits=replace(hardware.limits, rearm=True),
        connection=replace(hardware.connection, imu_required=False, port=str(link)))
    emulator = Emulator('odrive', scene, hardware.connection.baud, settings, link=link)
    rng, watcher = random.Random(3), Watcher()
    events = refused = above = 0
    with emulator:
        session = Session(hardware, scene.model.robot, connector(hardware))
        watcher.session = session
        session.configure()
        session.activate()
        loop = Loop(session, hardware.connection.loop_rate, watcher.take)
        begin, processor = steady_time(), time.process_time()
        first = None
        while steady_time() - begin < DURATION and loop.running:
            time.sleep(rng.uniform(*PAUSE))
            refused += bool(session.supervisor.e_stop)
            try:
                session.release()
            except RefusedError:
                pass
            event = rng.choice(EVENTS)
            execute(emulator, event)
            if event.split()[0] in LINE_FAULTS:
                time.sleep(BAD_LINE)
                execute(emulator, 'clear')
            events += 1
            while emulator.log:
                above += abs(emulator.log.popleft()[1]) > 1.001 * limit
            if first is None and steady_time() - begin > 0.1 * DURATION:
                first = used()
        wall = steady_time() - begin
        processor = 100.0 * (time.process_time() - processor) / wall
        last = used()
        execute(emulator, 'clear')
        loop.end()
        time.sleep(0.2)
    yield 'length of the run', 's', [wall], -DURATION
    yield 'things that happened', '', [events], None
    yield 'of these, met with the e-stop engaged', '', [refused], None
    yield 'torques above the limit', '', [above], 0.5
    yield 'torque after the end', 'N m', [abs(emulator.torque)], 1e-9
    yield 'times that power came back', '', [len(watcher.gaps)], None
    yield 'until power came back, median', 'ms', [1e3 * np.quantile(watcher.gaps, 0.5)], 1000.0
    yield 'until power came back, longest', 'ms', [1e3 * max(watcher.gaps)], None
    yield ('period of the loop, p99', 'ms', [np.quantile(watcher.periods[:watcher.count], 0.99)],
           4.0)
    yield 'loop, ball and emulated drive, part of a core', '%', [processor], None
    for name, unit, before, after in zip(
            ('resident memory', 'threads', 'open files'), ('kB', '', ''), first, last):
        yield f'more {name} after the first minute', unit, [after - before], None
