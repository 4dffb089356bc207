# SPDX-License-Identifier: Apache-2.0
"""Run the node: ``python -m ballbot_ros.nodes.bridge``."""
import sys

from ballbot_ros.nodes.bridge.node import main

sys.exit(main())
