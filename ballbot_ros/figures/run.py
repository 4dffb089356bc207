# SPDX-License-Identifier: Apache-2.0
"""Figures of a run; no display is needed."""
from ballbot_ros.figures.animation import animate, check_animation
from ballbot_ros.figures.canvas import FORMATS, save
from ballbot_ros.figures.film import strip
from ballbot_ros.figures.panels import time_series

__all__ = ['animate', 'check_animation', 'FORMATS', 'save', 'strip', 'time_series']
