# SPDX-License-Identifier: Apache-2.0
"""The parameters of the node: name, unit, range, default and meaning."""
from dataclasses import dataclass

from ballbot_ros.config.fields import fixed, flag, live, text
from ballbot_ros.decision import DecisionTuning, load_decision_tuning
from ballbot_ros.decision.planning.planners import PLANNERS
from ballbot_ros.ros.frames import marked
from ballbot_ros.ros.settings import file_in, numbers_in, Settings


@dataclass(frozen=True)
class DecisionSettings(Settings):
    """Parameters of the node ``obstacle_decision``."""

    robot: str = fixed('what was learned rests on it', file_in('robots', 'gimball'))
    curve: str = live(file_in('curves', 'gimball_down', 'height curve'))
    variant: str = live(text(
        'which cubic of the curve: the best fit, or one that is nowhere above the simulation',
        default='fit', choices=('fit', 'conservative')))
    tuning: str = live(file_in('tunings', 'decision_default', 'decision tuning'))
    control_tuning: str = live(file_in(
        'tunings', 'published', doc=': that of the laws that drive'))
    outcome_log: str = fixed('it is read, and learned from, at the start', text(
        'file that keeps what came of each attempt, and is learned from at the start; empty for '
        'none', default=''))
    terrain_frame: str = fixed('the ground seen so far is in it', text(
        'frame in which terrain_observation must be: level, at the centre of the ball, and not '
        'rolling', default='base_link'))
    planner: str = fixed('what it calls is compiled at the start', text(
        'how decisions are made', default='rollout', choices=tuple(PLANNERS)))
    publish_markers: bool = marked('the step ahead, the height that is allowed and the words')
    wait_for_goal: bool = fixed('a goal, or ~/resume, ends the waiting', flag(
        'stand until there is a goal, or ~/resume is called', default=False))
    margins: DecisionTuning = numbers_in('tuning', DecisionTuning, load_decision_tuning)
