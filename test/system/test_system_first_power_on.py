# SPDX-License-Identifier: Apache-2.0
"""docs/first_power_on.md, executed with emulated drives in their factory settings."""
from pathlib import Path
import re
import shlex
import signal
import threading
import time

from driving import WATCHDOG
import pytest
from refusals import refused
from sensor_msgs.msg import Imu, JointState
from std_srvs.srv import Trigger
from waiting import TIMEOUT, wait_until
from workshop import EXTRA, FRESH, Workshop
import yaml

from ballbot_ros.bridge.commissioning import calibration
from ballbot_ros.bridge.drive_line import connector, handshake
from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.drives.odrive import emulated_board
from ballbot_ros.emulator.control import execute
from ballbot_ros.msg import MotorStatus
from ballbot_ros.nodes.bridge.motor import imu_message
from ballbot_ros.ros.conversions import to_time

PAGE = Path(__file__).resolve().parents[2] / 'docs/first_power_on.md'

# The hand waits until the bridge has reported each turn: a rotation while the machine delays the
# bridge is detected as a jump of the encoder [rad].
INCREMENTS = [0.05 * bit for bit in range(1, 11)]


def items():
    """Return the list of the page, each item as one line."""
    text = PAGE.read_text(encoding='utf-8').split('## Checklist')[1].split('\n## ')[0]
    return [' '.join(item.replace('\\\n', ' ').split()) for item in text.split('- [ ] ')[1:]]


