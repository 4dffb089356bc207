# SPDX-License-Identifier: Apache-2.0
"""Findings and remedies of the doctor on real ports."""
from dataclasses import replace
import fcntl
from functools import partialmethod
import os
import termios
from types import SimpleNamespace

import pytest

from ballbot_ros.bridge.commissioning import doctor
from ballbot_ros.bridge.commissioning.doctor import (
    check_buses, check_drive, check_latency, check_permission, check_ports,
    check_ros, NOTE, OK, probe, stable_names, WRONG)
from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.cli.command import main
from ballbot_ros.drives import driver_class, DRIVES, line_of, SERIAL
from ballbot_ros.emulator.ball import settings_for
from ballbot_ros.emulator.control import execute
from ballbot_ros.emulator.emulator import Emulator
from ballbot_ros.errors import DriveError, LinkError
from ballbot_ros.physics import load_scene


def hardware(**connection):
    """Return the shipped ODrive with another connection."""
    shipped = load_hardware('gimball_odrive')
    return replace(shipped, connection=replace(shipped.connection, **connection))


@pytest.fixture
def vesc():
    """Return an emulated VESC at 460800 baud."""
    with Emulator('vesc', load_scene('flat'), baud=460800) as emulator:
        yield emulator


def only_wrong(findings):
    """Return the only wrong finding."""
    wrong, = (finding for finding in findings if finding.verdict == WRONG)
    return wrong


def test_a_drive_with_correct_settings_passes(vesc):
    right = hardware(port=vesc.path, baud=460800, protocol='vesc')
    right = replace(right, drive={})
    findings = list(check_drive(right))
    assert all(finding.verdict == OK for finding in findings) and len(findings) > 2
    assert 'firmware' in findings[0].what


@pytest.mark.slow
def test_bad_port_busy_port_wrong_protocol_and_wrong_baud_are_distinguished(vesc, monkeypatch):
    monkeypatch.setattr(doctor, 'REPLY_TIMEOUT', 0.1)
    findings = [only_wrong(check_drive(hardware(port='/dev/ttyNOWHERE')))]
    findings.append(only_wrong(check_drive(hardware(port=vesc.path, baud=460800))))
    findings.append(only_wrong(check_drive(
        replace(hardware(port=vesc.path, baud=115200, protocol='vesc'), drive={}))))
    holder = os.open(vesc.path, os.O_RDWR | os.O_NOCTTY)
    fcntl.ioctl(holder, termios.TIOCEXCL)
    fcntl.flock(holder, fcntl.LOCK_EX)
    try:
        findings.append(only_wrong(check_drive(hardware(port=vesc.path))))
    finally:
        os.close(holder)
    for finding, word in zip(findings, ('there is no port', 'wrong protocol', 'wrong baud rate',
                                        'in use by another program')):
        assert word in finding.what
    assert findings[1].remedy == 'set protocol: vesc in the file'
    assert findings[2].remedy.startswith('set baud: 460800')
    assert 'fuser' in findings[3].what


def findings_of_odrive(act=lambda drive: None, **settings):
    """Return the findings about an emulated ODrive with other settings, after an action."""
    scene = load_scene('flat')
    with Emulator('odrive', scene, baud=921600,
                  settings=settings_for(scene.model.robot, **settings)) as drive:
        act(drive)
        return list(check_drive(hardware(port=drive.path)))


def test_unsafe_settings_are_wrong_and_have_a_command_as_remedy():
    findings = findings_of_odrive(watchdog=0.0)
    wrong = only_wrong(findings)
    assert 'watchdog' in wrong.what and 'w axis0.config' in wrong.remedy
    assert findings[-1].verdict == NOTE and findings[-1].remedy.startswith('ss ')


def test_factory_settings_of_an_odrive_are_each_reported_with_a_command():
    wrong = [finding for finding in findings_of_odrive(quirks=('factory',))
             if finding.verdict == WRONG]
    assert [finding.what.split(',')[0] for finding in wrong] == [
        'torque limit 0.4 N m', 'watchdog off', 'velocity limit in torque mode 2 turn/s',
        'overspeed error 2.4 turn/s', 'braking 0.01 A into the supply', 'encoder 0 (not ready)']
    assert all(finding.remedy.startswith('w ') for finding in wrong)


@pytest.mark.parametrize('firmware, board', [('0.5', 'v3.6-56V'), ('0.6', 'S1 (5.2.0)')])
def test_the_generation_of_the_firmware_is_named(firmware, board):
    findings = findings_of_odrive(firmware=firmware)
    assert all(finding.verdict == OK for finding in findings)
    assert board in findings[0].what and findings[0].what.endswith(f', generation {firmware}')


