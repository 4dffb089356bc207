# SPDX-License-Identifier: Apache-2.0
"""
Decide whether and how fast to cross the step ahead, without ROS and without a clock.

A height curve gives the maximum step height at a collision speed, and the speed for a height:

    >>> curve = load_curve('gimball_down')
    >>> 0.030 < curve.height(0.8) < 0.032
    True
    >>> round(curve.height(curve.required_speed(0.02)), 6)
    0.02

A `Decider` takes observations and odometry, and decides; ``examples/closed_loop.py`` closes the
loop around it:

    >>> from ballbot_ros.physics import load_robot
    >>> margins = load_decision_tuning('decision_default')
    >>> decider = Decider(Knowledge(load_robot('gimball'), curve, margins), planner='cubic')
    >>> decider.move(Motion(0.0, position=0.0, speed=0.3))
    >>> decider.decide().decision.kind.name
    'STOP'
"""
from ballbot_ros.decision.decider import Answer, Decider
from ballbot_ros.decision.execution.goals import (
    CrossGoal, DriveGoal, Ending, GoalEnd, Goals, Phase)
from ballbot_ros.decision.execution.pilot import Pilot
from ballbot_ros.decision.perception import Observation, ProfileTracker
from ballbot_ros.decision.planning.curve import HeightCurve, load_curve
from ballbot_ros.decision.planning.planners import PLANNERS
from ballbot_ros.decision.planning.situation import (
    Knowledge, nominal_knowledge, Planner, Situation)
from ballbot_ros.decision.tuning import check_decision, DecisionTuning, load_decision_tuning
from ballbot_ros.decision.values import (
    After, Decision, Face, Failure, Kind, Motion, Outlook, Plan, Profile, Reason, StepObservation,
    Strategy, TerrainObservation)

__all__ = [
    'After', 'Answer', 'check_decision', 'CrossGoal', 'Decider', 'Decision',
    'DecisionTuning', 'DriveGoal', 'Ending', 'Face', 'Failure', 'GoalEnd', 'Goals',
    'HeightCurve', 'Kind', 'Knowledge', 'load_curve', 'load_decision_tuning', 'Motion',
    'nominal_knowledge', 'Observation', 'Outlook', 'Phase', 'Pilot', 'Plan', 'Planner',
    'PLANNERS', 'Profile', 'ProfileTracker', 'Reason', 'Situation',
    'StepObservation', 'Strategy', 'TerrainObservation']
