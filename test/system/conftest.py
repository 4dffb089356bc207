# SPDX-License-Identifier: Apache-2.0
"""A ROS domain and a graph for each test on real topics."""
from contextlib import contextmanager, ExitStack
import fcntl
from functools import partial
from itertools import count
import multiprocessing
from multiprocessing import forkserver
import os
from pathlib import Path
import tempfile

from driving import Driving, WATCHDOG, write_hardware
from graph import Graph
import pytest

from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.demo import prepare
from ballbot_ros.emulator.ball import settings_for
from ballbot_ros.emulator.emulator import Emulator
from ballbot_ros.physics import load_scene
from ballbot_ros.ros import discovery
from ballbot_ros.ros.run import LATE_KERNEL

# The ports of the preferred ones are outside the ephemeral range of Linux, and the demo uses none
# of them.  The others are for a machine on which many tests run in parallel.
DOMAINS = (*range(215, 232), *range(1, 102))
PREFERRED = 17
_turn = count(os.getpid())


def domains_of_processes():
    """Return the ROS domains in the environments of the processes on this machine."""
    found = set()
    for path in Path('/proc').glob('[0-9]*/environ'):
        try:
            words = path.read_bytes().split(b'\0')
        except OSError:  # the process has ended, or belongs to another user
            continue
        found |= {int(word[14:]) for word in words
                  if word.startswith(b'ROS_DOMAIN_ID=') and word[14:].isdigit()}
    return found


@contextmanager
def own_domain():
    """
    Reserve a ROS domain that no other test uses, in this process or another.

    A locked file marks it: the lock ends with the process that holds it.  The nodes of a killed
    test outlive it, and would publish in the next test on their domain: skip their domains.
    """
    shift = next(_turn) % PREFERRED  # not the domain of the previous test
    taken = domains_of_processes()
    for number in (*DOMAINS[shift:PREFERRED], *DOMAINS[:shift], *DOMAINS[PREFERRED:]):
        if number in taken:
            continue
        path = Path(tempfile.gettempdir()) / f'ballbot_ros_test_domain_{number}.lock'
        try:
            lock = open(path, 'w')
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            continue
        with lock:
            yield number
        return
    pytest.fail('all ROS domains are taken')


@pytest.fixture(scope='session', autouse=True)
def imported_once():
    """Start the server whose copies are the nodes: an import takes 1.5 s of processor time."""
    multiprocessing.set_forkserver_preload(['imported_nodes'])
    with pytest.MonkeyPatch.context() as patch:  # the server has no other path to this folder
        patch.setenv('PYTHONPATH', str(Path(__file__).parent), prepend=os.pathsep)
        forkserver.ensure_running()


@pytest.fixture(scope='session', autouse=True)
def compiled_once():
    """Compile the kernels of the nodes before a test waits for the first node."""
    with open(Path(tempfile.gettempdir()) / 'ballbot_ros_test_compile.lock', 'w') as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        prepare.prepare(prepare.NODES)


@pytest.fixture(autouse=True)
def no_late_compilation(tmp_path):
    """Verify that no node compiled a kernel, or read one from the disk, after it was ready."""
    yield
    late = {path.stem: line for path in tmp_path.rglob('*.log')
            for line in path.read_text(errors='replace').splitlines() if LATE_KERNEL in line}
    assert not late


@pytest.fixture(autouse=True)
def this_machine_only(monkeypatch):
    """Keep all communication on this machine, with fast discovery."""
    for name in discovery.DISCOVERY_VARIABLES:
        monkeypatch.delenv(name, raising=False)
    for name, value in discovery.variables({}).items():
        monkeypatch.setenv(name, value)


@pytest.fixture
def domain():
    """Return a ROS domain that no other test uses."""
    with own_domain() as number:
        yield number


@pytest.fixture
def make_graph(tmp_path):
    """Return a function that makes graphs; all of them end after the test."""
    with ExitStack() as stack:
        def make():
            domain = stack.enter_context(own_domain())
            graph = Graph(tmp_path / f'logs_{domain}', domain)
            stack.callback(graph.close)
            return graph
        yield make


@pytest.fixture
def graph(make_graph):
    """Return a graph that ends after the test."""
    return make_graph()


@pytest.fixture
def emulate(tmp_path):
    """Return a function that starts an emulated drive with a ball, both ended after the test."""
    scene = load_scene('flat')
    with ExitStack() as stack:
        def start(protocol, steering=False, **settings):
            # With a link: a bridge that lost /dev/pts/3 would open the next device of that name.
            return stack.enter_context(Emulator(
                protocol, scene, load_hardware(f'gimball_{protocol}').connection.baud,
                settings_for(scene.model.robot, watchdog=WATCHDOG, **settings),
                link=tmp_path / 'motor', steering=steering))
        yield start


@pytest.fixture
def motor(emulate):
    """Return an emulated ODrive."""
    return emulate('odrive')


@pytest.fixture
def hardware(tmp_path):
    """Return a function that writes a hardware file; level floors need no IMU."""
    return partial(write_hardware, tmp_path / 'hardware.yaml', imu_required=False)


@pytest.fixture
def driving(graph, motor, hardware):
    """Return a function that starts a driving bridge in a separate process."""
    def start(**more):
        graph.start('bridge', hardware=hardware(), port=motor.path, control='direct', **more)
        result = Driving(graph, motor)
        result.release()
        result.pull()
        return result
    return start
