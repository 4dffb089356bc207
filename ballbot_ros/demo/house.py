# SPDX-License-Identifier: Apache-2.0
"""The demo on a floor: the navigator drives from room to room, over thresholds and a step."""
from itertools import zip_longest
import math
from pathlib import Path
from typing import Any, Callable, List, NamedTuple, Optional, Sequence, Tuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from matplotlib.figure import Figure
from nav_msgs.msg import Path as Plan
from rclpy.action import ActionClient
from rclpy.node import Node

from ballbot_ros.bags.metadata import bag_metadata, SIMULATOR
from ballbot_ros.control import load_tuning
from ballbot_ros.decision import Knowledge, load_curve, load_decision_tuning
from ballbot_ros.demo.demo import (
    announce, ANSWERS, check_bag, conclude, CONTROL_RATE, DECISION, fitting_curve, in_processes,
    lockstep_note, loop_parameters, print_event, ROBOT, STATES, TOOL_TOPICS, TUNING)
from ballbot_ros.demo.forked import import_nodes
from ballbot_ros.demo.prepare import prepare
from ballbot_ros.demo.processes import own_domain
from ballbot_ros.demo.recorded_graph import (
    Actions, endless_advances, recorded_graph, run_simulator)
from ballbot_ros.demo.timeline import Timeline
from ballbot_ros.figures.route import driven_figure
from ballbot_ros.floors import Floor, load_floor
from ballbot_ros.floors.floor import Point
from ballbot_ros.floors.profile import crossed
from ballbot_ros.msg import BallState
from ballbot_ros.navigation import RoutePlanner
from ballbot_ros.nodes.navigator.goals import NavigateToPose
from ballbot_ros.nodes.navigator.node import PERIOD
from ballbot_ros.nodes.navigator.outputs import stamped_pose
from ballbot_ros.nodes.simulator.settings import SimulatorSettings
from ballbot_ros.physics import Robot
from ballbot_ros.physics.model.robot import load_robot
from ballbot_ros.ros.conversions import to_time
from ballbot_ros.ros.endpoints import create_subscription
from ballbot_ros.steering.model import moved_to

DURATION_MAX = 300.0  # end of the run, in simulated time [s]
# Required rates [Hz]: the navigator publishes commands only while it has a goal.
RATES = {**STATES, 'scan': SimulatorSettings.scan_rate}
LOCKSTEP_RATES = {**RATES, 'joint_commands': ANSWERS['joint_commands']}
OTHER_TOPICS = ('cmd_vel', 'set_point', 'plan', 'map')


class Visit(NamedTuple):
    """A room and a position in it [m]."""

    room: str
    x: float
    y: float


FLOOR, START = 'apartment', (1.7, 1.4, 0.5 * math.pi)
TOUR = (Visit('bedroom', 5.5, 5.5), Visit('bathroom', 8.1, 5.5))


def run_house_demo(out: Path, real_time: bool = False, quiet: bool = False, timeout: float = 60.0,
                   longest: Optional[float] = None, watched: bool = False,
                   robot: Optional[str] = None, curve: Optional[str] = None,
                   goals: Sequence[Sequence[float]] = ()) -> int:
    """
    Drive through the shipped flat with the navigator; return 0 if it reached every room, or 1.

    `longest` is the end of the run in simulated time [s]; `goals` are positions to drive to
    instead of those of `TOUR` [m]; see `run_demo` for the other parameters.  Raises
    `ConfigurationError` if a file is not valid, or the curve is of another robot, and
    `RefusedError` if the ball cannot be at a goal.
    """
    floor, robot = load_floor(FLOOR), robot or ROBOT
    ball, tour = load_robot(robot), [Visit('room', x, y) for x, y in goals] or TOUR
    curve = fitting_curve(ball, robot, curve)
    planner = RoutePlanner(floor, Knowledge(
        ball, load_curve(curve), load_decision_tuning(DECISION), load_tuning(TUNING)))
    for visit in tour:
        planner.check_goal(visit[1:])
    prepare(('simulator', 'controller', 'decision'))
    planner.warm_up()
    import_nodes(('simulator', 'controller', 'navigator'))
    domain = own_domain()
    if not quiet:
        print(f'Three nodes on ROS domain {domain}, {lockstep_note(real_time, watched)}.',
              flush=True)
    timeline = HouseTimeline(floor, ball, START, (
        lambda *_: None) if quiet else print_event)
    arrived: List[Visit] = []

    def drive() -> int:
        rates = RATES if real_time else LOCKSTEP_RATES
        simulator, controller = loop_parameters(
            {'floor': FLOOR, 'start': ','.join(map(str, START))}, robot, TUNING, PERIOD,
            real_time, watched)
        navigator = {'floor': FLOOR, 'robot': robot, 'control_tuning': TUNING, 'curve': curve}
        start = announce(out, 'The ball drives from the kitchen to the '
                         f'{" and the ".join(visit.room for visit in tour)}.', quiet)
        with recorded_graph(
                out, (*LOCKSTEP_RATES, *OTHER_TOPICS, *TOOL_TOPICS), timeline,
                {'controller': controller, 'navigator': navigator, 'simulator': simulator},
                bag_metadata(SIMULATOR, simulator), domain) as graph:
            both = zip_longest(
                run_simulator(graph.node, graph.bag, rates, None if real_time or watched
                              else endless_advances(rates, CONTROL_RATE)),
                drive_tour(graph.node, timeline, tour, arrived))
            wrong = graph.run((stopped or ended for stopped, ended in both), timeout,
                              longest or DURATION_MAX, tuple(STATES))
        wrong += check_bag(graph, rates, quiet)
        figure: Optional[Figure] = None
        if timeline.states:
            wrong += [f'the {visit.room} was not reached' for visit in tour[len(arrived):]]
            figure = driven_figure(
                floor, f'{floor.name}: {timeline.now:.0f} s', timeline.plans, timeline.driven,
                [visit[1:] for visit in tour], ball.ball_radius)
        return conclude(out, quiet, timeline, start, wrong, figure, 'house.png')
    return max(in_processes([drive], False))


