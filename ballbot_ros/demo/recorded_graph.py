# SPDX-License-Identifier: Apache-2.0
"""A ROS graph for a demo: nodes as processes, and a recorder of their topics."""
from collections import deque
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
import itertools
import os
from pathlib import Path
import time
from typing import (
    Any, Collection, Deque, Dict, Iterable, Iterator, List, Mapping, Optional, Sequence, Tuple)

import rclpy
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import Trigger

from ballbot_ros.bags import recorded_run
from ballbot_ros.bags.writer import BagRecorder, stamp_of
from ballbot_ros.demo.processes import NodeProcesses, parameter_arguments
from ballbot_ros.demo.timeline import Timeline
from ballbot_ros.msg import BallState, StepDecision
from ballbot_ros.nodes.start import start
from ballbot_ros.ros import discovery
from ballbot_ros.ros.rclpy_compat import new_executor
from ballbot_ros.srv import Step

# Period at which recorded messages and the node processes are checked [s].
POLL_PERIOD = 0.01
# Topics of the timeline.
STATES, DECISIONS = 'ball_state', 'step_decision'
# A topic that lags another topic by this time no longer delays it [ns].
LONGEST_DELAY = 5 * 10**9
# Wall time after which a paused simulator is reset again, to publish its state [s].
RESET_PERIOD = 0.2
# Time after which a response that has not arrived counts as lost [s].
LONGEST_ANSWER = 5.0
# Simulated time of an advance in lockstep [s].
ADVANCE_TIME = 1.0

# A generator for the actions of a run: it yields None while it waits, and the reason if the run
# cannot continue.
Actions = Iterator[Optional[str]]
# A number of control periods, and the last stamp of some topics in them [ns].
Advance = Tuple[int, Mapping[str, int]]


class MessagesInOrder:
    """
    Queue of the messages of several topics, in the order of their stamps and then of the topics.

    Topics arrive independently: on a busy machine one may lag another by a second.  Messages are
    added in one thread and taken in another one.
    """

    def __init__(self, *topics: str):
        self.topics = topics
        self._waiting: Dict[str, Deque[Tuple[int, bytes]]] = {topic: deque() for topic in topics}
        self._newest = dict.fromkeys(topics, -1)

    def add(self, topic: str, data: bytes) -> None:
        """Add a serialized message that begins with a stamp."""
        stamp = stamp_of(data)
        self._waiting[topic].append((stamp, data))
        self._newest[topic] = stamp

    def take(self) -> Optional[Tuple[str, bytes]]:
        """Return topic and message, or None while an earlier message may still arrive."""
        newest = dict(self._newest)  # before the heads: another thread may add messages in between
        heads = {topic: waiting[0][0] for topic, waiting in self._waiting.items() if waiting}
        if not heads:
            return None
        topic = min(heads, key=lambda one: heads[one])
        stamp = heads[topic]
        if min(newest.values()) < stamp and newest[topic] < stamp + LONGEST_DELAY:
            return None
        return topic, self._waiting[topic].popleft()[1]


@dataclass(frozen=True)
class RecordedGraph:
    """The nodes of a demo, and the recording node; created by `recorded_graph`."""

    node: Node
    executor: Executor
    bag: BagRecorder
    nodes: NodeProcesses
    timeline: Timeline
    messages: MessagesInOrder

    def run(self, actions: Actions, timeout: float, longest: float,
            topics: Sequence[str] = ()) -> List[str]:
        """
        Record until the ball rests, and `topics` to that time; end the nodes; return failures.

        The run fails after `timeout` of wall time without a new state [s], and ends after
        `longest` on the timeline [s].
        """
        deadline, reached, ended = time.monotonic() + timeout, self.timeline.now, False
        while not (ended and self._recorded_to_end(topics)):
            self.executor.spin_once(timeout_sec=POLL_PERIOD)
            while not ended and (message := self.messages.take()) is not None:
                self._add_to_timeline(*message)
                ended = self.timeline.rested is not None or self.timeline.now > longest
            if self.timeline.now > reached:
                deadline, reached = time.monotonic() + timeout, self.timeline.now
            reason = next(actions, None)
            if reason:
                return [reason]
            if self.bag.failure is not None:
                return [f'the bag cannot be written: {self.bag.failure}']
            failed = self.nodes.ended()
            if failed is not None:
                return [self._failure(*failed)]
            if time.monotonic() > deadline:
                return [f'no new state on ball_state for {timeout:g} s; if the machine is only '
                        'too slow, increase --timeout']
        codes = self.nodes.stop()
        self.bag.take_all()
        return [self._failure(name, code) for name, code in codes.items() if code]

    def _add_to_timeline(self, topic: str, data: bytes) -> None:
        if topic == STATES:
            self.timeline.add_state(deserialize_message(data, BallState))
        else:
            self.timeline.add_decision(deserialize_message(data, StepDecision))

    def _recorded_to_end(self, topics: Sequence[str]) -> bool:
        last = recorded_run.stamp_of(self.timeline.states[-1])
        return self.bag.reached(dict.fromkeys(topics, last))

    def _failure(self, name: str, code: int) -> str:
        return f'node {name} ended with code {code}, see {self.nodes.log(name)}'


