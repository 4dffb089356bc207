# SPDX-License-Identifier: Apache-2.0
"""Run the demo: simulator, controller and decision, with timeline, bag, picture and verdict."""
from functools import partial
from importlib.util import find_spec
import os
from pathlib import Path
from shlex import quote
import signal
import sys
from tempfile import TemporaryFile
import time
from typing import (
    Any, BinaryIO, Callable, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple)

from matplotlib.figure import Figure
import yaml

from ballbot_ros.bags.metadata import bag_metadata, SIMULATOR
from ballbot_ros.bags.recorded_run import BALL_STATE, recorded_trajectory, stamp_of
from ballbot_ros.config.fields import check_value
from ballbot_ros.config.files import read_config, shipped_files
from ballbot_ros.control import checked_controller, load_tuning
from ballbot_ros.decision import load_curve, load_decision_tuning
from ballbot_ros.decision.tuning import check_decision
from ballbot_ros.demo.forked import Forked, import_nodes
from ballbot_ros.demo.prepare import prepare
from ballbot_ros.demo.processes import own_domain
from ballbot_ros.demo.recorded_graph import (
    endless_advances, recorded_graph, RecordedGraph, run_simulator)
from ballbot_ros.demo.timeline import account, Expected, Passage, Timeline
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.figures.film import Mark, strip
from ballbot_ros.figures.run import save
from ballbot_ros.nodes.controller.settings import ControllerSettings
from ballbot_ros.nodes.obstacle_decision.settings import DecisionSettings
from ballbot_ros.nodes.simulator.settings import SimulatorSettings
from ballbot_ros.physics import load_scene, Robot, Scene
from ballbot_ros.physics.model.robot import load_robot
from ballbot_ros.results.faces import faces_of
from ballbot_ros.ros.conversions import DECISION_NAMES
from ballbot_ros.ros.signals import ending_signals

# Parameters and rates of the nodes that the demo does not change.
ROBOT, TUNING = ControllerSettings.robot, ControllerSettings.tuning
CURVE, DECISION = DecisionSettings.curve, DecisionSettings.tuning
CONTROL_RATE, TERRAIN_RATE = SimulatorSettings.control_rate, SimulatorSettings.terrain_rate  # [Hz]
DURATION_MAX = 30.0  # end of the run, in simulated time [s]

TOPICS = ('joint_states', 'joint_commands', 'set_point', 'odom', 'terrain_observation',
          'ball_state', 'step_decision')
# Topics that viewers of a bag expect, if their types are installed.
TOOL_TOPICS = ('/clock', '/diagnostics', 'robot_description', 'markers',
               *(() if find_spec('tf2_msgs') is None else ('/tf', '/tf_static')))

# Required rates of the topics of the simulator and, in lockstep, of the replies to them [Hz].
STATES = {'joint_states': CONTROL_RATE, 'ball_state': SimulatorSettings.ball_state_rate,
          'odom': SimulatorSettings.odom_rate, 'terrain_observation': TERRAIN_RATE}
ANSWERS = {'joint_commands': CONTROL_RATE, 'set_point': TERRAIN_RATE,
           'step_decision': TERRAIN_RATE}


class DemoCase(NamedTuple):
    """A scene and the expected action at each face, left to right; None accepts any action."""

    title: str
    scene: str
    expected: Optional[Tuple[Expected, ...]]
    robot: str = ROBOT
    curve: str = CURVE
    tuning: str = TUNING
    longest: float = DURATION_MAX
    planner: str = 'rollout'


TWO_STEPS = DemoCase('The ball rests in front of a step, with a higher one behind it.',
                     'doorstep', (Expected.CROSSED, Expected.REFUSED))
CASES = (TWO_STEPS, DemoCase(
    'The floor slopes down, and ends in a drop.', 'drop_on_slope', (Expected.REFUSED,)))
# The first case of the planner cubic, whose rule requires a longer run-up than `TWO_STEPS` has.
LONG_RUN_UP = DemoCase(
    'The ball rests in front of a step, with the run-up that the cubic requires.', 'voltage_start',
    (Expected.CROSSED,), longest=5.0, planner='cubic')


