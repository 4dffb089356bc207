# SPDX-License-Identifier: Apache-2.0
"""
Table of the planners, one module with a `Selector` each.

To add a planner, copy `cubic.py`, change its selector, and add a line to `PLANNERS`:
the parameter `planner` of the node ``obstacle_decision`` then accepts its name.
"""
from functools import partial
from typing import Callable, Mapping

from ballbot_ros.decision.planning.cubic import CurveSelector
from ballbot_ros.decision.planning.face_planner import FacePlanner
from ballbot_ros.decision.planning.rollout.planner import PlanSelector
from ballbot_ros.decision.planning.situation import Knowledge, Planner

PLANNERS: Mapping[str, Callable[[Knowledge], Planner]] = {
    'cubic': partial(FacePlanner, CurveSelector), 'rollout': partial(FacePlanner, PlanSelector)}
