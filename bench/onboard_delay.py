# SPDX-License-Identifier: Apache-2.0
"""
Delay from a measurement to its torque on the link of a drive, in onboard control.

Two variants: the torque in a separate write right after the estimate, as in the bridge, and with
the next request, which would save the write.  The drive is emulated in a separate process; the
loop runs in this one.
"""
from dataclasses import replace
from pathlib import Path
import signal
import subprocess
import sys
import tempfile
import threading
import time

import numpy as np

from ballbot_ros.bridge.drive_line import connector
from ballbot_ros.bridge.feasibility import onboard_lag, RESERVE
from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.bridge.loop import Loop
from ballbot_ros.bridge.session import Session
from ballbot_ros.control import (
    load_tuning, Mode, PendulumController, SetPoint, SupervisedController, Supervision)
from ballbot_ros.errors import MessageError, RefusedError
from ballbot_ros.physics.model.robot import load_robot

SECONDS = 6.0
DRIVES = ('odrive', 'vesc', 'roboclaw')


class Ride:
    """A session on an emulated drive, and the delays of its torques."""

    def __init__(self, hardware, immediately):
        """Start the loop and drive back and forth."""
        robot = load_robot(hardware.robot)
        self.session = Session(
            hardware, robot, connector(hardware),
            law=SupervisedController(PendulumController(robot, load_tuning('gentle')),
                                     Supervision(set_point_timeout=0.5)))
        self.delays = []
        control = self.session.control
        send = control._send_torque

        def note(driver, now, ask):
            estimate = self.session.fusion.estimate
            if self.session.supervisor.commanded and estimate is not None:
                self.delays.append(1e3 * (self.session.clock() - estimate.stamp))
            send(driver, now, ask)
        control._send_torque = note
        if not immediately:
            def wait(now):
                control._pacer = control._pacer.commanded()
            control.follow = wait

    def run(self, seconds):
        """Return the delays of some seconds [ms]."""
        session = self.session
        session.configure()
        session.activate()
        loop = Loop(session, session.hardware.connection.loop_rate, lambda report: None)
        try:
            released, end = False, time.monotonic() + seconds + 5.0
            while not released and time.monotonic() < end:
                time.sleep(0.1)
                try:
                    session.release()
                    released = True
                except RefusedError:
                    pass
            end = time.monotonic() + seconds
            while time.monotonic() < end and loop.running:
                try:
                    session.give(
                        SetPoint(Mode.HOLD, 0.3 if end - time.monotonic() > 3.0 else -0.3))
                except MessageError as error:  # a busy machine: the drive's watchdog was quicker
                    raise SystemExit(
                        f'{error}: {session.supervisor.e_stop}; this machine is too busy')
                time.sleep(0.02)
        finally:
            loop.end()
        return self.delays[20:]


def delays(protocol, immediately):
    """Return delays over an emulated drive [ms]."""
    hardware = load_hardware(f'gimball_{protocol}')
    with tempfile.TemporaryDirectory() as folder:
        link = Path(folder) / 'motor'
        process = subprocess.Popen(
            [sys.executable, '-m', 'ballbot_ros.cli', 'emulate-motor', '--protocol', protocol,
             '--baud', str(hardware.connection.baud), '--link', str(link)],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE)
        try:
            process.stdout.readline()  # the name of the device: it is ready
            threading.Thread(target=process.stdout.read, daemon=True).start()
            hardware = replace(
                hardware, limits=replace(hardware.limits, rearm=True),
                connection=replace(hardware.connection, port=str(link), imu_required=False))
            return Ride(hardware, immediately).run(SECONDS)
        finally:
            process.send_signal(signal.SIGTERM)
            process.wait()


def measure():
    """Yield name, unit, values and target of each measurement."""
    for protocol in DRIVES:
        hardware = load_hardware(f'gimball_{protocol}')
        lag = 1e3 * onboard_lag(hardware, load_robot(hardware.robot))
        for immediately, how in ((True, 'immediately'), (False, 'with the next question')):
            found = delays(protocol, immediately)
            target = lag if immediately else None
            yield f'{protocol}: question to torque, {how}, median', 'ms', [
                np.quantile(found, 0.5)], target
            yield f'{protocol}: the same, p99', 'ms', [np.quantile(found, 0.99)], None
        yield f'{protocol}: on the line, by the budget', 'ms', [lag - 1e3 * RESERVE], None