@contextmanager
def recorded_graph(out: Path, topics: Sequence[str], timeline: Timeline,
                   nodes: Mapping[str, Mapping[str, Any]], metadata: Mapping[str, str],
                   domain: int) -> Iterator[RecordedGraph]:
    """
    Yield a graph of nodes, given by their parameters, on a ROS domain; end all processes on exit.

    The topics are recorded to a bag with the `metadata` in the folder `out`; ``ball_state`` and
    ``step_decision`` also go to the timeline.
    """
    discovery.apply(os.environ)
    messages = MessagesInOrder(*(topic for topic in (STATES, DECISIONS) if topic in topics))
    with NodeProcesses(out / 'logs', domain) as processes:
        for name, parameters in nodes.items():
            processes.fork(name, partial(start, name), parameter_arguments(parameters))
        with recording('ballbot_demo', out, metadata, domain) as (node, executor, recorder, bag):
            for topic in topics:
                bag.subscribe(recorder, topic, partial(messages.add, topic)
                              if topic in messages.topics else None)
            bag.record_in_thread()
            yield RecordedGraph(node, executor, bag, processes, timeline, messages)


@contextmanager
def recording(name: str, out: Path, metadata: Mapping[str, str], domain: int
              ) -> Iterator[Tuple[Node, Executor, Node, BagRecorder]]:
    """Yield a node, its executor, a second node for recording, and the bag in a folder."""
    rclpy.init(domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
    node, recorder, executor = Node(name), Node('ballbot_recorder'), new_executor()
    executor.add_node(node)
    try:
        with BagRecorder(out / 'bag', metadata) as bag:
            yield node, executor, recorder, bag
    finally:
        executor.remove_node(node)
        node.destroy_node()
        recorder.destroy_node()
        rclpy.try_shutdown()


def run_simulator(node: Node, bag: BagRecorder, topics: Iterable[str],
                  advances: Optional[Iterable[Advance]]) -> Actions:
    """
    Run a paused simulator no faster than the recorder of some topics can follow.

    At first, the recorder must receive every topic: each reset makes the simulator publish its
    first state, to which the other nodes respond.  Counting publishers is not enough: a publisher
    may not have discovered the recorder yet.

    In lockstep, the simulator makes each of the `advances` as soon as all messages of the previous
    one are recorded.  On a busy machine a recorder would otherwise lag by more messages than the
    publishers keep.  Without `advances`, for instance in real time, it is not interrupted.
    """
    reset = node.create_client(Trigger, 'simulator/reset')
    resume = node.create_client(Trigger, 'simulator/resume')
    step = node.create_client(Step, 'simulator/step')
    wanted = set(topics)

    def received() -> bool:
        return wanted <= bag.recorded.keys()

    while not all(client.service_is_ready() for client in (reset, resume, step)):
        yield None
    while not received():
        answer, called = reset.call_async(Trigger.Request()), time.monotonic()
        # The simulator must not be reset after it has started.
        while not (answer.done() and received()) and (
                (waited := time.monotonic() - called) < RESET_PERIOD or (
                    not answer.done() and waited < RESET_PERIOD + LONGEST_ANSWER)):
            yield None
    if advances is None:
        resume.call_async(Trigger.Request())
        return
    for periods, stamps in advances:
        answer = step.call_async(Step.Request(periods=periods))
        # A response may be lost during service discovery, so the recorded stamps are checked.
        while not bag.reached(stamps):
            if answer.done() and not answer.result().success:
                yield f'the simulator has stopped: {answer.result().message}'
            yield None


def endless_advances(topics: Collection[str], control_rate: float) -> Iterator[Advance]:
    """Yield advances for topics that have a message at each multiple of `ADVANCE_TIME`."""
    for number in itertools.count(1):
        yield (round(ADVANCE_TIME * control_rate),
               dict.fromkeys(topics, round(1e9 * number * ADVANCE_TIME)))
