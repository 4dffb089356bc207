# SPDX-License-Identifier: Apache-2.0
"""
Floors, and routes on them that account for run-up; no ROS.

    >>> floor = load_floor('apartment')
    >>> [feature.label for feature in floor.features][2]
    'bedroom step'

``RoutePlanner(floor, knowledge).route(start, goal)`` returns a `Route`; `Knowledge` is that of the
obstacle decision, whose rollouts say which crossings succeed.
"""
from ballbot_ros.navigation.capability import Capability, CrossingPlan
from ballbot_ros.navigation.floor import Feature, Floor, load_floor, read_map
from ballbot_ros.navigation.masks import write_masks
from ballbot_ros.navigation.route import Route, RoutePlanner, Segment

__all__ = ['Capability', 'CrossingPlan', 'Feature', 'Floor', 'load_floor', 'read_map', 'Route',
           'RoutePlanner', 'Segment', 'write_masks']
