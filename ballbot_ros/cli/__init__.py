# SPDX-License-Identifier: Apache-2.0
"""The command ``ballbot``; see `command` for how verbs are added."""
from ballbot_ros.cli.command import main

__all__ = ['main']
