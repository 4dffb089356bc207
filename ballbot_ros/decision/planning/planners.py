# SPDX-License-Identifier: Apache-2.0
"""
Table of the planners, one module each.

To add a planner, copy `cubic.py`, change its class, and add a line to `PLANNERS`:
the parameter `planner` of the node ``obstacle_decision`` then accepts its name.
"""
from typing import Callable, Mapping

from ballbot_ros.decision.planning.cubic import CubicPlanner
from ballbot_ros.decision.planning.rollout.planner import RolloutPlanner
from ballbot_ros.decision.planning.situation import Knowledge, Planner

PLANNERS: Mapping[str, Callable[[Knowledge], Planner]] = {
    'cubic': CubicPlanner, 'rollout': RolloutPlanner}
