# SPDX-License-Identifier: Apache-2.0
"""Pictures of a run; needs no display."""
from ballbot_ros.figures.canvas import FORMATS, save
from ballbot_ros.figures.film import strip
from ballbot_ros.figures.panels import time_series

__all__ = ['FORMATS', 'save', 'strip', 'time_series']
