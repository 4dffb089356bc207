# SPDX-License-Identifier: Apache-2.0
"""Imported by the server whose copies are the nodes (`imported_once` in conftest.py)."""
from ballbot_ros.cli.run import NODES
from ballbot_ros.demo.forked import import_nodes
from ballbot_ros.ros import diagnostics

diagnostics.PERIOD = 0.1  # instead of 1 s: tests wait for the health of the nodes
import_nodes(NODES)
