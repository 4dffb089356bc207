# SPDX-License-Identifier: Apache-2.0
"""
The table of the planners; each is a module.

For a further one copy `cubic.py`, change its class, and add a line to `PLANNERS`:
the parameter `planner` of the node ``obstacle_decision`` then takes its name.
"""
from typing import Callable, Mapping

from ballbot_ros.decision.planning.cubic import CubicPlanner
from ballbot_ros.decision.planning.rollout.planner import RolloutPlanner
from ballbot_ros.decision.planning.situation import Knowledge, Planner

PLANNERS: Mapping[str, Callable[[Knowledge], Planner]] = {
    'cubic': CubicPlanner, 'rollout': RolloutPlanner}