def test_unsupported_firmware_is_not_reported_as_a_wrong_baud_rate():
    wrong = only_wrong(findings_of_odrive(
        lambda drive: drive.device.properties.update(fw_version_minor=7), firmware='0.6'))
    assert 'must be 0.5 or 0.6, got 0.7.11' in wrong.what and 'firmware' in wrong.remedy


def test_late_replies_are_not_reported_as_a_drive_that_does_not_answer():
    wrong = only_wrong(findings_of_odrive(lambda drive: execute(drive, 'delay 0.07 from')))
    assert 'too late' in wrong.what and 'reply_timeout is 0.05 s' in wrong.what
    assert 'no known drive' not in wrong.remedy


def test_the_latency_timer_of_an_ftdi_adapter_is_found(tmp_path):
    folder = tmp_path / 'bus/usb-serial/devices/ttyUSB0'
    folder.mkdir(parents=True)
    (folder / 'latency_timer').write_text('16\n')
    finding = only_wrong(check_latency('/dev/ttyUSB0', tmp_path))
    assert '16 ms' in finding.what and f'tee {folder}' in finding.remedy
    (folder / 'latency_timer').write_text('1\n')
    assert not list(check_latency('/dev/ttyUSB0', tmp_path))


def test_a_missing_port_and_a_port_without_permission_are_reported():
    assert next(check_ports([])).what == 'no serial port found'
    if os.getuid():  # root may open every port
        assert WRONG in [finding.verdict for finding in check_ports([('/dev/mem', 'memory')])]


@pytest.mark.parametrize('permitted, verdict', [(True, OK), (False, NOTE)])
def test_a_real_time_priority_that_is_not_permitted_is_reported_with_the_remedy(
        permitted, verdict, monkeypatch):
    monkeypatch.setattr(doctor, 'permits', lambda priority: permitted)
    found, = (finding for finding in doctor.examine('gimball_odrive', '/dev/none', {})
              if 'real-time priority' in finding.what)
    assert found.verdict == verdict
    assert ('rtprio' in found.remedy) is not permitted


