# SPDX-License-Identifier: Apache-2.0
"""The parameters of the node: name, unit, range, default and meaning."""
from dataclasses import dataclass

from ballbot_ros.config.fields import fixed, flag, live, text
from ballbot_ros.decision import DecisionTuning, load_decision_tuning
from ballbot_ros.decision.planning.planners import PLANNERS
from ballbot_ros.ros.frames import FRAMES, marked
from ballbot_ros.ros.settings import file_in, numbers_in, Settings


@dataclass(frozen=True)
class DecisionSettings(Settings):
    """Parameters of the node ``obstacle_decision``."""

    robot: str = fixed('the learned parameters depend on it', file_in('robots', 'gimball'))
    curve: str = live(file_in('curves', 'gimball_down', 'height curve'))
    variant: str = live(text(
        'cubic of the curve: the best fit, or one that is nowhere above the simulation',
        default='fit', choices=('fit', 'conservative')))
    tuning: str = live(file_in('decision_tunings', 'decision_default', 'decision tuning'))
    control_tuning: str = live(file_in(
        'tunings', 'published', doc=': gains of the control laws'))
    outcome_log: str = fixed('it is read at the start', text(
        'log of the outcome of each attempt, from which the node learns at the start; empty for '
        'none', default=''))
    terrain_frame: str = fixed('the terrain map is expressed in it', text(
        'required frame of terrain_observation: level, at the centre of the ball, and not '
        'rolling', default=FRAMES.base))
    planner: str = fixed('its kernels are compiled at the start', text(
        'planning method', default='rollout', choices=tuple(PLANNERS)))
    publish_markers: bool = marked('the step ahead, the permitted height and the explanation')
    wait_for_goal: bool = fixed('a goal, or ~/resume, ends the waiting', flag(
        'rest until a goal arrives, or ~/resume is called', default=False))
    margins: DecisionTuning = numbers_in('tuning', DecisionTuning, load_decision_tuning)