class HouseTimeline(Timeline):
    """
    Detects on a floor which steps, thresholds and cords the ball has crossed; see `Timeline`.

    `start` is the pose of the frame odom on the map [m], [rad].
    """

    def __init__(self, floor: Floor, robot: Robot, start: Tuple[float, float, float],
                 report: Callable[[float, str, str], None]):
        super().__init__([], robot, report)
        self._floor, self._start = floor, start
        self.driven: List[Point] = []  # positions on the map [m]
        self.plans: List[List[Point]] = []  # published by the navigator [m]

    def add_state(self, message: BallState) -> None:
        """Process a state; report crossed lines."""
        x, y, heading = self._start
        point = moved_to((x, y), heading, message.position_x, message.position_y)
        before = self.driven[-1] if self.driven else point
        self.states.append(message)
        self.driven.append(point)
        for feature, _ in crossed(self._floor, before, point):
            self.note('crosses', f'the {feature.label}, {1e3 * feature.height:.0f} mm high, at '
                      f'{abs(message.velocity_x):.2f} m/s')

    def add_plan(self, message: Plan) -> None:
        """Process a path of the navigator."""
        points = [(pose.pose.position.x, pose.pose.position.y) for pose in message.poses]
        if len(points) < 2:
            return
        self.plans.append(points)
        pieces = list(zip(points, points[1:]))
        names = [feature.label for piece in pieces for feature, _ in crossed(self._floor, *piece)]
        self.note('plans', f'{sum(map(math.dist, points, points[1:])):.1f} m'
                  f'{" over the " if names else ""}{", the ".join(names)}')

    def note(self, word: str, sentence: str) -> None:
        """Report an event at the current time."""
        self._report(max(self.now, 0.0), word, sentence)


def drive_tour(node: Node, timeline: HouseTimeline, tour: Sequence[Visit],
               arrived: List[Visit]) -> Actions:
    """
    Send the goals of a tour to the navigator, one after the other.

    Reached goals are appended to `arrived`.
    """
    ready = False

    def take_health(message: DiagnosticArray) -> None:
        nonlocal ready
        ready = ready or any(
            status.name.startswith('navigator:') and status.level == DiagnosticStatus.OK
            for status in message.status)

    create_subscription(node, '/diagnostics', take_health)
    create_subscription(node, 'plan', timeline.add_plan)
    client = ActionClient(node, NavigateToPose, 'navigate_to_pose')
    for visit in tour:
        while not (ready and client.server_is_ready()):
            yield None
        sent = client.send_goal_async(NavigateToPose.Goal(
            pose=stamped_pose('map', to_time(0.0), visit.x, visit.y, 0.0)))
        while not sent.done():
            yield None
        if not sent.result().accepted:
            yield f'the navigator has refused the {visit.room} as a goal, see its log'
        timeline.note('goal', f'the {visit.room}, ({visit.x:g}, {visit.y:g})')
        ended = sent.result().get_result_async()
        while not ended.done():
            yield None
        result: Any = ended.result().result
        if result.error_code:
            yield f'the navigator has ended the goal: {result.error_msg}'
        arrived.append(visit)
        away = math.dist(timeline.driven[-1], visit[1:])
        timeline.note('arrives', f'in the {visit.room}, {away:.2f} m from the goal')
    timeline.rested = timeline.now
