# SPDX-License-Identifier: Apache-2.0
"""One run of an experiment: nodes in lockstep, recorded up to the last state."""
import os
from pathlib import Path
import time
from typing import Any, Iterator, List, Mapping, Sequence

from ballbot_ros.demo.processes import NodeProcesses, own_domain
from ballbot_ros.demo.recorded_graph import Advance, ADVANCE_TIME, recording, run_simulator
from ballbot_ros.errors import RefusedError
from ballbot_ros.nodes.simulator.outputs import every
from ballbot_ros.nodes.simulator.settings import SimulatorSettings
from ballbot_ros.ros import discovery

# Longest wall time of a spin [s].
SPIN_TIME = 0.02


def topics_of(nodes: Mapping[str, Mapping[str, Any]]) -> List[str]:
    topics = ['joint_states', 'joint_commands', 'odom', 'ball_state']
    if nodes['simulator']['terrain_rate']:
        topics.append('terrain_observation')
    if nodes['simulator']['observation_rate']:
        topics.append('step_observation')
    if 'obstacle_decision' in nodes:
        topics += ['set_point', 'step_decision']
    return topics


def advances_of(simulator: Mapping[str, Any], topics: Sequence[str], periods: int
                ) -> Iterator[Advance]:
    """
    Yield the advances of a run, which are recorded up to the last state and its command.

    Before the last advance, only the topics of which the simulator has the period are waited for.
    """
    settings = SimulatorSettings.from_mapping(simulator, 'simulator')
    spans = every(settings)
    known = {'joint_states': spans.joint_states, 'odom': spans.odometry,
             'ball_state': spans.ball_state}
    length = max(1, round(ADVANCE_TIME * settings.control_rate))
    for begin in range(0, periods, length):
        end = min(begin + length, periods)
        yield end - begin, {
            topic: round(end // known.get(topic, 1) * known.get(topic, 1)
                         / settings.control_rate * 1e9)
            for topic in (topics if end == periods else known)}


def run_lockstep(folder: Path, nodes: Mapping[str, Mapping[str, Any]], periods: int,
                 metadata: Mapping[str, str], timeout: float) -> None:
    """
    Run nodes, given by their parameters, for a number of control periods, and record them.

    The nodes include a simulator, paused and in lockstep.  The folder gets ``bag``, with the
    metadata, and ``logs``.  Raises `RefusedError` naming the logs if a node ends, time does not
    advance, or after the timeout [s of wall time].
    """
    domain, logs = own_domain(), folder / 'logs'
    logs.mkdir(parents=True, exist_ok=True)
    discovery.apply(os.environ)
    topics = topics_of(nodes)
    deadline = time.monotonic() + timeout
    with recording('ballbot_experiment', folder, metadata, domain) as (
            node, executor, recorder, bag), NodeProcesses(logs, domain) as processes:
        for topic in topics:
            bag.subscribe(recorder, topic)
        bag.record_in_thread()
        for name, parameters in nodes.items():
            processes.start(name, parameters)
        for reason in run_simulator(
                node, bag, topics, advances_of(nodes['simulator'], topics, periods)):
            if reason is not None:
                raise RefusedError(reason, 'failed', 'simulator')
            executor.spin_once(timeout_sec=SPIN_TIME)
            if bag.failure is not None:
                raise RefusedError(
                    f'the bag cannot be written: {bag.failure}', 'not_writable', 'bag')
            ended = processes.ended()
            if ended is not None:
                raise RefusedError(f'node {ended[0]} ended with code {ended[1]}; see '
                                   f'{processes.log(ended[0])}', 'failed', ended[0])
            if time.monotonic() > deadline:
                raise RefusedError(
                    f'not finished within {timeout:g} s; on a slow machine increase '
                    f'--timeout; otherwise see {logs}', 'timeout', '--timeout')
