# SPDX-License-Identifier: Apache-2.0
"""The end of a node, on the current executor and on that of older rclpy versions."""
import os
import subprocess
import sys

import pytest
from tiers import slow

from ballbot_ros.ros.run import Stop


@pytest.fixture
def python(monkeypatch):
    """Return a function that runs a Python process without the nodes of other processes."""
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'OFF')
    return lambda *words: subprocess.run(
        [sys.executable, *words], capture_output=True, text=True, timeout=60)


NODE = """
import sys
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from ballbot_ros.errors import DriveError
from ballbot_ros.ros import rclpy_compat, run
if sys.argv[1] == 'older':
    rclpy_compat.EventsExecutor = SingleThreadedExecutor

class Failing(Node):
    failure = None

    def __init__(self):
        super().__init__('failing')
        self.create_timer(0.01, self.look)

    def look(self):
        self.failure = DriveError('what went wrong', 'planted', 'drive')

    def make_safe(self):
        print('made safe', flush=True)

sys.exit(run.run(Failing, []))
"""


@pytest.mark.parametrize('executor', ['newest', *slow('older')])
def test_a_node_that_fails_is_made_safe_and_logs_one_line(executor, python):
    done = python('-c', NODE, executor)
    assert done.returncode == 2
    assert done.stdout == 'made safe\n'
    assert done.stderr.count('what went wrong') == 1 and 'FATAL' in done.stderr
    assert 'Traceback' not in done.stderr


HUNG_UP = """
import os, signal, sys
from rclpy.node import Node
from ballbot_ros.ros import run
signal.signal(signal.SIGHUP, getattr(signal, sys.argv[1]))

class HungUp(Node):
    def __init__(self):
        super().__init__('hung_up')
        self.count = 0
        self.create_timer(0.01, self.hang_up)

    def hang_up(self):
        self.count += 1
        if self.count == 1:
            os.kill(os.getpid(), signal.SIGHUP)
        elif self.count == 20:
            print('runs on', flush=True)
            os.kill(os.getpid(), signal.SIGTERM)

    def make_safe(self):
        print('made safe', flush=True)

sys.exit(run.run(HungUp, []))
"""


@pytest.mark.parametrize('before, printed', [
    ('SIG_DFL', 'made safe\n'), ('SIG_IGN', 'runs on\nmade safe\n')])
def test_a_closed_terminal_ends_a_node_safely_unless_hangups_are_ignored(before, printed, python):
    done = python('-c', HUNG_UP, before)
    assert (done.returncode, done.stdout) == (0, printed)


@pytest.mark.slow
def test_a_node_without_kernels_starts_without_the_compiler(python):
    done = python('-c', 'import sys, ballbot_ros.ros.run; print("numba" in sys.modules)')
    assert done.stdout == 'False\n', done.stderr


STUCK = """
import ctypes, sys
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.ros import run
run.END_TIMEOUT = 1.0

class Held:
    def __del__(self):
        ctypes.PyDLL(None).sleep(300)  # holds the GIL, like a destructor of the middleware

def make():
    held = Held()
    raise ConfigurationError('refused', 'missing', '')

sys.exit(run.run(make, []))
"""


@pytest.mark.slow
def test_a_refused_node_ends_even_if_the_middleware_blocks(python):
    done = python('-c', STUCK)
    assert done.returncode == 1 and 'refused' in done.stderr


DEADLOCKED = """
import ctypes, os, signal, sys
from rclpy.node import Node
from ballbot_ros.ros import run
run.END_TIMEOUT = 0.5

class Deadlocked(Node):
    def __init__(self):
        super().__init__('deadlocked')
        self.create_timer(0.01, lambda: os.kill(os.getpid(), signal.SIGINT))

    def make_safe(self):
        print('made safe', flush=True)

    def destroy_node(self):
        ctypes.PyDLL(None).pause()  # holds the GIL

sys.exit(run.run(Deadlocked, []))
"""


@pytest.mark.slow
def test_a_node_ends_after_it_is_safe_even_if_its_destruction_blocks(python):
    done = python('-c', DEADLOCKED)
    assert (done.returncode, done.stdout) == (1, 'made safe\n')


BUSY = """
import os, signal, sys
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import Bool
from ballbot_ros.errors import DriveError
from ballbot_ros.ros import rclpy_compat, run
if sys.argv[1] == 'older':
    rclpy_compat.EventsExecutor = SingleThreadedExecutor

class Busy(Node):
    failure = None

    def __init__(self):
        super().__init__('busy')
        self.count = 0
        self.topic = self.create_publisher(Bool, 'busy', 1)
        self.create_subscription(Bool, 'busy', self.go_on, 1)
        self.topic.publish(Bool())

    def go_on(self, message):
        self.count += 1
        if self.count == 1000 and sys.argv[2] == 'failure':
            self.failure = DriveError('what went wrong', 'planted', 'drive')
        elif self.count == 1000:
            os.kill(os.getpid(), signal.SIGTERM)
        self.topic.publish(message)

    def make_safe(self):
        print('made safe', flush=True)

sys.exit(run.run(Busy, []))
"""


@pytest.mark.slow
@pytest.mark.parametrize('executor', ['newest', 'older'])
@pytest.mark.parametrize('reason, code', [('failure', 2), ('signal', 0)])
def test_a_node_that_is_always_busy_still_ends(
        executor, reason, code, python):
    done = python('-c', BUSY, executor, reason)
    assert (done.returncode, done.stdout) == (code, 'made safe\n'), done.stderr
    assert 'Traceback' not in done.stderr


