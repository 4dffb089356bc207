# SPDX-License-Identifier: Apache-2.0
"""A driver on a real serial device, an emulated drive, and the ball that it actuates."""
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import time

import pytest
from refusals import refused
from waiting import wait_until

from ballbot_ros.clock import steady_time
from ballbot_ros.drives import (
    DRIVES, line_of, open_driver, open_line, read_options, SERIAL)
from ballbot_ros.drives.can_frames import RECORD_SIZE
from ballbot_ros.drives.transport import Link
from ballbot_ros.emulator.ball import settings_for
from ballbot_ros.emulator.control import answer, Channel, execute, FAULTS, LINE_FAULTS
from ballbot_ros.emulator.emulator import Emulator
from ballbot_ros.errors import ConfigurationError, DriveError, LinkError
from ballbot_ros.physics.simulation.scene import load_scene

BAUD, OTHER = 460800, 57600
BIT_RATE, OTHER_BIT_RATE = 1000000, 250000  # of a CAN bus
TORQUE, TORQUE_LIMIT = 0.02, 0.1
WATCHDOG = 0.5  # of the drive: a busy machine may delay a test that long [s]
REPLY_TIMEOUT = 10.0  # includes the wait of the drive for the processor [s]


@pytest.fixture(scope='module')
def scene():
    """Return a ball at rest on a floor."""
    return load_scene('flat')


def rates(protocol):
    """Return the rate of an emulator and another rate, as its kind of line uses them."""
    return (BAUD, OTHER) if line_of(protocol) is SERIAL else (BIT_RATE, OTHER_BIT_RATE)


def made(protocol, scene, **options):
    """Return an emulator that is not yet started."""
    settings = settings_for(scene.model.robot, watchdog=WATCHDOG)
    return Emulator(protocol, scene, rates(protocol)[0], settings, **options)


@pytest.fixture
def emulator(scene, tmp_path):
    """Yield a running ODrive with a permanent link."""
    with made('odrive', scene, link=tmp_path / 'ttyBall') as running:
        yield running


def connect(path, protocol='odrive', device=None):
    """Return an open link and a driver after its handshake."""
    link = open_line(protocol, path, rates(protocol)[0])
    # Values that an ODrive does not report over CAN, as read with odrivetool.
    confirmed = {'firmware': '0.5.6', 'confirmed': dict(device.properties)} \
        if protocol == 'odrive_can' else {}
    driver = open_driver(protocol, link, read_options(
        protocol, {'torque_limit': TORQUE_LIMIT, 'watchdog': WATCHDOG, **confirmed}, 'test'))
    driver.identity = driver.identify(REPLY_TIMEOUT)
    return link, driver


def drive(driver, seconds, torque=TORQUE):
    """Run a loop of 100 Hz and return the last telemetry."""
    end = steady_time() + seconds
    while steady_time() < end:
        driver.poll()
        driver.send_torque(torque)
        time.sleep(0.01)
    return driver.poll()


@pytest.mark.slow
@pytest.mark.parametrize('protocol', sorted(DRIVES))
def test_a_torque_over_the_line_swings_the_pendulum_and_rolls_the_ball(scene, protocol):
    with made(protocol, scene) as emulator:
        link, driver = connect(emulator.path, protocol, emulator.device)
        with link:
            assert all(setting.acceptable for setting in driver.read_settings(REPLY_TIMEOUT))
            driver.arm(REPLY_TIMEOUT)
            telemetry = drive(driver, 0.4)
            # A voltage is correct for the measured speed, not for the present one.
            near = 1e-3 if driver.closes_torque_loop else 0.4
            assert emulator.torque == pytest.approx(TORQUE, rel=near)
            driver.stop()
            assert emulator.torque == 0.0
        assert emulator.state.x > 0.001
        assert telemetry.position > 0.1 and telemetry.velocity > 0.0
        assert max(torque for _, torque in emulator.log) == pytest.approx(TORQUE, rel=near)
        assert emulator.log[-1][1] == 0.0


