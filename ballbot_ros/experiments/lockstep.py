# SPDX-License-Identifier: Apache-2.0
"""One run of an experiment: nodes in lockstep, recorded up to the last state."""
import os
from pathlib import Path
import time
from typing import Any, Callable, Dict, List, Mapping

from ballbot_ros.demo.processes import NodeProcesses, own_domain
from ballbot_ros.demo.recorded_graph import recording, resets_until_recorded
from ballbot_ros.errors import RefusedError
from ballbot_ros.nodes.simulator.outputs import every
from ballbot_ros.nodes.simulator.settings import SimulatorSettings
from ballbot_ros.ros import discovery
from ballbot_ros.srv import Step

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


def last_stamps(simulator: Mapping[str, Any], periods: int) -> Dict[str, int]:
    """Return the stamp of the last message of each topic with a separate rate [ns]."""
    settings = SimulatorSettings.from_mapping(simulator, 'simulator')
    spans = every(settings)
    return {name: round(periods // span * span / settings.control_rate * 1e9)
            for name, span in (('joint_states', spans.joint_states), ('odom', spans.odometry),
                               ('ball_state', spans.ball_state))}


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
    topics, last = topics_of(nodes), last_stamps(nodes['simulator'], periods)
    deadline = time.monotonic() + timeout
    with recording('ballbot_experiment', folder, metadata, domain) as (
            node, executor, recorder, bag), NodeProcesses(logs, domain) as processes:
        def wait(condition: Callable[[], object]) -> None:
            while not condition():
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

        for topic in topics:
            bag.subscribe(recorder, topic)
        bag.record_in_thread()
        for name, parameters in nodes.items():
            processes.start(name, parameters)
        step = node.create_client(Step, 'simulator/step')
        resets = resets_until_recorded(node, bag, topics)
        wait(step.service_is_ready)
        wait(lambda: next(resets, 'recorded'))
        run = step.call_async(Step.Request(periods=periods))
        wait(run.done)
        if not run.result().success:
            raise RefusedError(f'the simulation was refused: {run.result().message}',
                               'failed', 'simulator')
        wait(lambda: bag.reached({
            topic: last.get(topic, last['joint_states']) for topic in topics}))