def test_a_stop_before_the_start_of_the_executor_takes_effect():
    stop, woken = Stop(), []
    stop.give()
    stop.add_done_callback(woken.append)
    assert woken == [stop] and stop.done()


def test_a_stop_does_not_wake_an_executor_that_has_ended():
    stop, woken = Stop(), []
    stop.add_done_callback(woken.append)
    stop.remove_done_callback(woken.append)
    stop.give()
    assert not woken and stop.given


SLOW = """
import os, signal, sys, time
from rclpy.node import Node
from ballbot_ros.ros import run

class Slow(Node):
    def __init__(self):
        super().__init__('slow')
        # Like a node that compiles, in exec() as with numba.
        exec('os.kill(os.getpid(), getattr(signal, sys.argv[1]))\\nwhile True: time.sleep(0.01)')

sys.exit(run.run(Slow, []))
"""


@pytest.mark.slow
@pytest.mark.parametrize('signal', ['SIGINT', 'SIGTERM'])
def test_a_node_under_construction_ends_immediately_on_a_stop(
        signal, python, monkeypatch, tmp_path):
    (tmp_path / 'slow_node.py').write_text(SLOW)
    monkeypatch.setenv('PYTHONPATH', str(tmp_path), prepend=os.pathsep)
    # With -m, as nodes are started: a KeyboardInterrupt from exec() then counts as unhandled.
    done = python('-m', 'slow_node', signal)
    assert (done.returncode, 'Traceback' in done.stderr) == (0, False), done.stderr


TWO = """
import sys
from rclpy.node import Node
from ballbot_ros.errors import DriveError
from ballbot_ros.ros import run

class One(Node):
    def __init__(self):
        super().__init__('one')

    def make_safe(self):
        print('one made safe', flush=True)
        if sys.argv[1] == 'raises':
            raise OSError('what went wrong')

class Other(One):
    failure = None

    def __init__(self):
        Node.__init__(self, 'other')
        if sys.argv[1] == 'refused':
            raise DriveError('what went wrong', 'planted', 'drive')
        self.create_timer(0.01, self.look)

    def look(self):
        self.failure = DriveError('what went wrong', 'planted', 'drive')

    def make_safe(self):
        print('other made safe', flush=True)

sys.exit(run.run_together([One, Other], []))
"""


@pytest.mark.slow
@pytest.mark.parametrize('how, ended', [
    ('fails', 'one made safe\nother made safe\n'), ('refused', 'one made safe\n')])
def test_if_one_of_two_nodes_fails_both_are_made_safe(how, ended, python):
    done = python('-c', TWO, how)
    assert (done.returncode, done.stdout) == (2, ended)
    assert done.stderr.count('what went wrong') == 1 and 'Traceback' not in done.stderr


@pytest.mark.slow
def test_an_exception_of_one_node_at_the_end_does_not_keep_the_other_from_being_made_safe(python):
    done = python('-c', TWO, 'raises')
    assert done.stdout == 'one made safe\nother made safe\n' and done.returncode


SECURE = """
import sys
from rclpy.node import Node
from ballbot_ros.ros import run
sys.exit(run.run(lambda: Node('secure'), []))
"""


@pytest.mark.slow
def test_without_its_keys_a_node_ends_with_a_message(python, monkeypatch, tmp_path):
    for name, value in (('ENABLE', 'true'), ('STRATEGY', 'Enforce'), ('KEYSTORE', tmp_path)):
        monkeypatch.setenv(f'ROS_SECURITY_{name}', str(value))
    done = python('-c', SECURE)
    assert done.returncode == 2 and 'Traceback' not in done.stderr
    assert 'cannot start: ' in done.stderr and 'SECURITY ERROR' in done.stderr.upper()


WITHOUT_CLOCK = """
import os, signal, sys
from rclpy.node import Node
from ballbot_ros.ros import run
from ballbot_ros.ros.endpoints import create_wall_timer
run.CLOCK_TIMEOUT = 0.2

class Robot(Node):
    def __init__(self):
        super().__init__('robot')
        create_wall_timer(self, 0.5, lambda: os.kill(os.getpid(), signal.SIGINT))

sys.exit(run.run(Robot, ['--ros-args', '-p', f'use_sim_time:={sys.argv[1]}']))
"""


@pytest.mark.slow
@pytest.mark.parametrize('simulated', ['true', 'false'])
def test_a_node_with_use_sim_time_and_no_clock_warns(simulated, python):
    done = python('-c', WITHOUT_CLOCK, simulated)
    assert done.returncode == 0
    assert ('no /clock has arrived' in done.stderr) is (simulated == 'true')


@pytest.mark.parametrize('name', ['bridge', 'simulator'])
def test_ctrl_c_during_the_import_of_a_node_is_a_normal_end(name, python):
    program = ('import signal, sys\n'
               'signal.signal(signal.SIGINT, signal.default_int_handler)\n'
               'import ballbot_ros.nodes.start as nodes\n'
               'class Interrupt:\n'
               '    def find_spec(self, name, *_):\n'
               '        if name == "rclpy.node": signal.raise_signal(signal.SIGINT)\n'
               'sys.meta_path.insert(0, Interrupt())\n'
               f'sys.exit(nodes.start({name!r}))\n')
    done = python('-c', program)
    assert (done.returncode, done.stderr) == (0, '')
