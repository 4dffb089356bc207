# SPDX-License-Identifier: Apache-2.0
"""One approach in closed loop, with the decision as the node ``obstacle_decision`` uses it."""
from dataclasses import asdict, replace
import math
from time import thread_time
from typing import Any, Callable, Dict, List, Optional, Tuple

from ballbot_ros.decision import (
    Decider, Decision, Kind, Knowledge, Motion)
from ballbot_ros.decision.values import REST_SPEED_MAX
from ballbot_ros.errors import SimulationError
from ballbot_ros.physics.model.state import State
from ballbot_ros.results.summary import plain
from ballbot_ros.studies.evaluation.approaches import Approach
from ballbot_ros.studies.evaluation.baselines import BASELINES
from ballbot_ros.studies.evaluation.closed_loop import balanced_angle, ClosedLoop, PERIOD
from ballbot_ros.studies.evaluation.outcome import OutcomeMonitor, SAME_FACE
from ballbot_ros.studies.evaluation.sensors import SimulatedSensor
from ballbot_ros.studies.evaluation.terrains import true_faces

OBSERVATION_PERIODS = 10  # control periods between two observations
ODOMETRY_PERIODS = 5      # between two odometry messages
APPROACH_TIME_MAX = 30.0         # time limit without the time for a long obstacle [s]
SLOWEST = 0.2             # average speed that the time limit allows over a long obstacle [m/s]
REACTION_TIME = 0.3           # a decision may change for this time after new information [s]
ARRIVED = 0.05  # largest distance from the start of the run-up after arrival there [m]

# Called with time, state, decision, set angle and decider.
Listener = Callable[[float, State, Decision, float, Decider], None]


class DecisionChanges:
    """
    Counts changes of kind or strategy without new information.

    New information is an event of the `OutcomeMonitor`, the first observation, a new face, or the
    arrival at a position where a plan changes its action: the start of its run-up, as soon as the
    ball rests there, or its last edge.
    """

    def __init__(self) -> None:
        self.count = 0
        self._last: Optional[Tuple[object, object]] = None
        self._known = -1
        self._target: Optional[Tuple[float, float]] = None  # direction, and position [m]
        self._reached: Optional[Tuple[float, float]] = None

    def update(self, now: float, decision: Decision, monitor: OutcomeMonitor,
               decider: Decider) -> None:
        """Process the decision at a time [s]."""
        profile, motion, plan = decider.profile, decider.motion, decision.plan
        known = -1 if profile is None else max(
            (face.number for face in profile.faces), default=0)
        if known > self._known:
            self._known, monitor.last_event = known, now
        if motion is not None and self._arrives(motion):
            monitor.last_event = now
        selected = decision.kind, plan.strategy
        if (self._last is not None and selected != self._last
                and now > monitor.last_event + REACTION_TIME):
            self.count += 1
        self._last = selected
        self._target = (
            (1.0, plan.edge) if decision.kind is Kind.CROSS else
            (-1.0, plan.start + ARRIVED) if decision.kind is Kind.BACK_OFF else None)

    def _arrives(self, motion: Motion) -> bool:
        """Return whether the ball reaches the start or last edge of its plan; once for each."""
        if self._target is None or self._target[0] * (motion.position - self._target[1]) < 0.0 \
                or self._target[0] < 0.0 and motion.speed < -REST_SPEED_MAX:
            return False
        again = self._reached is not None and self._reached[0] == self._target[0] \
            and abs(self._reached[1] - self._target[1]) < SAME_FACE
        self._reached = self._target
        return not again


def heading(approach: Approach, planner: str) -> Dict[str, Any]:
    """Return the values of a row that are known before the approach is run."""
    ground, sensor = approach.ground, approach.sensor
    return {'number': approach.number, 'seed': approach.seed, 'planner': planner,
            'kind': ground.kind, 'description': ground.description, 'slope': ground.slope,
            'sensor': sensor.kind, 'condition': sensor.condition,
            'friction': approach.robot.surface_friction, 'latency': sensor.faults.latency,
            'foot': ground.foot, 'crossable': math.isfinite(ground.goal),
            'room_behind': approach.room_behind, 'unseen_room': approach.unseen_room}


