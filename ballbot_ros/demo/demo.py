# SPDX-License-Identifier: Apache-2.0
"""Run the demo: processes, recorder, timeline, picture, verdict."""
from contextlib import contextmanager
import os
from pathlib import Path
import signal
import sys
import time
from typing import Any, Iterator, List

from nav_msgs.msg import Odometry
import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

from ballbot_ros.decision import load_curve
from ballbot_ros.demo.beginning import Beginning
from ballbot_ros.demo.processes import NodeProcesses, own_domain, stay_here
from ballbot_ros.demo.story import Story
from ballbot_ros.figures.run import save, strip
from ballbot_ros.msg import BallState, StepDecision, StepObservation
from ballbot_ros.physics import load_scene, Scene, Trajectory
from ballbot_ros.plant.step_sensor import faces
from ballbot_ros.ros import qos
from ballbot_ros.ros.bag import BagRecorder
from ballbot_ros.ros.conversions import to_seconds
from ballbot_ros.ros.executor import new_executor
from ballbot_ros.ros.settings import SimulatorSettings

SCENE, CURVE = 'doorstep', 'gimball_down'
LONGEST = 30.0  # simulated time after which the robot has had its chance [s]

TOPICS = (
    ('joint_states', JointState, qos.RECORD), ('joint_commands', JointState, qos.RECORD),
    ('set_point', JointState, qos.RECORD), ('odom', Odometry, qos.RECORD),
    ('step_observation', StepObservation, qos.RECORD), ('ball_state', BallState, qos.RECORD),
    ('step_decision', StepDecision, qos.RECORD_LATCHED))


def run_demo(out: Path, real_time: bool = False, quiet: bool = False,
             timeout: float = 60.0, scene_name: str = SCENE) -> int:
    """
    Let the robot meet two door-steps.

    Parameters
    ----------
    out : Path
        Folder for the bag, the picture and the logs.
    real_time : bool
        Run at the pace of the wall clock instead of in lockstep, as fast as it goes.
    quiet : bool
        Tell only the verdict.
    timeout : float
        Wall time after which it is given up [s].
    scene_name : str
        A scene with two steps, or its file.

    Returns
    -------
    int
        0 if the robot crossed the first step and came to rest before the second, 1 if not.

    """
    scene, domain = load_scene(scene_name), own_domain()
    out.mkdir(parents=True, exist_ok=True)
    story = Story(faces(scene.model.terrain), scene.model.robot, load_curve(CURVE),
                  (lambda *_: None) if quiet else tell)
    begun = time.monotonic()
    if not quiet:
        how = 'in real time' if real_time else 'in lockstep, as fast as it goes'
        print(f'Three nodes on ROS domain {domain}, {how}.  {scene.model.robot.name} stands '
              'before a door-step.\n', flush=True)
    with ending_by_signal():
        wrong = _play(out, scene_name, story, domain, real_time, timeout)
    return conclude(out, scene, story, wrong, begun)


def conclude(out: Path, scene: Scene, story: Story, wrong: List[str], begun: float) -> int:
    """
    Draw the picture, tell the verdict, and return the exit code.

    Parameters
    ----------
    out : Path
        Folder for the picture.
    scene : Scene
    story : Story
    wrong : list of str
        What went wrong on the way.
    begun : float
        When the run began, of ``time.monotonic`` [s].

    """
    wrong = wrong + story.verdict()
    picture = out / 'crossing.png'
    if story.states:
        save(strip(_trajectory(scene, story.states), 'what the topics told'), picture)
    simulated = to_seconds(story.states[-1].header.stamp) if story.states else 0.0
    print(f'\n{"FAILED" if wrong else "Done"}: {simulated:.1f} s of simulated time in '
          f'{time.monotonic() - begun:.1f} s.  Picture: {picture}  Bag: {out / "bag"}')
    for sentence in wrong:
        print(f'  - {sentence}', file=sys.stderr)
    return 1 if wrong else 0


@contextmanager
def ending_by_signal() -> Iterator[None]:
    """Let SIGTERM leave by the way that ends all nodes, not at once."""
    before = signal.signal(signal.SIGTERM, _leave)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _leave(number: int, _frame: Any) -> None:
    sys.exit(128 + number)


def ended_badly(nodes: NodeProcesses) -> List[str]:
    """Return a sentence about a node that has ended by itself, if one has."""
    ended = nodes.ended()
    return [] if ended is None else [
        f'node {ended[0]} ended with code {ended[1]}, see {nodes.log(ended[0])}']


def tell(when: float, mark: str, sentence: str) -> None:
    """Print one line of the timeline."""
    print(f'{when:7.2f} s  {mark:>9}  {sentence}', flush=True)


def _play(out: Path, scene_name: str, story: Story, domain: int, real_time: bool,
          timeout: float) -> List[str]:
    """Run the nodes until the story has its end; return what went wrong on the way."""
    deadline = time.monotonic() + timeout
    lockstep_period = 1.0 / SimulatorSettings.observation_rate
    os.environ.update(stay_here(out / 'logs'))
    rclpy.init(domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
    node, executor = Node('ballbot_demo'), new_executor()
    executor.add_node(node)
    try:
        with BagRecorder(out / 'bag') as bag, NodeProcesses(out / 'logs', domain) as nodes:
            bag.subscribe(node, TOPICS, {
                'ball_state': lambda data: story.ball(deserialize_message(data, BallState)),
                'step_decision':
                    lambda data: story.decision(deserialize_message(data, StepDecision))})
            nodes.start('controller', {
                'lockstep_set_point_period': 0.0 if real_time else lockstep_period})
            nodes.start('obstacle_decision', {'curve': CURVE})
            nodes.start('simulator', {
                'scene': scene_name, 'lockstep': not real_time,
                'real_time_factor': 1.0 if real_time else 0.0, 'start_paused': True})
            beginning = Beginning(node, bag, (topic for topic, _, _ in TOPICS))
            while story.rested is None and time.monotonic() < deadline:
                executor.spin_once(timeout_sec=0.1)
                bag.take_all()
                beginning.work()
                wrong = ended_badly(nodes)
                if wrong:
                    return wrong
                if story.states and to_seconds(story.states[-1].header.stamp) > LONGEST:
                    break
            else:
                if story.rested is None:
                    return [f'given up after {timeout:g} s; where the machine was just too slow, '
                            'allow more (--timeout)']
            codes = nodes.stop()
            bag.take_all()
            return [f'node {name} ended with code {code}, see {nodes.log(name)}'
                    for name, code in codes.items() if code]
    finally:
        executor.remove_node(node)
        node.destroy_node()
        rclpy.try_shutdown()


def _trajectory(scene: Scene, states: List[BallState]) -> Trajectory:
    """Return the recorded states as a trajectory, for the picture."""
    rows = np.zeros((len(states), 15))
    for row, state in zip(rows, states):
        row[:9] = (to_seconds(state.header.stamp), state.ball_angle, state.pendulum_angle,
                   state.x, state.y, state.ball_rate, state.pendulum_rate, state.velocity_x,
                   state.velocity_y)
        row[13:] = state.motor_work, state.pendulum_torque
    return Trajectory(scene.model, rows)
