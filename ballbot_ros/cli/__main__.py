# SPDX-License-Identifier: Apache-2.0
"""Run the command as ``python -m ballbot_ros.cli``."""
import sys

from ballbot_ros.cli.command import main

if __name__ == '__main__':
    sys.exit(main())
