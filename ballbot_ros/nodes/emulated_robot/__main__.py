# SPDX-License-Identifier: Apache-2.0
"""Run the node: ``python -m ballbot_ros.nodes.emulated_robot``."""
import sys

from ballbot_ros.nodes.emulated_robot.node import main

sys.exit(main())
