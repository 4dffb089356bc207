# SPDX-License-Identifier: Apache-2.0
"""
Crossings of a step: a single attempt, the maximum step height, and the rules of both.

Whether a ball crosses a step, and with which margin:

    >>> from ballbot_ros.physics import Actuation, load_robot
    >>> gimball = load_robot('gimball')
    >>> over, score = try_step(gimball, speed=0.6, height=0.015)
    >>> over, score > 0.0
    (True, True)

The maximum step height, within an error bound:

    >>> found = max_step_height(gimball, 0.6)
    >>> isinstance(found, MaxStepHeight), 0.019 < found.height < 0.021, found.error <= 5e-5
    (True, True, True)

With the pendulum held level by law (11), on other terrain, or with repeated attempts:

    >>> max_step_height(gimball, 0.6, held_at(1.57)).height > found.height + 0.01
    True
    >>> max_step_height(gimball, 0.6, site=Site(slope_before=0.1)).height < found.height
    True
    >>> max_step_height(gimball, 0.6, rules=Rules(attempts='any')).height >= found.height
    True

At several speeds, each with its own actuation: law (12) or the voltage that rolls the ball at
that speed, or the one that matches the law of an actuation:

    >>> [item.height > 0.0 for item in max_step_heights(gimball, [0.4, 0.8], rolling(gimball))]
    [True, True]
    >>> 3.0 < cruising(gimball)(0.6).voltage < 6.0
    True
    >>> actuation_for(gimball, Actuation('velocity'))(0.6) == rolling(gimball)(0.6)
    True
"""
from ballbot_ros.crossing.max_step_height import (
    actuation_for, cruising, max_step_height, max_step_heights, MaxStepHeight, rolling, try_step)
from ballbot_ros.crossing.rules import held_at, Rules, Site

__all__ = [
    'actuation_for', 'cruising', 'held_at', 'max_step_height', 'max_step_heights',
    'MaxStepHeight', 'rolling', 'Rules', 'Site', 'try_step']
