# SPDX-License-Identifier: Apache-2.0
"""Pictures of a run; needs no display."""
from ballbot_ros.output.canvas import FORMATS, save
from ballbot_ros.output.film import strip
from ballbot_ros.output.panels import time_series

__all__ = ['FORMATS', 'save', 'strip', 'time_series']
