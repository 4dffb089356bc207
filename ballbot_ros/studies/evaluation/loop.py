# SPDX-License-Identifier: Apache-2.0
"""One approach in closed loop, the decision as the node ``obstacle_decision`` uses it."""
from dataclasses import replace
from time import thread_time
from typing import Any, Callable, Dict, List, Optional, Tuple

from ballbot_ros.control.tuning import ControlTuning, load_tuning
from ballbot_ros.decision import (
    check_decision, Decider, Decision, Knowledge, load_curve, load_decision_tuning, Motion)
from ballbot_ros.errors import SimulationError
from ballbot_ros.physics.model.robot import load_robot, Robot
from ballbot_ros.physics.model.state import State
from ballbot_ros.studies.evaluation.approaches import Approach, balanced_angle
from ballbot_ros.studies.evaluation.closed_loop import ClosedLoop
from ballbot_ros.studies.evaluation.judge import Judge
from ballbot_ros.studies.evaluation.rules import RULES
from ballbot_ros.studies.evaluation.sensors import Looks

TICK = 10        # control periods between two observations
ODOMETRY = 5     # between two odometry messages
LONGEST = 16.0   # [s]
NEWS = 0.3       # so long a change of mind may follow news [s]

# What is told of each decision: time, state, decision, set angle.
Listener = Callable[[float, State, Decision, float, Decider], None]


class Believer:
    """
    What the decision believes: the nominal robot, curve and tuning; made once.

    Parameters
    ----------
    robot, curve, tuning, gains : str
        Names or files.
    changes : mapping, optional
        Other values of the tuning.

    """

    def __init__(self, robot: str = 'gimball', curve: str = 'gimball_down',
                 tuning: str = 'decision_default', gains: str = 'published',
                 **changes: Any):
        """Load and check."""
        self.names = robot, gains
        self.robot: Robot = load_robot(robot)
        self.curve = load_curve(curve)
        self.tuning = replace(load_decision_tuning(tuning), **changes)
        self.gains: ControlTuning = load_tuning(gains)
        check_decision(self.robot, self.curve, self.tuning)

    def knowledge(self, approach: Approach) -> Knowledge:
        """Return what the decision knows before an approach."""
        return Knowledge(self.robot, self.curve,
                         replace(self.tuning, room_behind=approach.room_behind), self.gains,
                         approach.number)


class ChangesOfMind:
    """Counts changes of kind or strategy that follow no news."""

    def __init__(self) -> None:
        """Start before the first decision."""
        self.count = 0
        self._last: Optional[Tuple[object, object]] = None
        self._known = 0

    def note(self, now: float, decision: Decision, judge: Judge, decider: Decider) -> None:
        """Take the decision of a time [s]."""
        seen = decider.profile.faces if decider.profile else ()
        known = max((face.number for face in seen), default=0)
        if known > self._known:
            self._known, judge.news = known, now
        mind = (decision.kind, decision.plan.strategy if decision.plan else None)
        if self._last is not None and mind != self._last and now > judge.news + NEWS:
            self.count += 1
        self._last = mind


def about(approach: Approach, planner: str) -> Dict[str, Any]:
    """Return what a row says of an approach before it is run."""
    ground = approach.ground
    return {'number': approach.number, 'seed': approach.seed, 'planner': planner,
            'kind': ground.kind, 'words': ground.words, 'slope': ground.slope,
            'sensor': approach.flaws.kind, 'friction': approach.robot.surface_friction,
            'latency': approach.flaws.faults.latency, 'foot': ground.foot,
            'room_behind': approach.room_behind}


def run_approach(approach: Approach, planner: str, believer: Believer,
                 listener: Optional[Listener] = None) -> Dict[str, Any]:
    """
    Run an approach to its end.

    Parameters
    ----------
    approach : Approach
    planner : str
    believer : Believer
    listener : callable, optional
        Told each decision.

    Returns
    -------
    dict
        What the report counts; JSON takes it.

    """
    ground = approach.ground
    loop = ClosedLoop(approach.robot, ground.terrain, believer.robot, believer.gains,
                      approach.speed, balanced_angle(approach.robot, ground.slope))
    knowledge = believer.knowledge(approach)
    decider = Decider(knowledge, RULES.get(planner, planner))
    looks = Looks(ground.terrain, approach.flaws, approach.number)
    judge, minds = Judge(approach, loop, knowledge.tuning), ChangesOfMind()
    spent: List[float] = []
    failure = ''
    state = loop.state
    try:
        for number in range(round(LONGEST / (TICK * 0.002))):
            now = loop.time
            looks.look(number, now, state.x, state.y)
            begin = thread_time()
            decider.move(Motion(now, state.x, state.velocity_x))
            for observation in looks.arrived(now):
                decider.observe(observation)
            answer = decider.decide()
            spent.append(thread_time() - begin)
            if listener is not None:
                listener(now, state, answer.decision, answer.set_angle, decider)
            minds.note(now, answer.decision, judge, decider)
            loop.advance(answer.set_angle, ODOMETRY)
            middle = loop.state
            decider.move(Motion(loop.time, middle.x, middle.velocity_x))
            loop.advance(answer.set_angle, TICK - ODOMETRY)
            state = loop.state
            if judge.look(now, answer.decision):
                break
        else:
            judge.finish(state)
    except SimulationError as error:
        failure = str(error)
    judge.verdict.changes = minds.count
    return {**about(approach, planner), **judge.verdict.row, 'failure': failure,
            'mean_ms': 1e3 * sum(spent) / max(len(spent), 1),
            'first_ms': 1e3 * spent[0] if spent else 0.0,
            'decisions': len(spent)}
