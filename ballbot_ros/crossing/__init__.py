# SPDX-License-Identifier: Apache-2.0
"""
Crossings of a step: one attempt, the highest step, and the rules that both go by.

    >>> from ballbot_ros.crossing import max_step_height
    >>> from ballbot_ros.physics import load_robot
    >>> 0.017 < max_step_height(load_robot('gimball'), 0.6).height < 0.019
    True
"""
from ballbot_ros.crossing.max_step_height import (
    cruising, drive_for, max_step_height, max_step_heights, MaxStepHeight, rolling, try_step)
from ballbot_ros.crossing.rules import held_at, Rules, Site

__all__ = [
    'cruising', 'drive_for', 'held_at', 'max_step_height', 'max_step_heights', 'MaxStepHeight',
    'rolling', 'Rules', 'Site', 'try_step']