@pytest.fixture
def workshop(tmp_path, capsys, monkeypatch):
    """Return a function that makes a `Workshop`; its drive is unplugged after the test."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(emulated_board, 'CALIBRATION_TIME', 0.1)
    made = []

    def make(kind):
        made.append(Workshop(kind, tmp_path, capsys))
        made[0].motor.start()
        return made[0]
    yield make
    for shop in made:
        shop.motor.stop()


@pytest.mark.parametrize('kind', FRESH)
def test_factory_settings_are_refused_until_all_remedies_of_the_doctor_are_applied(kind, workshop):
    shop = workshop(kind)
    shop.copy_file(torque_limit=0.3)
    connect = connector(load_hardware('my.yaml'))
    with refused('inconsistent'):
        handshake(connect, 1.0)
    assert shop.obey_doctor('ballbot doctor --hardware my.yaml') >= 1
    driver, _, settings = handshake(connect, 1.0)
    driver.line.close()
    assert all(item.acceptable for item in settings)


class Walk:
    """The items of the page, each as a method."""

    def __init__(self, shop, graph, monkeypatch):
        self.shop, self.graph, self.monkeypatch = shop, graph, monkeypatch
        self.motor, self.ball = shop.motor, shop.ball
        self.states = graph.subscribe('joint_states', JointState)
        self.status = graph.subscribe('motor_status', MotorStatus)
        self._imu = graph.node.create_publisher(Imu, 'imu', 10)
        self._ending = threading.Event()
        self._publishing = threading.Thread(target=self._publish_imu)
        self._publishing.start()

    def close(self):
        """Stop the IMU."""
        self._ending.set()
        self._publishing.join()

    def _publish_imu(self):
        while not self._ending.wait(0.01):
            sample = self.ball.imu()
            self._imu.publish(imu_message(
                sample.time, (0.0, -sample.turn_rate, 0.0), (sample.forward, 0.0, sample.upward)))

    # The items, in the order of the page

    def copy_and_doctor(self, item):
        """Copy the file, and apply the remedies of the doctor to the drive."""
        limit = float(re.search(r'`torque_limit: ([0-9.]+)`', item).group(1))
        self.shop.copy_file(torque_limit=limit)
        assert self.shop.obey_doctor(command(item, 'ballbot doctor')) >= 1

    def calibrate(self, item):
        """Calibrate, as the prompts request."""
        for name in ('RAISE', 'SETTLE', 'LOOK'):
            self.monkeypatch.setattr(calibration, name, 0.4 * getattr(calibration, name))
        self.monkeypatch.setattr(calibration, 'STEPS', 2)
        # Drive and calibration are threads of one process, which a busy machine may delay.
        self.monkeypatch.setattr(calibration, 'MEASUREMENT_AGE_MAX', 1.0)
        self.monkeypatch.setattr('builtins.input', self._answer)
        code, out = self.shop.run(command(item, 'ballbot calibrate-motor'))
        assert code == 0, out + self.shop.complaint
        joint = load_hardware('my_motor.yaml').joint
        assert joint.direction == 1 and joint.torque_factor == pytest.approx(EXTRA, rel=0.05)
        # The drive needs no further changes of its settings.
        assert self.shop.obey_doctor('ballbot doctor --hardware my_motor.yaml') == 0

    def _answer(self, question):
        if 'Turn it by hand forward' in question:
            self.turn(pendulum=1.5708)
        elif 'hang' in question:
            self.ball.pendulum = None
            wait_until(lambda: self.ball.at_rest)
        return 'yes' if 'Ready' in question else ''

    def start(self, item):
        """Start the bridge, and turn the pendulum forward by hand."""
        self.run_bridge(item)
        self.graph.wait(lambda: self.states, 'joint states flow')
        self.turn_and_verify('pendulum', 1.0, 0.02)

    def turn_shell(self, item):
        """Turn the shell forward by hand, and back."""
        self.turn_and_verify('shell', -1.0, 0.1)  # clockwise is forward

    def unplug(self, item):
        """Unplug and plug in again."""
        self.status.clear()
        execute(self.motor, 'unplug')
        lost, then = re.search(r'shows `(\w+)`, then `(\w+)`', item).groups()
        self.wait_for_state(lost)
        execute(self.motor, 'plug')
        self.wait_for_state(then)
        # The bridge must write its black box before it is killed below.
        self.graph.wait_for_log('bridge', 'see them with: ballbot replay')

    def push(self, item):
        """Release the e-stop and publish the torque of the page, then stop."""
        self.topic = command(item, 'ros2 topic pub')
        last = self.publish_until_torque()
        self.graph.wait(lambda: self.motor.torque == 0.0, 'the motor torque is zero')
        after = self.motor.log[-1][0] - last
        assert after < load_hardware('my_motor.yaml').limits.command_timeout + WATCHDOG

    def kill(self, item):
        """Kill the bridge under torque."""
        assert '`kill -9`' in item
        self.publish_until_torque()
        killed = time.monotonic()
        self.graph.kill('bridge')
        self.graph.wait(lambda: self.motor.torque == 0.0, 'the motor torque is zero')
        assert self.motor.log[-1][0] - killed < 2.0 * WATCHDOG
        assert not self.motor.device.armed

    def engage(self, item):
        """Engage the e-stop under torque."""
        self.run_bridge(self.bridge)
        self.publish_until_torque()
        words = shlex.split(command(item, 'ros2 service call'))
        assert words[4].strip('.') == 'std_srvs/srv/Trigger'
        assert self.graph.call(words[3].lstrip('/'), Trigger).success
        self.graph.wait(lambda: self.motor.torque == 0.0, 'the motor torque is zero')
        self.wait_for_state(MotorStatus.STATE_E_STOP)
        assert self.graph.end('bridge', signal.SIGINT) == 0

    # Parts of several items

    def run_bridge(self, item):
        """Start the bridge with the parameters of the command of the page."""
        self.bridge = item
        words = shlex.split(command(item, 'ros2 run'))
        assert words[:4] == ['ros2', 'run', 'ballbot_ros', 'bridge']
        self.states.clear()
        self.status.clear()
        self.graph.start('bridge', **dict(
            word.split(':=') for flag, word in zip(words, words[1:]) if flag == '-p'))

    def turn(self, pendulum=None, shell=None):
        """Turn pendulum or shell by hand, and wait until it has arrived."""
        if pendulum is not None:
            self.ball.pendulum = pendulum
        if shell is not None:
            self.ball.shell = shell
        wait_until(lambda: self.ball.done)

    def turn_and_verify(self, name, sign, tolerance):
        """
        Turn pendulum or shell in increments, and back, until the bridge has reported them.

        While the machine delays the bridge, it misses rotation: gravity corrects for lost IMU
        readings only within minutes, and a drive that reconnects with a small angle looks like
        one that was off and counts again from 0.
        """
        joint = ('shell', 'pendulum').index(name)
        for _ in range(5):
            self.graph.wait(lambda: self.ball.at_rest, 'rest')
            self.states.clear()
            self.graph.wait(lambda: self.states, 'joint states flow')
            begin, reported = self.states[-1].position[joint], True
            for angle in (sign * bit for bit in INCREMENTS):
                self.turn(**{name: angle})
                reported = reported and self.reports(joint, begin + angle, tolerance)
            if name == 'shell':
                self.turn(shell=0.0)
            else:
                self.ball.pendulum = None
            if reported and self.reports(joint, begin, max(tolerance, 0.05)):
                return
        raise AssertionError(f'the bridge never reports the rotation of the {name}')

    def reports(self, joint, angle, tolerance):
        """Return whether the bridge reports the angle of a joint within 10 s."""
        end = time.monotonic() + 10.0
        while abs(self.states[-1].position[joint] - angle) >= tolerance:
            if time.monotonic() > end:
                return False
            self.graph.spin(0.05)
        return True

    def wait_for_state(self, state):
        """Wait until the bridge reports a state."""
        self.graph.wait(lambda: state in [status.state for status in self.status],
                        f'motor_status says {state}')

    def publish_until_torque(self):
        """Publish the command of the page until the motor applies it; return the time [s]."""
        content = yaml.safe_load(shlex.split(self.topic)[-1])
        assert content['header'] == {'stamp': 'now'}
        rate = float(re.search(r'-r (\d+)', self.topic).group(1))
        joint = load_hardware('my_motor.yaml').joint
        wanted = abs(joint.motor_torque(content['effort'][0]))
        publisher = self.graph.publisher(shlex.split(self.topic)[5], JointState)
        for _ in range(5):  # on a busy machine the e-stop may engage again
            self.graph.wait(lambda: self.status, 'the bridge reports its state')
            end = time.monotonic() + TIMEOUT
            while not (answer := self.graph.call('bridge/release_e_stop', Trigger)).success:
                assert time.monotonic() < end, answer.message
            end = time.monotonic() + 3.0
            while time.monotonic() < end:
                message = JointState(name=content['name'], effort=content['effort'])
                message.header.stamp = to_time(time.time())
                publisher.publish(message)
                self.graph.spin(1.0 / rate)
                if abs(abs(self.motor.torque) - wanted) < 1e-5:
                    return time.monotonic()
        raise AssertionError(f'the motor never applied {wanted:g} N m: {self.status[-1]}')


# A phrase of each item of the page, and its method.
STEPS = (
    ('Copy the hardware file to `my.yaml`', Walk.copy_and_doctor),
    ('`ballbot calibrate-motor', Walk.calibrate),
    ('Turn the pendulum by hand forward', Walk.start),
    ('Turn the shell by hand forward', Walk.turn_shell),
    ('Unplug the serial line', Walk.unplug),
    ('Release the e-stop, publish a small torque', Walk.push),
    ('`kill -9`', Walk.kill),
    ('engage the e-stop under torque', Walk.engage))


def command(item, begin):
    """Return the command of an item that starts with `begin`."""
    found = re.search(rf'`({begin}[^`]*)`|({begin}.*"[^"]*")', item)
    assert found, f'no command {begin!r} in: {item}'
    return found.group(1) or found.group(2)


def test_the_page_lists_the_items_of_this_file():
    assert [phrase for item in items() for phrase, _ in STEPS if phrase in item] == [
        phrase for phrase, _ in STEPS]
    assert len(items()) == len(STEPS), 'an item of the page is not tested'


def test_the_items_of_the_page_succeed_in_their_order(workshop, graph, monkeypatch):
    walk = Walk(workshop('odrive'), graph, monkeypatch)
    try:
        for item, (_, step) in zip(items(), STEPS):
            step(walk, item)
    finally:
        walk.close()
    # The interruption of the line was a fault, and is reported.
    code, out = walk.shop.run(f'ballbot replay {graph.processes.log("bridge").parent / "ballbot"}')
    assert code == 0 and 'the line was lost' in out
