# SPDX-License-Identifier: Apache-2.0
"""
Time the bridge: the loop of the shipped hardware file over an emulated ODrive at 921600 baud.

The variants are onboard control (`set_point` at 50 Hz), commands over topics (`control:=direct`),
and an IMU at 200 Hz.  Each command has a different torque, so the log of the emulated drive shows
when it takes effect.  The latency of the bridge from a measurement to its torque comes from a
capture of its link, in a separate run.
"""
from bisect import bisect
from contextlib import contextmanager
import math
from pathlib import Path
import signal
from statistics import median
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test' / 'helpers'))
from builtin_interfaces.msg import Time
from loop import processor_time
import numpy as np
from rclpy.node import Node
from replay import read_capture
from round_trip import joined
from std_srvs.srv import Trigger
import yaml

from ballbot_ros.clock import steady_time
from ballbot_ros.config.files import read_yaml, shipped_folder
from ballbot_ros.demo.processes import NodeProcesses, own_domain
from ballbot_ros.emulator.emulator import Emulator
from ballbot_ros.physics import load_scene
from ballbot_ros.ros.conversions import set_point_message
from ballbot_ros.ros.endpoints import create_publisher, create_subscription
from ballbot_ros.ros.message_bytes import command_bytes

START = 60.0  # timeout for the start or end of an emulator [s]
SETTLE, WINDOW = 2.0, 8.0  # wall time before and during the measurement [s]
REPEATS = 3
GEAR = 50.0 * 0.9  # torque at the pendulum per torque at the shaft
# Number of different torques, more than are in transit at a time.
DIFFERENT = 400
SET_POINT_PERIOD = 0.02  # [s]
LEAN = 0.3  # amplitude of the set angle in onboard control [rad]


class Bench:
    """A bridge in a separate process; emulated drive and commands in this process."""

    def __init__(self, emulator, nodes, node, executor, control):
        self._control, self._next = control, 0.0
        self.emulator, self.nodes, self.node, self.executor = emulator, nodes, node, executor
        self.sent = {}  # number of the torque -> time of publication [s]
        self.arrivals = []
        self._number = 0
        self._commands = create_publisher(node, 'joint_commands')
        self._set_points = create_publisher(node, 'set_point')
        create_subscription(node, 'joint_states', self._answer)
        self.status = None
        create_subscription(node, 'motor_status', self._note)
        self._release = node.create_client(Trigger, 'bridge/release_e_stop')
        self.pushing = False

    def _note(self, message):
        self.status = message

    def _answer(self, message):
        """Answer a joint state with a torque that differs from the previous ones."""
        self.arrivals.append(steady_time())
        if self._control == 'onboard':
            return
        self._number = (self._number + 1) % DIFFERENT
        # The sign alternates, so that the ball stays; no value repeats.
        size = 0.05 + 0.0005 * self._number
        torque = size if self._number % 2 else -size
        self.sent.setdefault(self._number, []).append(steady_time())
        self._commands.publish(command_bytes(
            message.header.stamp, torque if self.pushing else 0.0))

    def spin(self, seconds):
        """Execute callbacks for a time [s], with set-points in onboard control."""
        end = steady_time() + seconds
        while steady_time() < end:
            if self._control == 'onboard' and self.pushing and steady_time() >= self._next:
                self._next = steady_time() + SET_POINT_PERIOD
                # Stamped by the bridge; angle and torque change continuously.
                self._set_points.publish(set_point_message(
                    Time(), LEAN * math.sin(3.0 * steady_time())))
            self.executor.spin_once(timeout_sec=0.5 * SET_POINT_PERIOD)

    def release(self, timeout=20.0):
        """Release the e-stop; retry until `timeout` [s]."""
        self.pushing = False
        deadline, why = steady_time() + timeout, 'there was no answer'
        while steady_time() < deadline:
            self.spin(0.3)
            if self._release.service_is_ready():
                answer = self._release.call_async(Trigger.Request())
                while not answer.done() and steady_time() < deadline:
                    self.executor.spin_once(timeout_sec=0.05)
                if answer.done():
                    why = answer.result().message
                    if answer.result().success:
                        self.pushing = True
                        return
        raise TimeoutError(f'the e-stop was not released: {why}')

    @property
    def process(self):
        """Return the process id of the bridge."""
        return self.nodes._running['bridge'].pid


def emulated_here(folder):
    """Return an emulated drive for this process."""
    return Emulator('odrive', load_scene('flat'), 921600, link=folder / 'motor')


@contextmanager
def emulated_apart(folder):
    """Run an emulated drive in a separate process, which writes its log at the end."""
    process = subprocess.Popen(
        [sys.executable, '-m', 'ballbot_ros.cli', 'emulate-motor', '--protocol', 'odrive',
         '--baud', '921600', '--link', str(folder / 'motor'), '--log', str(folder / 'log.csv')],
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE)
    try:
        process.stdout.readline()  # the name of the device, printed when ready
        yield None
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(START)
        except subprocess.TimeoutExpired:
            process.kill()
            raise


