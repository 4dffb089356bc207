# SPDX-License-Identifier: Apache-2.0
"""Nodes as processes: their command line, their environment and their end."""
import os
from pathlib import Path
import signal
import subprocess
import sys

import pytest

from ballbot_ros.demo import processes
from ballbot_ros.demo.processes import environment, NodeProcesses, own_domain, parameter_arguments
from ballbot_ros.ros import discovery


def test_parameters_become_ros_arguments():
    assert parameter_arguments({}) == []
    assert parameter_arguments({'lockstep': True, 'rate': 2.5, 'scene': 'flat'}) == [
        '--ros-args', '-p', 'lockstep:=true', '-p', 'rate:=2.5', '-p', 'scene:=flat']
    assert parameter_arguments({
        'firmware': '0.6', 'capture': '', 'link': '/tmp/my #1', 'scene': Path('/tmp/a.yaml')}
    )[2::2] == ["firmware:='0.6'", "capture:=''", "link:='/tmp/my #1'", 'scene:=/tmp/a.yaml']


def test_the_domain_is_the_given_one_or_a_private_one(monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', '42')
    assert own_domain() == 42
    monkeypatch.delenv('ROS_DOMAIN_ID')
    assert 1 <= own_domain() <= 101
    monkeypatch.setenv('ROS_DOMAIN_ID', '')
    assert 1 <= own_domain() <= 101


def test_runs_in_one_or_several_processes_have_separate_domains(monkeypatch):
    monkeypatch.delenv('ROS_DOMAIN_ID', raising=False)
    here = {own_domain(number) for number in range(3)}
    there = subprocess.run(
        [sys.executable, '-c', 'import os; from ballbot_ros.demo import processes\n'
         f'os.getpid = lambda: {os.getpid()}\nprint(processes.own_domain())'],
        capture_output=True, text=True, check=True)
    assert len(here) == 3 and own_domain(1) in here
    assert int(there.stdout) not in here


def test_nodes_communicate_locally_unless_the_user_sets_otherwise(tmp_path, monkeypatch):
    for name in (*discovery.DISCOVERY_VARIABLES, *discovery.FAST_DDS_VARIABLES):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv('FASTDDS_DEFAULT_PROFILES_FILE', '/my/own.xml')
    found = environment(17, tmp_path / 'logs')
    assert found['ROS_DOMAIN_ID'] == '17'
    assert found['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'LOCALHOST'
    assert found['FASTDDS_DEFAULT_PROFILES_FILE'] == '/my/own.xml'
    assert 'FASTRTPS_DEFAULT_PROFILES_FILE' not in found
    assert 'ROS_DOMAIN_ID' not in os.environ or os.environ['ROS_DOMAIN_ID'] != '17'


@pytest.fixture
def sleepers(tmp_path, monkeypatch):
    """Return processes that run small programs in place of the nodes."""
    programs = {
        # Python keeps SIGINT ignored if it is so at the start, as in a background shell.
        'polite': 'import signal, time; signal.signal(signal.SIGINT, signal.default_int_handler); '
                  'print("up", flush=True); time.sleep(60)',
        'deaf': 'import signal, time; signal.signal(signal.SIGINT, signal.SIG_IGN); '
                'print("up", flush=True); time.sleep(60)',
        'broken': 'import sys; sys.exit(3)'}
    real = subprocess.Popen

    def start(command, **options):
        return real([sys.executable, '-c', programs[command[3]]], **options)
    monkeypatch.setattr(processes.subprocess, 'Popen', start)
    monkeypatch.setattr(processes, 'END_TIMEOUT', 2.0)
    with NodeProcesses(tmp_path / 'logs', 17) as nodes:
        yield nodes


def wait_until_up(nodes, name):
    while 'up' not in nodes.log(name).read_text():
        assert nodes.ended() is None


def test_a_node_that_has_ended_is_named_with_its_code(sleepers):
    sleepers.start('broken')
    while sleepers.ended() is None:
        pass
    assert sleepers.ended() == ('broken', 3)
    assert sleepers.stop() == {'broken': 3}


@pytest.mark.slow
def test_a_process_that_does_not_end_is_killed(sleepers):
    for name in ('polite', 'deaf'):
        sleepers.start(name)
        wait_until_up(sleepers, name)
    numbers = [sleepers._running[name].pid for name in ('polite', 'deaf')]
    codes = sleepers.stop()
    assert codes == {'polite': codes['polite'], 'deaf': -signal.SIGKILL}
    assert codes['polite'] != -signal.SIGKILL
    assert not any(Path('/proc', str(number)).exists() for number in numbers)
    assert sleepers.stop() == {}


def test_a_run_replaces_the_logs_of_the_last_and_a_restart_appends(tmp_path, sleepers):
    (tmp_path / 'new').mkdir()
    (tmp_path / 'new' / 'old.log').write_text('old')
    nodes = NodeProcesses(tmp_path / 'new', 17)
    assert not nodes.log('old').exists()
    with nodes:
        for number in (1, 2):
            nodes.start('polite')
            while nodes.log('polite').read_text().count('up') < number:
                pass
            nodes.signal('polite', signal.SIGTERM)
            assert nodes.wait('polite', 20.0) == -signal.SIGTERM
