# SPDX-License-Identifier: Apache-2.0
"""Run the node: ``python -m ballbot_ros.nodes.controller``."""
import sys

from ballbot_ros.nodes.start import start

if __name__ == '__main__':
    sys.exit(start('controller'))
