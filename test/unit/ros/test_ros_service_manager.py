# SPDX-License-Identifier: Apache-2.0
"""Messages to systemd on a real socket: only a running bridge sends watchdog messages."""
import configparser
import os
from pathlib import Path
import shutil
import socket
import subprocess
from types import SimpleNamespace

import pytest
import yaml

from ballbot_ros.bridge.supervisor import EStop, StopReason
from ballbot_ros.cli.run import NODES
from ballbot_ros.config.fields import checked_values
from ballbot_ros.nodes.bridge import service_manager
from ballbot_ros.nodes.bridge.service_manager import MESSAGES_PER_TIMEOUT, ServiceManager
from ballbot_ros.nodes.bridge.settings import BridgeSettings
from ballbot_ros.nodes.imu.node import ImuSettings

ROOT = Path(__file__).resolve().parents[3]
UNITS = sorted((ROOT / 'config' / 'systemd').glob('*.service'))
LOOP = object()


class Systemd:
    """The other end of the socket, and a clock."""

    def __init__(self, address):
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self.socket.bind(address)
        self.now = 1000.0

    def messages(self):
        """Return the messages since the last call."""
        found = []
        while True:
            try:
                found.append(self.socket.recv(4096).decode())
            except BlockingIOError:
                return found


@pytest.fixture(params=('file', 'abstract'))
def systemd(request, tmp_path, monkeypatch):
    """Return a service manager with a watchdog timeout of ten seconds."""
    name = f'ballbot-test-{os.getpid()}'
    address = str(tmp_path / 'notify') if request.param == 'file' else f'@{name}'
    found = Systemd(address if request.param == 'file' else '\0' + name)
    monkeypatch.setenv('NOTIFY_SOCKET', address)
    monkeypatch.setenv('WATCHDOG_USEC', '10000000')
    monkeypatch.setattr(service_manager, 'steady_time', lambda: found.now)
    yield found
    found.socket.close()


def session(e_stop='', trouble='', driver=True, timed_out=False):
    """Return the parts of a session that the status depends on."""
    return SimpleNamespace(
        line=SimpleNamespace(trouble=trouble, driver=LOOP if driver else None),
        supervisor=SimpleNamespace(
            e_stop=e_stop and EStop(StopReason.REQUESTED, e_stop), timed_out=timed_out))


def run_service(systemd, service, seconds, beats=True, loop=LOOP, failure=None):
    """Notify ten times a second for some seconds; return the messages."""
    found = []
    for _ in range(round(10 * seconds)):
        systemd.now += 0.1
        if beats:
            service.beat(None)
        service.notify(session(), loop, failure)
        found += systemd.messages()
    return found


def test_ready_and_stopping_are_reported(systemd):
    service = ServiceManager()
    assert not systemd.messages()
    service.ready()
    service.stopping()
    assert systemd.messages() == ['READY=1', 'STOPPING=1']


def test_a_running_bridge_sends_several_watchdog_messages_per_timeout(systemd):
    found = run_service(systemd, ServiceManager(), 60.0)
    assert found.count('WATCHDOG=1') == pytest.approx(6.0 * MESSAGES_PER_TIMEOUT, abs=2)


def test_a_stalled_loop_stops_the_watchdog_messages_although_the_executor_runs(systemd):
    service = ServiceManager()
    run_service(systemd, service, 5.0)
    found = run_service(systemd, service, 60.0, beats=False)
    assert found.count('WATCHDOG=1') <= 1
    assert 'WATCHDOG=1' in run_service(systemd, service, 10.0)


def test_a_stalled_executor_sends_no_message_although_the_loop_runs(systemd):
    service = ServiceManager()
    for _ in range(1000):
        systemd.now += 0.1
        service.beat(None)
    assert not systemd.messages()


def test_a_failed_bridge_sends_no_watchdog_message(systemd):
    service = ServiceManager()
    assert 'WATCHDOG=1' not in run_service(systemd, service, 20.0, failure=ValueError())


def test_a_missing_drive_does_not_stop_the_watchdog_messages(systemd):
    service = ServiceManager()
    found = run_service(systemd, service, 30.0, beats=False, loop=None)
    assert found.count('WATCHDOG=1') >= 10