def demo_cases(scene: Optional[str] = None, robot: Optional[str] = None,
               curve: Optional[str] = None, tuning: Optional[str] = None,
               longest: Optional[float] = None, planner: str = 'rollout') -> Sequence[DemoCase]:
    """
    Return the cases of a demo, after the same checks as in the nodes.

    By default they have the scenes of the demo, the robot of the scene, a curve for that robot,
    and the published gains; `longest` is the end of the run in simulated time [s].  Raises
    `ConfigurationError` with the remedy if a file does not exist or files are inconsistent.
    """
    check_value('planner', planner, DecisionSettings.__dataclass_fields__['planner'].metadata,
                'demo')
    duration = DURATION_MAX if longest is None else longest
    if not (robot or curve or tuning):
        known = [case._replace(longest=case.longest if longest is None else longest,
                               planner=planner,
                               expected=case.expected if case.planner == planner else None)
                 for case in (LONG_RUN_UP if planner == 'cubic' else TWO_STEPS, *CASES[1:])
                 if scene in (None, case.scene)]
        if known:
            return known
    scene = scene or CASES[0].scene
    load_scene(scene, robot)  # refuses invalid content
    name = robot or str(read_config('scenes', scene)[1]['robot'])
    kind = load_robot(name)
    tuning = tuning or TUNING
    checked_controller(kind, load_tuning(tuning), CONTROL_RATE, 0.0)
    return [DemoCase(f'{kind.name} on the scene {scene}.', scene, None, name,
                     fitting_curve(kind, name, curve), tuning, duration, planner)]


def fitting_curve(robot: Robot, name: str, curve: Optional[str]) -> str:
    """Return a height curve for a robot: the given one, or a suitable shipped one."""
    tuning = load_decision_tuning(DECISION)
    if curve:
        check_decision(robot, load_curve(curve), tuning)
        return curve
    for file in shipped_files('curves'):
        try:
            check_decision(robot, load_curve(file.stem), tuning)
        except ConfigurationError:
            continue
        return file.stem
    raise ConfigurationError(
        f'there is no shipped height curve for the robot {name}; the decision needs one: fit '
        f'it with "ballbot fit-curve --robot {quote(name)} --actuation held --out my_curve.yaml", '
        'then give --curve my_curve.yaml', 'missing', '--curve')


def run_demo(out: Path, real_time: bool = False, quiet: bool = False, timeout: float = 60.0,
             cases: Sequence[DemoCase] = CASES, watched: bool = False) -> int:
    """
    Run the demo, two steps and a drop on a slope; return 0 if the robot acted as expected, or 1.

    Each case writes bag, picture and logs to a folder in `out`.  Nodes run in real time, or in
    lockstep at maximum speed or, if `watched` by viewers, at most in real time.  Cases in lockstep
    run at the same time, each on a separate ROS domain, unless the environment sets the domain.
    `quiet` prints only the verdict; `timeout` is the longest wall time without a new state [s].
    """
    prepare(('simulator', 'controller', 'decision'))  # before anything is waited for
    import_nodes(('simulator', 'controller', 'obstacle_decision'))
    together = len(cases) > 1 and not (real_time or watched or os.environ.get('ROS_DOMAIN_ID'))
    domains = [own_domain(number if together else 0) for number in range(len(cases))]
    if not quiet:
        print('Three nodes on ROS domain '
              f'{" and ".join(map(str, dict.fromkeys(domains)))}, '
              f'{lockstep_note(real_time, watched)}.', flush=True)

    def play(case: DemoCase, domain: int, folder: Path, timeline: Timeline) -> List[str]:
        simulator, controller = loop_parameters(
            {'scene': case.scene}, case.robot, case.tuning, 1.0 / TERRAIN_RATE, real_time, watched)
        decision = {'robot': case.robot, 'curve': case.curve, 'control_tuning': case.tuning,
                    'planner': case.planner}
        metadata = bag_metadata(
            SIMULATOR, simulator, load_scene(case.scene, case.robot), decision)
        with recorded_graph(
                folder, (*TOPICS, *TOOL_TOPICS), timeline,
                {'controller': controller, 'obstacle_decision': decision, 'simulator': simulator},
                metadata, domain) as graph:
            wrong = graph.run(
                run_simulator(graph.node, graph.bag, TOPICS, None if real_time or watched
                              else endless_advances(TOPICS, CONTROL_RATE)),
                timeout, case.longest, TOPICS)
        return wrong + check_bag(
            graph, STATES if real_time else {**STATES, **ANSWERS}, quiet)

    return max(in_processes([
        partial(run_case, out / Path(case.scene).stem, case, quiet, partial(play, case, domain))
        for case, domain in zip(cases, domains)], together))


