# SPDX-License-Identifier: Apache-2.0
"""
Floors: maps with steps, thresholds, carpets and drops; no ROS.

    >>> floor = load_floor('apartment')
    >>> [feature.label for feature in floor.features][2]
    'bedroom step'

`cut` returns the ground along a line over a floor:

    >>> cut(floor, place=(5.5, 1.0), heading=1.5707963267948966).edges[0].height
    0.045
"""
from ballbot_ros.floors.floor import Feature, Floor, load_floor, read_map
from ballbot_ros.floors.levels import level
from ballbot_ros.floors.profile import Cut, cut, Edge, ranges

__all__ = ['cut', 'Cut', 'Edge', 'Feature', 'Floor', 'level', 'load_floor', 'ranges', 'read_map']
