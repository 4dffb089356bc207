# SPDX-License-Identifier: Apache-2.0
"""
Time the bridge: a loop of 500 Hz over an emulated ODrive at 921600 baud.

The torque that the emulated drive makes is the witness: each command asks for another one, so
each is found again in the log of the drive, with the time at which it came into force there.
"""
from contextlib import contextmanager
import math
from pathlib import Path
from statistics import median
import sys
import tempfile
import time

from loop import processor_time, quantile
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
import yaml

from ballbot_ros.demo.processes import NodeProcesses, own_domain
from ballbot_ros.emulator.emulator import Emulator
from ballbot_ros.paths import config_folder
from ballbot_ros.physics import load_scene
from ballbot_ros.ros import qos
from ballbot_ros.ros.conversions import command_message
from ballbot_ros.ros.endpoints import advertise, listen

SETTLE, WINDOW = 2.0, 8.0  # wall time before and of the measurement [s]
REPEATS = 3
GEAR = 50.0 * 0.9  # torque at the pendulum per torque at the shaft
# Torques repeat after so many commands, which is longer than any of them is under way.
DIFFERENT = 400


class Bench:
    """
    A bridge in a process of its own, an emulated drive here, and commands from here.

    Parameters
    ----------
    emulator : Emulator
    nodes : NodeProcesses
    node : Node
    executor : Executor

    """

    def __init__(self, emulator, nodes, node, executor):
        """Answer joint states."""
        self.emulator, self.nodes, self.node, self.executor = emulator, nodes, node, executor
        self.sent = {}  # number of the torque -> when it was published last [s]
        self.arrivals = []
        self._number = 0
        self._commands = advertise(node, JointState, 'joint_commands', qos.NEWEST)
        listen(node, JointState, 'joint_states', self._answer, qos.NEWEST)
        self._release = node.create_client(Trigger, 'bridge/release_e_stop')
        self.pushing = False

    def _answer(self, message):
        """Answer a joint state with a torque unlike the ones before."""
        self.arrivals.append(time.monotonic())
        self._number = (self._number + 1) % DIFFERENT
        # Both directions in turn, so that the ball stays; no two alike.
        size = 0.05 + 0.0005 * self._number
        torque = size if self._number % 2 else -size
        self.sent[self._number] = time.monotonic()
        self._commands.publish(command_message(
            message.header.stamp, torque if self.pushing else 0.0))

    def spin(self, seconds):
        """Let time pass."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.05)

    def release(self, patience=20.0):
        """Release the e-stop."""
        self.pushing = False
        deadline = time.monotonic() + patience
        while time.monotonic() < deadline:
            self.spin(0.3)
            if self._release.service_is_ready():
                answer = self._release.call_async(Trigger.Request())
                while not answer.done() and time.monotonic() < deadline:
                    self.executor.spin_once(timeout_sec=0.05)
                if answer.done() and answer.result().success:
                    self.pushing = True
                    return
        raise TimeoutError('the e-stop was not released')

    @property
    def process(self):
        """Return the process id of the bridge."""
        return self.nodes.process_id('bridge')


@contextmanager
def running():
    """Give a `Bench` with a bridge under way."""
    domain = own_domain()
    content = yaml.safe_load((config_folder() / 'hardware/gimball_odrive.yaml').read_text())
    content['connection']['imu_required'] = False
    content['limits'].update(rearm=True, torque_rate_limit=1e6)
    sys.setswitchinterval(5e-4)
    rclpy.init(domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
    node, executor = Node('bench'), SingleThreadedExecutor()
    executor.add_node(node)
    try:
        with tempfile.TemporaryDirectory() as folder, \
                Emulator('odrive', load_scene('flat'), 921600,
                         link=Path(folder) / 'motor') as emulator, \
                NodeProcesses(Path(folder), domain) as nodes:
            path = Path(folder) / 'hardware.yaml'
            path.write_text(yaml.safe_dump(content))
            bench = Bench(emulator, nodes, node, executor)
            nodes.start('bridge', {'hardware': path, 'port': emulator.path})
            bench.release()
            yield bench
    finally:
        executor.remove_node(node)
        node.destroy_node()
        rclpy.try_shutdown()


def latencies(bench, log):
    """Return the time from publishing each torque to the drive making it [s]."""
    found = []
    for applied in log:
        number = round((abs(applied.torque) * GEAR - 0.05) / 0.0005)
        sent = bench.sent.get(number, math.nan)
        if 0.0 <= applied.time - sent < 0.1:
            found.append(applied.time - sent)
    return found


def measure():
    """Yield name, unit, values and target of each measurement."""
    middle, late, used, wire = [], [], [], []
    for _ in range(REPEATS):
        with running() as bench:
            bench.spin(SETTLE)
            bench.emulator.call(bench.emulator.log.clear)
            before, begin = processor_time(bench.process), time.monotonic()
            ways = []
            # Before a torque is used again: see DIFFERENT.
            while time.monotonic() < begin + WINDOW:
                seen = len(bench.emulator.log)
                bench.spin(0.2)
                ways += latencies(bench, list(bench.emulator.log)[seen:])
            used.append(100.0 * (processor_time(bench.process) - before)
                        / (time.monotonic() - begin))
            times = [applied.time for applied in bench.emulator.log]
        periods = [1e3 * (after - before) for before, after in zip(times, times[1:])]
        middle.append(quantile(periods, 0.5))
        late.append(quantile(periods, 0.99))
        wire.append(1e3 * median(ways))
    yield 'bridge: period of torques in the drive at 500 Hz, median', 'ms', middle, None
    yield 'bridge: period of torques in the drive at 500 Hz, p99', 'ms', late, 4.0
    yield 'bridge: part of a core', '%', used, 25.0
    yield 'bridge: command published to torque in the drive', 'ms', wire, 1.0
