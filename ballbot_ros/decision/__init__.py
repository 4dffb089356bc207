# SPDX-License-Identifier: Apache-2.0
"""Whether and how fast to cross the step ahead; no ROS, no clock."""
from ballbot_ros.decision.approach import approach_speed, set_angle
from ballbot_ros.decision.curve import HeightCurve, load_curve
from ballbot_ros.decision.planners import Planner, PLANNERS
from ballbot_ros.decision.planners.cubic import decide
from ballbot_ros.decision.tracker import StepTracker
from ballbot_ros.decision.tuning import check_decision, DecisionTuning, load_decision_tuning
from ballbot_ros.decision.values import (
    Decision, Kind, Motion, Reason, StepObservation, Track, TrackedStep)
from ballbot_ros.renamed import refuse_old_names

__all__ = [
    'approach_speed', 'check_decision', 'decide', 'Decision', 'DecisionTuning', 'HeightCurve',
    'Kind', 'load_curve', 'load_decision_tuning', 'Motion', 'Planner', 'PLANNERS', 'Reason',
    'set_angle', 'StepObservation', 'StepTracker', 'Track', 'TrackedStep']

refuse_old_names(globals())
