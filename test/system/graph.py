# SPDX-License-Identifier: Apache-2.0
"""A private ROS graph: nodes as processes, and a test node that communicates with them."""
from functools import partial
import signal
import subprocess
import sys
import time

from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from waiting import TIMEOUT

from ballbot_ros.cli import main
from ballbot_ros.demo.processes import NodeProcesses, parameter_arguments
from ballbot_ros.nodes.start import start
from ballbot_ros.ros.conversions import to_seconds, to_time
from ballbot_ros.srv import Step

# Reliable, and deep enough that no message is lost while the test is delayed.
EVERYTHING = QoSProfile(depth=5000)

# The services of the simulator.
SIMULATOR = {'pause': Trigger, 'resume': Trigger, 'reset': Trigger, 'step': Step}


class Graph:
    """
    A graph of nodes on one ROS domain; all waits are for a condition.

    Parameters
    ----------
    folder : Path
        Folder for the logs of the nodes.
    domain : int
        ROS domain that no other test uses.

    """

    def __init__(self, folder, domain):
        """Join the domain."""
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = Node('test', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.processes = NodeProcesses(folder, domain)
        self.statuses = {}
        self._publishers = {}
        self._load = []
        self._clients = {}
        for name, kind in SIMULATOR.items():
            self.client(f'simulator/{name}', kind)
        self.subscribe('/diagnostics', DiagnosticArray, callback=self._note)

    def close(self):
        """End every process and leave the domain; may be called repeatedly."""
        self.end_load()
        self.processes.stop()
        if not self.context.ok():
            return
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self.context)

    # Processes

    def start(self, name, *arguments, **parameters):
        """Start a node of the package as a copy of the server that has imported all nodes."""
        self.processes.fork(name, partial(start, name), [
            *parameter_arguments(parameters), *arguments], 'forkserver')

    def start_together(self, **nodes):
        """Start nodes with their parameters in one process, whose log is called `together`."""
        parameters = {f'{name}:{parameter}': value for name, values in nodes.items()
                      for parameter, value in values.items()}
        words = ['run', *nodes, *parameter_arguments(parameters)]
        self.processes.fork('together', partial(main, words), method='forkserver')

    def log(self, name):
        """Return what a node has logged so far."""
        return self.processes.log(name).read_text()

    def kill(self, name):
        """Kill a node."""
        self.processes.signal(name, signal.SIGKILL)
        assert self.processes.wait(name, TIMEOUT) == -signal.SIGKILL

    def end(self, name, number=signal.SIGINT):
        """Send a signal to a node and return its exit code."""
        self.processes.signal(name, number)
        return self.processes.wait(name, TIMEOUT)

    def add_load(self, processes=3):
        """Load the processor with other processes until `end_load` or the end of the test."""
        self._load += [subprocess.Popen([sys.executable, '-c', 'while True: pass'])
                       for _ in range(processes)]

    def end_load(self):
        """End the processes of `add_load`."""
        while self._load:
            process = self._load.pop()
            process.kill()
            process.wait()

    # Topics

    def subscribe(self, topic, kind, profile=EVERYTHING, callback=None):
        """Subscribe to a topic; return the list that receives its messages."""
        received = []
        self.node.create_subscription(kind, topic, callback or received.append, profile)
        return received

    def publisher(self, topic, kind=JointState, profile=EVERYTHING):
        """Return a publisher once it has a subscriber."""
        if topic not in self._publishers:
            self._publishers[topic] = self.node.create_publisher(kind, topic, profile)
        publisher = self._publishers[topic]
        self.wait(lambda: publisher.get_subscription_count(), f'a node subscribes to {topic}')
        return publisher

    def publish_until(self, condition, what, topic, *messages):
        """Publish messages, or results of functions, in turn; return as `wait` does."""
        kind = JointState if callable(messages[0]) else type(messages[0])
        publisher = self.publisher(topic, kind)
        deadline, turn = time.monotonic() + TIMEOUT, 0
        while not (found := condition()):
            assert time.monotonic() < deadline, self._timed_out(what)
            message = messages[turn % len(messages)]
            publisher.publish(message() if callable(message) else message)
            turn += 1
            self.spin(0.02)
        return found

    def joint(self, position=(), velocity=(), effort=(), stamp=0.0, name=('pendulum',)):
        """Return a joint message."""
        message = JointState(name=list(name), position=list(position), velocity=list(velocity),
                             effort=list(effort))
        message.header.stamp = to_time(stamp)
        return message

    # Waiting

    def spin(self, seconds):
        """Execute callbacks for a time [s]."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._spin_once()

    def _spin_once(self):
        # With a changed timeout rclpy restarts at its first subscription: on a busy machine the
        # messages of later ones would never be taken.
        self.executor.spin_once(timeout_sec=0.02)

    def wait(self, condition, what, timeout=TIMEOUT):
        """Return the result of a condition as soon as it is true."""
        deadline = time.monotonic() + timeout
        while not (found := condition()):
            assert time.monotonic() < deadline, self._timed_out(what, timeout)
            self._spin_once()
        return found

    def wait_for_time(self, states, seconds):
        """Wait until the stamps of messages have reached a time [s], even on a busy machine."""
        self.wait(lambda: states and to_seconds(states[-1].header.stamp) >= seconds,
                  f'simulated time has reached {seconds:g} s', TIMEOUT + 3.0 * seconds)

    def wait_for_log(self, name, text):
        """Wait until a node has logged a text."""
        self.wait(lambda: text in self.log(name), f'{name} logs {text!r}')

    def _timed_out(self, what, timeout=TIMEOUT):
        logs = '\n'.join(f'--- {path.stem}\n{path.read_text()[-3000:]}' for path in
                         sorted(self.processes.log('x').parent.glob('*.log')))
        endpoints = '\n'.join(
            f'{topic}: {[end.node_name for end in self.node.get_publishers_info_by_topic(topic)]}'
            f' -> {[end.node_name for end in self.node.get_subscriptions_info_by_topic(topic)]}'
            for topic, _ in self.node.get_topic_names_and_types())
        health = '\n'.join(f'{name}: {status.message} {self.values(name)}'
                           for name, status in self.statuses.items())
        return f'not within {timeout:g} s: {what}\n{endpoints}\n{health}\n{logs}'

    # Services

    def client(self, service, kind):
        """
        Return the client of a service.

        If created before its server, it is discovered before the first response.
        """
        if service not in self._clients:
            self._clients[service] = self.node.create_client(kind, service)
        return self._clients[service]

    def call(self, service, kind, again=True, **fields):
        """
        Call any service and return its response.

        The request is repeated if `again`: on a busy machine, a server that has just discovered
        this client may lose its first response.
        """
        client = self.client(service, kind)
        start, futures = time.monotonic(), []
        while not any(future.done() for future in futures):
            if not futures or again and time.monotonic() > start + 3.0 * len(futures):
                self.wait(client.service_is_ready, f'{service} is ready')
                futures.append(client.call_async(kind.Request(**fields)))
            assert time.monotonic() < start + TIMEOUT, self._timed_out(f'{service} answers')
            self._spin_once()
        return next(future.result() for future in futures if future.done())

    def change_state(self, name, transition):
        """Request a transition of a lifecycle node; return whether it succeeded."""
        return self.call(f'{name}/change_state', ChangeState, again=False,
                         transition=Transition(id=transition)).success

    def request(self, service, again=True, **fields):
        """Call a service of the simulator and return its response."""
        return self.call(f'simulator/{service}', SIMULATOR[service], again, **fields)

    def call_async(self, service, **fields):
        """Call a service of the simulator and return the future of its response."""
        client = self.client(f'simulator/{service}', SIMULATOR[service])
        self.wait(client.service_is_ready, f'{service} is there')
        return client.call_async(client.srv_type.Request(**fields))

    def trigger(self, verb):
        """Call pause, resume or reset of the simulator and return its message."""
        response = self.request(verb)
        assert response.success, response.message
        return response.message

    def wait_until_connected(self, *topics):
        """Reset a paused simulation until each of the lists has received a message."""
        deadline = time.monotonic() + TIMEOUT
        while not all(topics):
            assert time.monotonic() < deadline, self._timed_out('all nodes are connected')
            self.trigger('reset')
            self.spin(0.1)

    def step(self, periods):
        """Step a paused simulator by some periods; return the simulated time afterwards [s]."""
        response = self.request('step', again=False, periods=periods)
        assert response.success, response.message
        return to_seconds(response.time)

    # Health

    def _note(self, array):
        for status in array.status:
            self.statuses[status.name.split(':')[0]] = status

    def values(self, name):
        """Return the newest values of a node on /diagnostics, an empty dict before the first."""
        status = self.statuses.get(name)
        return {pair.key: pair.value for pair in status.values} if status else {}

    def refusals(self, name):
        """Return the number of messages that a node has refused, by reason."""
        return {key[len('refused_'):]: int(value) for key, value in self.values(name).items()
                if key.startswith('refused_')}

    def wait_for_health(self, name, level, message=''):
        """Wait until a node reports this level of health with this message."""
        self.wait(lambda: name in self.statuses and self.statuses[name].level == level
                  and message in self.statuses[name].message,
                  f'{name} publishes {level!r} {message!r} on /diagnostics')
