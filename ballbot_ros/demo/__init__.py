# SPDX-License-Identifier: Apache-2.0
"""The demo: all nodes as processes, two door-steps, and a timeline of what happened."""
from ballbot_ros.demo.demo import run_demo
from ballbot_ros.demo.hardware import run_hardware_demo
from ballbot_ros.demo.own_act import own_acts
from ballbot_ros.demo.page import page_beside

__all__ = ['own_acts', 'page_beside', 'run_demo', 'run_hardware_demo']