@pytest.mark.parametrize('protocol', sorted(DRIVES))
def test_a_wrong_baud_rate_is_distinguished_from_silence(scene, protocol):
    with made(protocol, scene) as emulator:
        with open_line(protocol, emulator.path, rates(protocol)[1]) as link:
            driver = open_driver(protocol, link, read_options(
                protocol, {'torque_limit': 0.1}, 'test'))
            with pytest.raises(DriveError) as raised:
                driver.identify(timeout=0.2)
    assert raised.value.reason in ('silent', 'garbled')


@pytest.mark.parametrize('wrong', sorted(DRIVES))
def test_another_protocol_does_not_pass_the_handshake(scene, wrong):
    right = 'vesc' if wrong == 'odrive' else 'odrive'
    with made(right, scene) as emulator, open_line(
            wrong, emulator.path, rates(wrong)[0]) as link:
        driver = open_driver(wrong, link, read_options(wrong, {'torque_limit': 0.1}, 'test'))
        with pytest.raises(DriveError):
            driver.identify(timeout=0.2)


@pytest.mark.slow
def test_the_drive_disarms_when_the_host_is_killed(emulator):
    code = ('import sys, time; from test_emulator_emulator import connect, drive\n'
            'link, driver = connect(sys.argv[1]); driver.arm(); drive(driver, 60.0)')
    host = subprocess.Popen([sys.executable, '-c', code, emulator.path],
                            env={**os.environ, 'PYTHONPATH': os.pathsep.join(
                                [os.path.dirname(__file__), *sys.path])})
    try:
        wait_until(lambda: emulator.torque == TORQUE)
    finally:
        host.send_signal(signal.SIGKILL)
        host.wait()
    killed = steady_time()
    wait_until(lambda: emulator.torque == 0.0)
    when, torque = emulator.log[-1]
    assert torque == 0.0 and when < killed + 3.0 * WATCHDOG


def test_pulling_the_plug_is_an_error_and_plugging_in_again_works(emulator):
    link, driver = connect(emulator.path)
    driver.arm(REPLY_TIMEOUT)
    drive(driver, 0.05)
    execute(emulator, 'unplug')
    with pytest.raises(LinkError) as raised:
        drive(driver, 1.0)
    assert raised.value.reason == 'gone'
    link.close()
    with pytest.raises(LinkError) as raised:
        Link(emulator.path, BAUD)
    assert raised.value.reason == 'missing'
    wait_until(lambda: emulator.torque == 0.0)
    execute(emulator, 'plug')
    wait_until(lambda: emulator.terminal.plugged)
    link, driver = connect(emulator.path)
    with link:
        driver.arm(REPLY_TIMEOUT)
        wait_until(lambda: emulator.torque == TORQUE, lambda: drive(driver, 0.01))


def test_a_plug_that_is_out_for_a_time_comes_back_by_itself(emulator):
    execute(emulator, 'unplug 0.5')
    assert not emulator.terminal.plugged
    wait_until(lambda: emulator.terminal.plugged)
    connect(emulator.path)[0].close()


def test_a_silent_drive_is_overdue_and_still_obeys(emulator):
    link, driver = connect(emulator.path)
    with link:
        driver.arm(REPLY_TIMEOUT)
        drive(driver, 0.05)
        execute(emulator, 'silence 0.3')
        telemetry = drive(driver, 0.2, torque=-TORQUE)
        assert driver.counts['lost'] > 5
        assert emulator.torque == -TORQUE
        assert telemetry.time < steady_time() - 0.1
        assert drive(driver, 0.3).time > steady_time() - 0.1


def test_a_hot_drive_trips_and_says_so(emulator):
    link, driver = connect(emulator.path)
    with link:
        driver.arm(REPLY_TIMEOUT)
        drive(driver, 0.05)
        execute(emulator, 'temperature 120')
        wait_until(lambda: emulator.torque == 0.0)
        assert drive(driver, 0.4).faults
        with refused('not_armed', 'drive', DriveError) as caught:
            driver.arm(REPLY_TIMEOUT)
        assert 'MOTOR_FAILED' in str(caught.value)
        execute(emulator, 'clear')
        driver.arm(REPLY_TIMEOUT)
        wait_until(lambda: emulator.torque == TORQUE, lambda: drive(driver, 0.01))