def loop_parameters(ground: Mapping[str, str], robot: str, tuning: str, set_point_period: float,
                    real_time: bool, watched: bool) -> Tuple[Dict[str, Any], Dict[str, Any]]:
    """Return the parameters of simulator and controller, on a scene or floor; see `run_demo`."""
    return ({**ground, 'robot': robot, 'control_rate': CONTROL_RATE, 'lockstep': not real_time,
             'real_time_factor': 1.0 if real_time or watched else 0.0, 'start_paused': True},
            {'robot': robot, 'tuning': tuning, 'rate': CONTROL_RATE,
             'lockstep_set_point_period': 0.0 if real_time else set_point_period})


def lockstep_note(real_time: bool, watched: bool) -> str:
    """Return in words how the nodes are paced; see `run_demo`."""
    return 'in real time' if real_time else (
        f'in lockstep, {"at most in real time" if watched else "at maximum speed"}')


def in_processes(works: Sequence[Callable[[], int]], together: bool) -> List[int]:
    """
    Run cases in copies of this process, so that their nodes can be copies of it as well.

    Returns the exit codes.  The output of cases that run together is printed case by case.
    """
    processes: List[Forked] = []

    def start(work: Callable[[], int]) -> Tuple[Forked, List[BinaryIO]]:
        kept: List[BinaryIO] = [
            TemporaryFile() for _ in range(2)] if together and processes else []

        def child() -> int:
            signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent sends SIGTERM instead
            for number in ending_signals():
                signal.signal(number, lambda number, _: sys.exit(128 + number))
            for stream, file in enumerate(kept, start=1):  # standard output and error
                os.dup2(file.fileno(), stream)
            return work()
        processes.append(Forked(child))
        return processes[-1], kept

    codes = []
    try:
        started = map(start, works)
        for process, kept in list(started) if together else started:
            codes.append(process.wait())
            for stream, file in zip((sys.stdout, sys.stderr), kept):
                file.seek(0)
                print(file.read().decode(), end='', file=stream, flush=True)
    finally:
        for process in processes:
            process.send_signal(signal.SIGTERM)
        for process in processes:
            process.wait()
    return codes


def check_bag(graph: RecordedGraph, rates: Mapping[str, float], quiet: bool) -> List[str]:
    """
    Return the errors of the bag of a completed run; print a line if there are none.

    The bag must contain all messages of the topics with required rates [Hz].
    """
    states = graph.timeline.states
    if not states:
        return []
    # The replies to the last state may be missing.
    end = stamp_of(states[-1]) - round(1e9 / min(rates.values()))
    wrong, count = gaps(graph.bag.folder, graph.bag.recorded, rates, end)
    if not wrong and not quiet:
        print(f'\nbag: complete, {count:,} messages', flush=True)
    return wrong


