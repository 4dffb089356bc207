# SPDX-License-Identifier: Apache-2.0
"""
Routes on floors that account for run-up; no ROS.

``RoutePlanner(floor, knowledge).route(start, goal)`` returns a `Route`.  `Knowledge` is the one of
the obstacle decision, whose rollouts determine which crossings succeed.
"""
from ballbot_ros.navigation.capability import Capability, CrossingPlan
from ballbot_ros.navigation.masks import write_masks
from ballbot_ros.navigation.route import Route, RoutePlanner, Segment

__all__ = ['Capability', 'CrossingPlan', 'Route', 'RoutePlanner', 'Segment', 'write_masks']