def test_a_rebooted_drive_has_forgotten_that_it_was_armed(emulator):
    link, driver = connect(emulator.path)
    with link:
        driver.arm(REPLY_TIMEOUT)
        drive(driver, 0.05)
        execute(emulator, 'reboot')
        telemetry = drive(driver, 0.8)
        assert emulator.torque == 0.0 and telemetry.armed is False


def test_an_encoder_jump_shows_in_the_position(emulator):
    link, driver = connect(emulator.path)
    with link:
        wait_until(lambda: driver.poll().time is not None, driver.ask)
        before = driver.telemetry.position
        execute(emulator, 'encoder_jump 2')
        wait_until(lambda: abs(driver.poll().position - before) > 1.0, driver.ask)
        assert driver.telemetry.position - before == pytest.approx(4 * 3.14159265, abs=0.05)


def test_a_drive_that_does_not_read_makes_the_line_stuck(emulator):
    execute(emulator, 'slow_reader 0')
    with Link(emulator.path, BAUD) as link:
        with pytest.raises(LinkError) as raised:
            for _ in range(200):
                link.write(b'u 0\n' * 50)
    assert raised.value.reason == 'stuck'


def test_a_slow_drive_on_a_bus_reads_at_the_rate_of_the_text(scene):
    emulator = made('odrive_can', scene)
    execute(emulator, 'slow_reader 60')
    with open(emulator.path, 'r+b', buffering=0) as host:
        host.write(b'S8\rO\r' + 30 * b'r0090\r')
        lengths = [len(emulator._read(1.0)) for _ in range(3)]
    assert lengths == [9 * RECORD_SIZE, 10 * RECORD_SIZE, 10 * RECORD_SIZE]


# All protocols with all faults: test_drives_bad_line.py.
@pytest.mark.slow
@pytest.mark.parametrize('protocol, fault', zip(sorted(DRIVES), [
    'corrupt 0.02', 'drop 0.02', 'duplicate 0.02', 'delay 0.02', 'garbage 200 from']))
def test_telemetry_stays_true_on_a_bad_line(scene, protocol, fault):
    with made(protocol, scene, seed=5) as emulator:
        link, driver = connect(emulator.path, protocol, emulator.device)
        with link:
            execute(emulator, fault)
            voltages, positions = set(), {}
            end = steady_time() + 20.0
            while len(positions) < 20:
                assert steady_time() < end
                driver.ask()
                time.sleep(0.004)
                telemetry = driver.poll()
                if telemetry.time is not None:
                    positions[telemetry.time] = telemetry.position
                voltages.add(telemetry.bus_voltage)
        assert voltages <= {None, 12.0}
        # The ball is at rest: the measured pendulum angle must be that of hanging.
        assert max(map(abs, positions.values())) < 0.01


def test_the_exception_of_a_call_is_raised_in_its_thread_and_the_emulator_goes_on(emulator):
    with pytest.raises(ZeroDivisionError):
        emulator.call(lambda: 1 / 0)
    done = []
    emulator.call(lambda: done.append(1))
    assert done and emulator.failure is None


def test_stop_after_an_interrupted_wait_lets_the_step_end(scene):
    # The descriptors of the terminal are closed then, and reused for the log.
    class Interrupt(Exception):
        pass

    def interrupt(*_):
        raise Interrupt
    started, ended = [], []

    def tick(now):
        started.append(now)
        time.sleep(0.1)
        ended.append(now)
    emulator = made('odrive', scene)
    emulator.device.tick = tick
    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        with emulator:
            signal.setitimer(signal.ITIMER_REAL, 0.25)
            with pytest.raises(Interrupt):
                emulator.wait()
    finally:
        signal.signal(signal.SIGALRM, before)
    assert started == ended != []
    assert not emulator.terminal.plugged


def test_every_fault_of_the_table_is_understood(emulator):
    for name, fault in FAULTS.items():
        assert execute(emulator, f'{name} 0.5' if fault.argument else name) == 'ok'
    for name in LINE_FAULTS:
        assert execute(emulator, f'{name} 0.5') == execute(emulator, f'{name} 0 to') == 'ok'
    assert emulator.from_drive.faults.drop == 0.5 and emulator.to_drive.faults.drop == 0.0
    execute(emulator, 'clear')
    assert emulator.from_drive.faults.drop == 0.0
    wait_until(lambda: emulator.terminal.plugged)