def run_approach(approach: Approach, planner: str, nominal: Knowledge,
                 listener: Optional[Listener] = None) -> Dict[str, Any]:
    """
    Run an approach to its end, and return a row of the report, of JSON values.

    The listener is called with each decision.
    """
    ground = approach.ground
    loop = ClosedLoop(approach.robot, ground.terrain, nominal.robot, nominal.control,
                      approach.speed, balanced_angle(approach.robot, ground.slope))
    knowledge = replace(nominal, seed=approach.number, tuning=replace(
        nominal.tuning, room_behind=approach.room_behind, unseen_room=approach.unseen_room))
    decider = Decider(knowledge, BASELINES.get(planner, planner))
    sensor = SimulatedSensor(ground.terrain, approach.sensor, approach.number)
    monitor = OutcomeMonitor(approach, loop, knowledge.tuning)
    changes = DecisionChanges()
    spent: List[float] = []
    failure, start = '', thread_time()
    state = loop.state
    length = ground.goal - ground.foot if math.isfinite(ground.goal) else 0.0
    limit = APPROACH_TIME_MAX + length / SLOWEST
    try:
        for number in range(round(limit / (OBSERVATION_PERIODS * PERIOD))):
            now = loop.time
            sensor.sample(number, now, state.x, state.y)
            begin = thread_time()
            decider.move(Motion(now, state.x, state.velocity_x))
            for observation in sensor.arrived(now):
                decider.observe(observation)
            answer = decider.decide()
            spent.append(thread_time() - begin)
            if listener is not None:
                listener(now, state, answer.decision, answer.set_angle, decider)
            changes.update(now, answer.decision, monitor, decider)
            loop.advance(answer.set_angle, ODOMETRY_PERIODS)
            middle = loop.state
            decider.move(Motion(loop.time, middle.x, middle.velocity_x))
            loop.advance(answer.set_angle, OBSERVATION_PERIODS - ODOMETRY_PERIODS)
            state = loop.state
            if monitor.update(now, answer.decision):
                break
        else:
            monitor.finish(state)
    except SimulationError as error:
        failure = str(error)
    monitor.verdict.changes = changes.count
    return {**heading(approach, planner), **plain(asdict(monitor.verdict)),
            'failure': failure,
            'mean_ms': 1e3 * sum(spent) / max(len(spent), 1),
            'worst_ms': 1e3 * max(spent, default=0.0),
            'decisions': len(spent), 'cpu_s': thread_time() - start}


class DecisionLog:
    """Collects a line for each change of the decision, and at intervals [s] between changes."""

    def __init__(self, every: float):
        self.lines: List[str] = []
        self._every, self._due = every, 0.0
        self._last: Optional[Tuple[Any, ...]] = None

    def update(self, now: float, state: State, decision: Decision, set_angle: float,
               decider: Decider) -> None:
        """Log the decision at a time; see `Listener`."""
        plan, outlook = decision.plan, decision.outlook
        selected = decision.kind, decision.reason, plan.strategy
        if selected == self._last and now < self._due - 1e-9:
            return
        self._last, self._due = selected, now + self._every
        profile = decider.profile
        observed = ', '.join(
            f'{1e3 * face.height:+.1f}({1e3 * face.height_sd:.1f}) mm at '
            f'{face.position:.3f}({1e3 * face.position_sd:.0f} mm)' for face in (
                profile.faces if profile else ()))
        if profile and profile.rejection:
            observed += f' [{profile.rejection.value}: {profile.explanation}]'
        if profile and math.isfinite(profile.slope):
            observed += f' slope {math.degrees(profile.slope):+.1f} deg'
        text = (f'{now:6.2f} s  x {state.x:+.3f} m  v {state.velocity_x:+.3f} m/s  pendulum '
                f'{math.degrees(state.pendulum_angle):+4.0f} -> {math.degrees(set_angle):+4.0f} '
                f'deg  {decision.kind.value}/{decision.reason.value}: {decision.explanation}')
        text += (f'\n          plan {plan.strategy.value}: from {plan.start:.2f} m at '
                 f'{plan.speed:.2f} m/s, swing {math.degrees(plan.swing_angle):.0f} deg at '
                 f'{plan.swing_position:.2f} m, edge {plan.edge:.2f} m, then '
                 f'{plan.after.value}, stand at {plan.stop_position:.2f} m')
        if not math.isnan(outlook.required):
            text += (f'\n          over {outlook.probability:.3f} stuck {outlook.stuck:.3f} falls '
                     f'{outlook.falls:.3f} touch {outlook.touch_speed:.2f} m/s, '
                     f'{outlook.attempts} attempts; braking room {outlook.braking_room:.2f} m')
        self.lines.append(text + (f'\n          observed {observed}' if observed else ''))


def _number(value: Optional[float]) -> str:
    return '-' if value is None else f'{value:.3f}'


def run_with_log(approach: Approach, planner: str, nominal: Knowledge,
                 every: float) -> Tuple[List[str], Dict[str, Any]]:
    """Run one approach; return lines with its decisions, see `DecisionLog`, and the row."""
    log = DecisionLog(every)
    row = run_approach(approach, planner, nominal, log.update)
    faces = '; '.join(f'{1e3 * height:+.1f} mm at {left:.3f} m' for left, _, _, height in
                      true_faces(approach.ground.terrain))
    ending = [f'{row["outcome"]} at {row["time"]:.2f} s, x {row["x"]:.3f} m, gap '
              f'{_number(row["gap"])} m, hit at {row["hit_speed"]:.2f} m/s, {row["changes"]} '
              f'decision changes; {row["decisions"]} decisions of {row["mean_ms"]:.2f} ms']
    ending += [
        f'attempt at {one["time"]:.2f} s on {one["face"]:.3f} m: {one["strategy"] or planner} at '
        f'{one["speed"]:.2f} m/s, predicted {_number(one["probability"])}, '
        + ('over' if one['over'] else 'not over') + (', same plan again' if one['same'] else '')
        for one in row['attempts']]
    if row['failure']:
        ending.append(row['failure'])
    return [approach.description, f'true faces: {faces or "none"}', *log.lines, *ending], row
