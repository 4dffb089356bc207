# SPDX-License-Identifier: Apache-2.0
"""The command ``ballbot``; see `command` for how verbs are added."""
try:
    from ballbot_ros.cli.command import main
except KeyboardInterrupt:
    raise SystemExit(130) from None

__all__ = ['main']
