# SPDX-License-Identifier: Apache-2.0
"""A node is visible to the network only if the user has configured it so."""
from pathlib import Path
import re
import subprocess
import sys
from xml.etree import ElementTree

import pytest

from ballbot_ros.ros import discovery

NODE = """
import sys
from rclpy.node import Node
from ballbot_ros.ros.endpoints import create_publisher
from ballbot_ros.ros.run import run

class Speaking(Node):
    def __init__(self):
        super().__init__('speaking')
        create_publisher(self, 'joint_commands')
        # Print only when it spins: a node stopped during its construction prints nothing.
        self._timer = self.create_timer(0.01, self._say)

    def _say(self):
        self._timer.cancel()
        print('up', flush=True)

sys.exit(run(Speaking, []))
"""
LISTENER = """
import sys
from rclpy.node import Node
from ballbot_ros.ros.endpoints import create_subscription
from ballbot_ros.ros.run import run

class Listening(Node):
    def __init__(self):
        super().__init__('listening')
        create_subscription(self, 'joint_commands', lambda message: None)

sys.exit(run(Listening, []))
"""
SPEAKER = """
import os, time
import rclpy
from rclpy.duration import Duration
from sensor_msgs.msg import JointState
from ballbot_ros.ros import discovery
from ballbot_ros.ros.endpoints import create_publisher

discovery.apply(os.environ)
rclpy.init()
publisher = create_publisher(rclpy.create_node('speaking'), 'joint_commands')
while not publisher.get_subscription_count():
    time.sleep(0.01)
for _ in range(5):
    publisher.publish(JointState())
    print(publisher.wait_for_all_acked(Duration(seconds=1)), flush=True)
    publisher.wait_for_all_acked(Duration(seconds=30))
rclpy.try_shutdown()
"""
WATCHER = """
import os, sys, time
import rclpy
from ballbot_ros.ros import discovery

discovery.apply(os.environ)
rclpy.init()
node = rclpy.create_node('watching')
while not node.count_publishers('joint_commands'):
    time.sleep(0.01)
print('found', flush=True)
sys.stdin.readline()
start = time.monotonic()
while node.count_publishers('joint_commands'):
    time.sleep(0.01)
print(time.monotonic() - start, flush=True)
rclpy.try_shutdown()
"""
DOMAIN = 231
# RTPS assigns 250 ports to each domain, which receive all its messages.
PORTS = range(7400 + 250 * DOMAIN, 7650 + 250 * DOMAIN)


def addresses(pid):
    """Return protocol, address and port of the sockets of a process."""
    inodes = set()
    for file in Path('/proc', str(pid), 'fd').iterdir():
        found = re.fullmatch(r'socket:\[(\d+)\]', str(file.readlink()))
        inodes |= {found[1]} if found else set()
    for protocol in ('udp', 'udp6', 'tcp', 'tcp6'):
        for line in Path('/proc/net', protocol).read_text().splitlines()[1:]:
            words = line.split()
            if words[9] in inodes:
                address, port = words[1].split(':')
                yield protocol, address, int(port, 16)


@pytest.fixture
def default_discovery(monkeypatch):
    """Let processes find each other as without settings of the user, in a domain of their own."""
    for name in (*discovery.DISCOVERY_VARIABLES, *discovery.FAST_DDS_VARIABLES):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv('ROS_DOMAIN_ID', str(DOMAIN))


@pytest.mark.usefixtures('default_discovery')
def test_by_default_a_node_receives_from_this_machine_only():
    node = subprocess.Popen([sys.executable, '-c', NODE], stdout=subprocess.PIPE,
                            stderr=subprocess.PIPE, text=True)
    try:
        assert node.stdout.readline() == 'up\n', node.communicate()[1]
        found = list(addresses(node.pid))
    finally:
        node.terminate()
        said = node.communicate()[1]
    receiving = {address for protocol, address, port in found if port in PORTS}
    assert receiving == {'0100007F'}, found  # 127.0.0.1
    assert not any(protocol.startswith('tcp') for protocol, *_ in found)
    assert 'from this machine only' in said and discovery.SUBNET_SETTING in said
    assert node.returncode == 0


@pytest.mark.usefixtures('default_discovery')
def test_a_message_is_acknowledged_before_the_default_heartbeat_of_three_seconds():
    listener = subprocess.Popen([sys.executable, '-c', LISTENER], stderr=subprocess.DEVNULL)
    try:
        said = subprocess.run([sys.executable, '-c', SPEAKER], stdout=subprocess.PIPE, text=True,
                              check=True, timeout=300.0).stdout
    finally:
        listener.terminate()
        listener.wait()
    # A busy machine may delay some of them.
    assert said.count('True') > said.count('False'), said


@pytest.mark.slow
@pytest.mark.usefixtures('default_discovery')
def test_a_killed_node_leaves_the_graph_before_the_default_lease_of_twenty_seconds():
    watcher = subprocess.Popen([sys.executable, '-c', WATCHER], stdin=subprocess.PIPE,
                               stdout=subprocess.PIPE, text=True)
    publisher = subprocess.Popen([sys.executable, '-c', NODE], stdout=subprocess.DEVNULL,
                                 stderr=subprocess.DEVNULL)
    try:
        assert watcher.stdout.readline() == 'found\n'
        publisher.kill()
        publisher.wait()
        said, _ = watcher.communicate('killed\n', timeout=60.0)
    finally:
        for process in (publisher, watcher):
            process.kill()
            process.wait()
    assert float(said) < 15.0


@pytest.mark.parametrize('choice', [
    {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'}, {'ROS_STATIC_PEERS': '192.0.2.7'},
    {'ROS_LOCALHOST_ONLY': '0'}, {'ROS_DISCOVERY_SERVER': '192.0.2.7:11811'},
    {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', 'ROS_STATIC_PEERS': '192.0.2.7'}])
def test_the_discovery_range_of_the_user_is_kept_and_named(choice):
    environment = dict(choice)
    said = discovery.apply(environment)
    assert environment == choice
    assert all(f'{name}={value}' in said for name, value in choice.items())
    assert 'this machine' not in said


def test_a_process_limited_to_this_machine_gets_the_profiles_of_fast_dds():
    for choice in ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}, {'ROS_LOCALHOST_ONLY': '1'}):
        environment = dict(choice)
        assert 'this machine only' in discovery.apply(environment)
        for name in discovery.FAST_DDS_VARIABLES:
            ElementTree.parse(environment.pop(name))
        assert environment == choice


def test_an_empty_variable_is_ignored_and_settings_of_the_user_are_kept():
    environment = {'ROS_STATIC_PEERS': '', 'FASTDDS_DEFAULT_PROFILES_FILE': '/my/own.xml'}
    discovery.apply(environment)
    assert environment.pop('ROS_AUTOMATIC_DISCOVERY_RANGE') == 'LOCALHOST'
    assert environment == {'ROS_STATIC_PEERS': '',
                           'FASTDDS_DEFAULT_PROFILES_FILE': '/my/own.xml'}