@contextmanager
def emulated_robot(folder):
    """Run an emulated drive and IMU in a separate process."""
    with NodeProcesses(folder / 'robot', own_domain()) as nodes:
        nodes.start('emulated_robot', {
            'link': folder / 'motor', 'scene': 'flat', 'imu_rate': 200.0})
        deadline = steady_time() + START
        while not (folder / 'motor').exists():
            if steady_time() > deadline:
                raise TimeoutError(f'the emulated robot has not started within {START:g} s')
            time.sleep(0.05)
        yield None


@contextmanager
def running(folder, emulated=emulated_here, control='direct', rearm=True, **parameters):
    """Yield a `Bench` with a running bridge, whose files are in `folder`."""
    domain = own_domain()
    content = read_yaml(shipped_folder('config') / 'hardware/gimball_odrive.yaml')
    content['connection'].update(
        imu_required=emulated is emulated_robot, port=str(folder / 'motor'))
    content['limits'].update(rearm=rearm, torque_rate_limit=1e6)
    (folder / 'hardware.yaml').write_text(yaml.safe_dump(content))
    sys.setswitchinterval(5e-4)
    with joined(domain, lambda: Node('bench')) as (executor, node), \
            emulated(folder) as emulator, NodeProcesses(folder, domain) as nodes:
        bench = Bench(emulator, nodes, node, executor, control)
        nodes.start('bridge', {
            'hardware': folder / 'hardware.yaml', 'control': control,
            'black_box': folder / 'black_box', **parameters})
        bench.release()
        yield bench


def applied(path, begin, end):
    """Return times [s] and torques at the pendulum [N m] of a log between two instants."""
    rows = [tuple(map(float, line.split(','))) for line in path.read_text().splitlines()[1:]]
    return [(when, torque * GEAR) for when, torque in rows if begin <= when <= end]


def latencies(sent, log):
    """Return the time from the publication of each torque to its effect in the drive [s]."""
    found = []
    for when, torque in log:
        times = sent.get(round((abs(torque) - 0.05) / 0.0005), [])
        before = bisect(times, when)
        if before and when - times[before - 1] < 0.1:
            found.append(when - times[before - 1])
    return found


def answers(path):
    """Return the time from each measurement to its torque [s]."""
    found, read = [], None
    for record in read_capture(path):
        if record.direction == '<':
            read = record.time if read is None else read
        elif record.data.startswith(b'c ') and read is not None:
            found.append(record.time - read)
            read = None
        elif record.data.startswith(b'f '):
            read = None
    return found


def run(emulated, control, **parameters):
    """
    Run a bridge; return its processor time [% of a core], the log of the drive, and the torques.

    The log is a result of `applied`, empty without a file; the sent torques have their times [s].
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with running(folder, emulated, control, **parameters) as bench:
            bench.spin(SETTLE)
            before, begin = processor_time(bench.process), steady_time()
            bench.spin(WINDOW)
            end = steady_time()
            share = 100.0 * (processor_time(bench.process) - before) / (end - begin)
        log = folder / 'log.csv'
        return share, applied(log, begin, end) if log.exists() else [], bench.sent


def measure():
    for variant, control, target in (('laws on board', 'onboard', 12.0),
                                     ('commands over topics', 'direct', 20.0)):
        middle, late, used, way = [], [], [], []
        for _ in range(REPEATS):
            share, log, sent = run(emulated_apart, control)
            times = [when for when, _ in log]
            periods = [1e3 * (after - before) for before, after in zip(times, times[1:])]
            middle.append(np.quantile(periods, 0.5))
            late.append(np.quantile(periods, 0.99))
            used.append(share)
            way += [1e3 * median(latencies(sent, log))] if control == 'direct' else []
        yield f'bridge, {variant}: part of a core', '%', used, target
        yield f'bridge, {variant}: period of torques, median', 'ms', middle, None
        yield f'bridge, {variant}: period of torques, p99', 'ms', late, 7.5
    yield 'bridge: command published to torque in the drive', 'ms', way, 1.0
    yield ('bridge, laws on board and an IMU: part of a core', '%',
           [run(emulated_robot, 'onboard')[0] for _ in range(REPEATS)], 12.0)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with running(folder, emulated_apart, 'onboard', capture=folder / 'capture') as bench:
            bench.spin(SETTLE + WINDOW)
        ways = [1e3 * way for way in answers(folder / 'capture')]
    yield 'bridge: measurement read to its torque written', 'ms', [median(ways)], 0.5
    yield 'bridge: the same, p99', 'ms', [np.quantile(ways, 0.99)], None
