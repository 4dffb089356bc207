# SPDX-License-Identifier: Apache-2.0
"""Signals other than Ctrl-C that end a node or a command; importable without ROS."""
import signal
from typing import List


def ending_signals() -> List[signal.Signals]:
    """Return SIGTERM and, unless the process ignores it, as under ``nohup``, SIGHUP."""
    # A closing terminal sends SIGHUP.
    ignored = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    return [signal.SIGTERM] if ignored else [signal.SIGTERM, signal.SIGHUP]