@pytest.mark.parametrize('loop, state, status', [
    (None, {'trouble': 'no such port'}, 'not configured: no such port'),
    (None, {}, 'not configured'),
    (LOOP, {'driver': False, 'trouble': 'unplugged'}, 'looking for the drive: unplugged'),
    (LOOP, {'e_stop': 'engaged at start'}, 'e-stop: engaged at start'),
    (LOOP, {'timed_out': True}, 'commands timed out'), (LOOP, {}, 'running')])
def test_the_status_names_the_cause_of_missing_power_and_is_sent_only_on_change(
        systemd, monkeypatch, loop, state, status):
    monkeypatch.delenv('WATCHDOG_USEC')
    service = ServiceManager()
    for _ in range(3):
        service.notify(session(**state), loop)
    assert systemd.messages() == [f'STATUS={status}']


@pytest.mark.parametrize('changes', (
    {'WATCHDOG_USEC': ''}, {'WATCHDOG_USEC': '0'}, {'WATCHDOG_USEC': 'never'},
    {'WATCHDOG_USEC': '-5'}, {'WATCHDOG_PID': '1'}))
def test_a_process_without_a_watchdog_sends_no_watchdog_message(systemd, monkeypatch, changes):
    for name, value in changes.items():
        monkeypatch.setenv(name, value)
    assert 'WATCHDOG=1' not in run_service(systemd, ServiceManager(), 20.0)


def test_without_systemd_nothing_is_sent(monkeypatch):
    monkeypatch.delenv('NOTIFY_SOCKET', raising=False)
    service = ServiceManager()
    service.ready()
    service.notify(session(), LOOP)
    service.stopping()


def test_a_closed_or_full_socket_does_no_harm(systemd):
    service = ServiceManager()
    for _ in range(5000):
        service.ready()
    systemd.socket.close()
    service.stopping()


def service_in(path):
    """Return the section Service of a unit file."""
    unit = configparser.ConfigParser(interpolation=None)
    unit.optionxform = str
    unit.read(path)
    return unit['Service']


@pytest.mark.parametrize('path', UNITS, ids=lambda path: path.stem)
def test_the_units_are_well_formed_and_run_existing_nodes(path):
    service = service_in(path)
    node = path.stem.split('-')[1]
    assert f'/lib/ballbot_ros/{node}"' in service['ExecStart']
    assert f'/etc/ballbot/{node}.yaml' in service['ExecStart']
    assert node in NODES
    if shutil.which('systemd-analyze'):
        done = subprocess.run(['systemd-analyze', 'verify', path], capture_output=True, text=True)
        assert 'Unknown' not in done.stderr, done.stderr


def test_the_unit_of_the_bridge_grants_the_limits_and_the_watchdog_of_its_parameters():
    service = service_in(ROOT / 'config' / 'systemd' / 'ballbot-bridge.service')
    parameters = yaml.safe_load((ROOT / 'config' / 'systemd' / 'bridge.yaml').read_text())
    values = parameters['/**']['ros__parameters']
    assert service['Type'] == 'notify' and float(service['WatchdogSec']) > 0.0
    assert values['realtime_priority'] <= int(service['LimitRTPRIO'])
    assert values['lock_memory'] and service['LimitMEMLOCK'] == 'infinity'


@pytest.mark.parametrize('path', UNITS, ids=lambda path: path.stem)
def test_logs_black_box_and_machine_code_are_in_writable_folders_of_the_service(path):
    # rclpy does not start if it cannot create its log folder.
    service = service_in(path)
    environment = dict(pair.split('=') for pair in service['Environment'].split())
    assert service['ProtectHome'] == 'read-only'
    assert environment['ROS_HOME'] == f'/var/lib/{service["StateDirectory"]}'
    assert environment['XDG_CACHE_HOME'] == f'/var/cache/{service["CacheDirectory"]}'


@pytest.mark.parametrize('name, cls', [
    ('bridge', BridgeSettings), ('imu', ImuSettings)])
def test_the_parameter_files_of_the_services_are_valid(name, cls):
    path = ROOT / 'config' / 'systemd' / f'{name}.yaml'
    values = yaml.safe_load(path.read_text())['/**']['ros__parameters']
    checked_values(cls, values, path.name)
