# SPDX-License-Identifier: Apache-2.0
"""Run the node: ``python -m ballbot_ros.nodes.navigator``."""
import sys

from ballbot_ros.nodes.start import start

sys.exit(start('navigator'))
