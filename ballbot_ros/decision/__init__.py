# SPDX-License-Identifier: Apache-2.0
"""Whether and how fast to cross the step ahead; no ROS, no clock."""
from ballbot_ros.decision.approach import lean, wanted_speed
from ballbot_ros.decision.curve import HeightCurve, load_curve
from ballbot_ros.decision.planners import Planner, PLANNERS
from ballbot_ros.decision.planners.cubic import decide
from ballbot_ros.decision.tracker import StepTracker
from ballbot_ros.decision.tuning import check_decision, DecisionTuning, load_decision_tuning
from ballbot_ros.decision.values import (
    Decision, Kind, Motion, Reason, Sighting, StepObservation, TrackedStep)

__all__ = [
    'check_decision', 'decide', 'Decision', 'DecisionTuning', 'HeightCurve', 'Kind', 'lean',
    'load_curve', 'load_decision_tuning', 'Motion', 'Planner', 'PLANNERS', 'Reason', 'Sighting',
    'StepObservation', 'StepTracker', 'TrackedStep', 'wanted_speed']
