# SPDX-License-Identifier: Apache-2.0
"""A ROS graph for a demo: nodes as processes, and a recorder of their topics."""
from contextlib import contextmanager
from dataclasses import dataclass
import os
from pathlib import Path
from queue import SimpleQueue
import time
from typing import Any, Callable, Iterator, List, Mapping, Optional, Sequence

import rclpy
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions

from ballbot_ros.bags.writer import BagRecorder
from ballbot_ros.demo.processes import NodeProcesses, own_domain
from ballbot_ros.demo.timeline import Timeline
from ballbot_ros.msg import BallState, StepDecision
from ballbot_ros.ros import discovery
from ballbot_ros.ros.rclpy_compat import new_executor

# So often what was recorded is looked at, and the nodes are [s].
TAKE_AGAIN = 0.01


@dataclass(frozen=True)
class RecordedGraph:
    """The nodes of a demo, and the recording node; created by `recorded_graph`."""

    node: Node
    executor: Executor
    bag: BagRecorder
    nodes: NodeProcesses
    timeline: Timeline
    updates: 'SimpleQueue[Callable[[], None]]'  # pending timeline updates

    def run(self, poll: Callable[[], Optional[str]], timeout: float,
            longest: float, topics: Sequence[str] = ()) -> List[str]:
        """
        Record until the ball rests, and these topics up to then; end the nodes; return failures.

        Calls `poll` often, which returns why it cannot go on, or nothing; gives up after
        `timeout` of wall time without a new state [s], and ends after `longest` on the timeline
        [s], when the robot has had its chance.
        """
        deadline, reached, ended = time.monotonic() + timeout, self.timeline.now, False
        while not (ended and self._recorded_to_end(topics)):
            self.executor.spin_once(timeout_sec=TAKE_AGAIN)
            while not (ended or self.updates.empty()):
                self.updates.get()()
                ended = self.timeline.rested is not None or self.timeline.now > longest
            if self.timeline.now > reached:
                deadline, reached = time.monotonic() + timeout, self.timeline.now
            hopeless = poll()
            if hopeless:
                return [hopeless]
            if self.bag.failure is not None:
                return [f'the bag cannot be written: {self.bag.failure}']
            failed = self.nodes.ended()
            if failed is not None:
                return [self._badly(*failed)]
            if time.monotonic() > deadline:
                return [f'given up after {timeout:g} s without a new state on ball_state; where '
                        'the machine was just too slow, allow more (--timeout)']
        codes = self.nodes.stop()
        self.bag.take_all()
        return [self._badly(name, code) for name, code in codes.items() if code]

    def _recorded_to_end(self, topics: Sequence[str]) -> bool:
        stamp = self.timeline.states[-1].header.stamp
        return self.bag.reached(dict.fromkeys(topics, stamp.sec * 10**9 + stamp.nanosec))

    def _badly(self, name: str, code: int) -> str:
        return f'node {name} ended with code {code}, see {self.nodes.log(name)}'


@contextmanager
def recorded_graph(out: Path, topics: Sequence[str], timeline: Timeline,
                   nodes: Mapping[str, Mapping[str, Any]],
                   metadata: Optional[Mapping[str, str]] = None,
                   domain: Optional[int] = None) -> Iterator[RecordedGraph]:
    """
    Yield a graph of nodes, given by their parameters; terminate all processes on exit.

    The topics are recorded to a bag in the folder `out`; ``ball_state`` and ``step_decision``
    also go to the timeline.  The bag contains the `metadata`.  By default the ROS domain is
    `own_domain`.
    """
    domain = own_domain() if domain is None else domain
    discovery.apply(os.environ)
    updates: SimpleQueue[Callable[[], None]] = SimpleQueue()

    def forwarding(take: Callable[[Any], None], kind: Any) -> Callable[[bytes], None]:
        return lambda data: updates.put(lambda: take(deserialize_message(data, kind)))
    with NodeProcesses(out / 'logs', domain) as processes:
        for name, parameters in nodes.items():
            processes.fork(name, parameters)
        rclpy.init(domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
        node, recorder, executor = Node('ballbot_demo'), Node('ballbot_recorder'), new_executor()
        executor.add_node(node)
        try:
            with BagRecorder(out / 'bag', metadata) as bag:
                callbacks = {'ball_state': forwarding(timeline.add_state, BallState),
                             'step_decision': forwarding(timeline.add_decision, StepDecision)}
                for topic in topics:
                    bag.subscribe(recorder, topic, callbacks.get(topic))
                bag.record_in_thread()
                yield RecordedGraph(node, executor, bag, processes, timeline, updates)
        finally:
            executor.remove_node(node)
            node.destroy_node()
            recorder.destroy_node()
            rclpy.try_shutdown()
