# SPDX-License-Identifier: Apache-2.0
"""
Floors: maps with steps, thresholds, carpets and drops; no ROS.

    >>> floor = load_floor('apartment')
    >>> [feature.label for feature in floor.features][2]
    'bedroom step'
"""
from ballbot_ros.floors.floor import Feature, Floor, load_floor, read_map

__all__ = ['Feature', 'Floor', 'load_floor', 'read_map']