def gaps(bag: Path, recorded: Mapping[str, Sequence[int]], rates: Mapping[str, float],
         end: int) -> Tuple[List[str], int]:
    """
    Return a sentence for each gap in a closed bag, and its number of messages.

    `recorded` has the stamps by topic [ns], where repeated ones count once; `rates` the required
    rates by topic [Hz], from time 0 to the stamp `end` [ns].
    """
    found = []
    for topic, rate in rates.items():
        wanted = range(0, end + 1, round(1e9 / rate))
        missing = sorted(set(wanted).difference(recorded.get(topic, ())))
        if missing:
            found.append(f'bag: {topic} lacks {len(missing)} of {len(wanted)} messages, the first '
                         f'of t = {1e-9 * missing[0]:.3f} s')
    with open(bag / 'metadata.yaml', encoding='utf-8') as file:
        count: int = yaml.safe_load(file)['rosbag2_bagfile_information']['message_count']
    written = sum(map(len, recorded.values()))
    if count != written:
        found.append(f'bag: {written} messages were recorded and {count} are in the file')
    return found, count


def passages_of(scene: Scene, expected: Optional[Sequence[Expected]] = None) -> List[Passage]:
    """Return the faces of a scene with rounded edges: the height of a carpet is its thickness."""
    faces = faces_of(scene.model.terrain, scene.model.robot.ball_radius)
    dues: Sequence[Optional[Expected]] = expected or [None] * len(faces)
    return [Passage(float(face[0, 0]), float(face[-1, 1] - face[0, 1]), float(face[-1, 1]), due)
            for face, due in zip(faces, dues)]


def run_case(out: Path, case: DemoCase, quiet: bool,
             play: Callable[[Path, Timeline], List[str]]) -> int:
    """Run a case with a scene and return the exit code; `play` takes folder and timeline."""
    scene = load_scene(case.scene, case.robot)
    marks: List[Mark] = []

    def report(when: float, word: str, sentence: str) -> None:
        decided = word in DECISION_NAMES.values() and word != 'CLEAR'
        if decided and [mark.word for mark in marks[-1:]] != [word]:
            ahead = timeline.passages[timeline.next_step:]
            step = ahead[0].x if ahead and word in ('CROSS', 'GO ROUND', 'BACK OFF') else None
            marks.append(Mark(when, word, word == 'CROSS', step))
        if not quiet:
            print_event(when, word, sentence)
    timeline = Timeline(passages_of(scene, case.expected), scene.model.robot, report)
    figure: Optional[Figure] = None
    start = announce(out, case.title, quiet)
    wrong = play(out, timeline)
    if timeline.states:
        if case.expected is not None:
            wrong = wrong + timeline.verdict()
        elif not quiet:
            print('\nResult:')
            for sentence in account(timeline):
                print(f'  - {sentence}')
        states = [(timeline.time_of(state), {name: getattr(state, name) for name in BALL_STATE})
                  for state in timeline.states]
        figure = strip(
            recorded_trajectory(scene.model, states), 'as published on ball_state', marks)
    return conclude(out, quiet, timeline, start, wrong, figure, 'crossing.png')


def announce(out: Path, title: str, quiet: bool) -> float:
    """Create the folder of a run, print its title, and return the time of its start [s]."""
    out.mkdir(parents=True, exist_ok=True)
    if not quiet:
        print(f'\n{title}\n', flush=True)
    return time.monotonic()


def conclude(out: Path, quiet: bool, timeline: Timeline, start: float, wrong: List[str],
             figure: Optional[Figure], picture: str) -> int:
    """
    Save the picture of a run, print its result, and return the exit code.

    `wrong` are the errors of the run, and the deviations of the robot from the expected actions.
    The figure, None for a run without states, is saved as `picture` in the folder `out`.
    """
    if figure is None:
        wrong = [*wrong, 'no state of the ball was received']
    else:
        save(figure, out / picture)
    simulated = timeline.now if timeline.states else 0.0
    if wrong or not quiet:
        print(f'\n{"FAILED" if wrong else "Done"}: {simulated:.1f} s of simulated time in '
              f'{time.monotonic() - start:.1f} s.  Picture: {out / picture}  Bag: {out / "bag"}',
              file=sys.stderr if quiet else sys.stdout)
    for sentence in wrong:
        print(f'  - {sentence}', file=sys.stderr)
    return 1 if wrong else 0


def print_event(when: float, mark: str, sentence: str) -> None:
    """Print one line of the timeline."""
    print(f'{when:7.2f} s  {mark:>9}  {sentence}', flush=True)