@pytest.mark.parametrize('environment, verdicts', [
    ({}, [OK, OK]), ({'ROS_DOMAIN_ID': '7', 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'},
                     [OK, OK]),
    ({'ROS_DOMAIN_ID': '230'}, [WRONG, OK]), ({'ROS_DOMAIN_ID': 'x'}, [WRONG, OK]),
    ({'ROS_DOMAIN_ID': '101', 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'}, [OK, OK]),
    ({'ROS_DOMAIN_ID': '102', 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SYSTEM_DEFAULT'},
     [WRONG, NOTE]),
    ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCAL'}, [OK, WRONG])])
def test_ros_domain_and_discovery_range_are_reported(environment, verdicts):
    findings = list(check_ros(environment))
    assert [finding.verdict for finding in findings] == verdicts
    assert environment.get('ROS_DOMAIN_ID', '0') in findings[0].what


def test_an_accessible_port_passes_and_its_stable_name_is_proposed(tmp_path, monkeypatch):
    device = tmp_path / 'ttyUSB0'
    device.touch()
    findings = list(check_ports([(str(device), 'FTDI')], tmp_path))
    assert [finding.verdict for finding in findings] == [OK]
    assert str(device) in findings[0].what and 'FTDI' in findings[0].what
    folder = tmp_path / 'by-id'
    folder.mkdir()
    (folder / 'usb-FTDI-b').symlink_to(device)
    (folder / 'usb-FTDI-a').symlink_to(device)
    (folder / 'usb-other').symlink_to(tmp_path / 'ttyUSB1')
    assert stable_names(str(device), folder) == [
        str(folder / 'usb-FTDI-a'), str(folder / 'usb-FTDI-b')]
    assert stable_names(str(device), tmp_path / 'nothing') == []
    monkeypatch.setattr(doctor, 'stable_names', lambda device: ['/first', '/second'])
    named, = check_ports([(str(device), 'FTDI')], tmp_path)
    assert '/first' in named.remedy


def test_a_port_of_another_group_is_wrong_with_usermod_as_remedy(tmp_path, monkeypatch):
    device = tmp_path / 'ttyUSB0'
    device.touch()
    assert list(check_permission(str(device))) == []
    assert list(check_permission(str(tmp_path / 'gone'))) == []
    monkeypatch.setattr(os, 'access', lambda path, mode: mode != os.R_OK | os.W_OK)
    assert 'usermod' in only_wrong(check_permission(str(device))).remedy


@pytest.mark.parametrize('fails', ['', 'identify', 'read_settings'])
def test_the_port_is_closed_after_any_answer_of_the_drive(fails, monkeypatch):
    class Drive:
        line = SimpleNamespace(closed=0, port='x')
        keeping = ''

        def answer(self, name):
            if name == fails:
                raise DriveError('planted', 'silent', 'drive')
            return SimpleNamespace(in_words='a drive') if name == 'identify' else ()

        identify = partialmethod(answer, 'identify')
        read_settings = partialmethod(answer, 'read_settings')

    def close():
        Drive.line.closed += 1
    Drive.line.close = close
    monkeypatch.setattr(doctor, 'connector', lambda hardware: Drive)
    monkeypatch.setattr(doctor, 'probe', lambda *_: None)
    wrong = [each for each in check_drive(hardware(port='x')) if each.verdict == WRONG]
    assert Drive.line.closed == 1 and len(wrong) == bool(fails)


class Port:
    """A port on which one protocol answers at one baud rate."""

    def __init__(self, monkeypatch, protocol, baud, error=None, answer=None):
        self.tried = []

        class Line:
            def __init__(link, name, port, rate):
                link.rate = rate
                if error is not None:
                    raise error

            def close(link):
                pass

        def driver(name, link, options):
            self.tried.append((name, link.rate))

            def identify(timeout):
                if (name, link.rate) != (protocol, baud):
                    raise DriveError('no answer', 'silent', 'drive')
                if answer is not None:
                    raise answer
            return SimpleNamespace(identify=identify)
        monkeypatch.setattr(doctor, 'open_line', Line)
        monkeypatch.setattr(doctor, 'open_driver', driver)


def test_the_most_likely_settings_are_tried_first_and_none_twice(monkeypatch):
    port = Port(monkeypatch, 'roboclaw', 38400)
    said = []
    assert probe('x', 'vesc', 921600, said.append) == ('roboclaw', 38400)
    assert port.tried[0] == ('vesc', 921600) and {name for name, _ in port.tried[:3]} == {
        'vesc', 'odrive', 'roboclaw'}
    assert {rate for _, rate in port.tried[:3]} == {921600}
    assert len(set(port.tried)) == len(port.tried) == len(said)


@pytest.mark.parametrize('reason', ['late', 'firmware'])
def test_a_drive_that_cannot_be_used_is_found_all_the_same(monkeypatch, reason):
    Port(monkeypatch, 'vesc', 115200, answer=DriveError('not usable', reason, 'drive'))
    assert probe('x', 'odrive', 921600, lambda text: None) == ('vesc', 115200)


def test_every_protocol_is_tried_at_every_rate_that_it_supports(monkeypatch):
    port = Port(monkeypatch, 'nothing', 0)
    assert probe('x', 'odrive', 115200, lambda text: None) is None
    assert set(port.tried) == {
        (name, rate) for name in DRIVES if line_of(name) is SERIAL
        for rate in {115200, *driver_class(name).baud_rates}}


def test_can_interfaces_are_listed_and_an_inactive_one_with_the_command_that_enables_it(tmp_path):
    for name, kind, state in (('can0', 280, 'down'), ('vcan0', 280, 'unknown'), ('lo', 772, 'up'),
                              ('odd', 'x', 'up')):
        folder = tmp_path / 'class' / 'net' / name
        folder.mkdir(parents=True)
        (folder / 'type').write_text(f'{kind}\n')
        (folder / 'operstate').write_text(f'{state}\n')
    down, up = check_buses(tmp_path)
    assert (down.verdict, up.verdict) == (NOTE, OK)
    assert 'can0: a CAN interface, which is down' == down.what
    assert 'ip link set can0 up type can bitrate' in down.remedy


def test_no_answer_on_a_can_bus_suggests_a_check_of_the_termination():
    finding, = check_drive(load_hardware('gimball_vesc_can').at('virtual:missing'))
    assert finding.verdict == WRONG and 'no VESC with can_id 0' in finding.what
    assert '120 ohm' in finding.remedy and 'RX' not in finding.remedy


def test_on_a_can_bus_only_can_protocols_are_tried_and_only_at_its_bit_rate(monkeypatch):
    port = Port(monkeypatch, 'nothing', 0)
    assert probe('can0', 'vesc_can', 500000, lambda text: None) is None
    assert set(port.tried) == {
        (name, 500000) for name in DRIVES if line_of(name) is not SERIAL}
    assert port.tried[0][0] == 'vesc_can'


def test_a_port_that_cannot_be_opened_is_retried_only_after_a_bad_baud_rate(monkeypatch):
    for reason in ('busy', 'bad_baud'):
        said = []
        Port(monkeypatch, 'vesc', 1, LinkError('planted', reason, 'port'))
        assert probe('x', 'vesc', 1, said.append) is None
        assert (len(said) == 1) is (reason == 'busy')


def test_the_command_prints_findings_with_remedies_and_fails(capsys):
    assert main(['doctor', '--port', '/dev/ttyNOWHERE']) == 1
    said = capsys.readouterr().out
    assert 'there is no port /dev/ttyNOWHERE' in said and '-> ' in said and 'ROS domain' in said