@pytest.mark.parametrize('line, reason, proposed', [
    ('', 'unknown_name', 'corrupt'), ('corupt 0.1', 'unknown_name', "'corrupt'"),
    ('drop', 'wrong_type', ''), ('drop much', 'wrong_type', ''), ('drop 2', 'out_of_range', ''),
    ('drop 0.1 up', 'not_a_choice', '"to" or "from"'), ('silence -1', 'out_of_range', ''),
    ('reboot 3', 'wrong_type', ''), ('unplug nan', 'out_of_range', ''),
    ('voltage -5', 'out_of_range', ''), ('temperature 1e9', 'out_of_range', ''),
    ('encoder_jump inf', 'out_of_range', ''), ('drop nan', 'not_finite', '')])
def test_a_fault_that_is_not_understood_is_refused(emulator, line, reason, proposed):
    with refused(reason, line.partition(' ')[0], ConfigurationError) as caught:
        execute(emulator, line)
    assert proposed in str(caught.value)
    assert answer(emulator, line).startswith('error: ')


def test_faults_come_over_a_socket(emulator, tmp_path):
    import json
    import socket
    channel = Channel(emulator, tmp_path / 'control')
    try:
        with socket.socket(socket.AF_UNIX) as peer:
            peer.connect(str(tmp_path / 'control'))
            stream = peer.makefile('rw')
            said = []
            for line in ('drop 0.25 from', 'nonsense', 'state'):
                stream.write(f'{line}\n')
                stream.flush()
                said.append(stream.readline().strip())
        assert said[0] == 'ok' and said[1].startswith('error: ')
        state = json.loads(said[2])
        assert state['plugged'] and state['imu_upward'] == pytest.approx(9.81, abs=0.01)
        assert emulator.from_drive.faults.drop == 0.25
    finally:
        channel.close()


def test_a_link_does_not_overwrite_a_file(scene, tmp_path):
    (tmp_path / 'file').write_text('precious')
    with refused('exists', '--link'):
        Emulator('odrive', scene, link=tmp_path / 'file')
    assert (tmp_path / 'file').read_text() == 'precious'


@pytest.mark.slow
def test_the_example_of_the_document_runs():
    document = (Path(__file__).resolve().parents[3] / 'docs' / 'hardware.md').read_text()
    example = [block for block in re.findall(r'```python\n(.*?)```', document, re.DOTALL)
               if 'Emulator' in block][0]
    done = subprocess.run([sys.executable, '-c', example], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert '/dev/pts/' in done.stdout


@pytest.mark.slow
def test_the_command_prints_the_device_obeys_lines_and_keeps_the_log(tmp_path):
    process = subprocess.Popen(
        [sys.executable, '-m', 'ballbot_ros.cli', 'emulate-motor', '--protocol', 'odrive',
         '--firmware', '0.6', '--baud', str(BAUD), '--link', str(tmp_path / 'ttyBall'),
         '--watchdog', '0.5', '--log', str(tmp_path / 'log.csv')],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline().strip() == str(tmp_path / 'ttyBall')
        link, driver = connect(str(tmp_path / 'ttyBall'))
        with link:
            assert driver.identity.generation == '0.6'
            watchdog, = (item for item in driver.read_settings() if item.name == 'watchdog')
            assert watchdog.value == '0.5 s'
            driver.arm(REPLY_TIMEOUT)
            drive(driver, 0.1)
            driver.stop()
        process.stdin.write('nonsense\n')
        process.stdin.flush()
        assert process.stdout.readline().startswith('error: ')
    finally:
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=20) == 0
    log = (tmp_path / 'log.csv').read_text().splitlines()
    assert log[0] == 'time,torque' and log[1].endswith(f',{TORQUE:g}') and log[-1].endswith(',0')
    assert not (tmp_path / 'ttyBall').is_symlink()
