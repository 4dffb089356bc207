# SPDX-License-Identifier: Apache-2.0
"""Signals other than Ctrl-C that end a node or a command; importable without ROS."""
from contextlib import contextmanager
import signal
import sys
from typing import Any, Iterator, List


def ending_signals() -> List[signal.Signals]:
    """Return SIGTERM and, unless the process ignores it, as under ``nohup``, SIGHUP."""
    # A closing terminal sends SIGHUP.
    ignored = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    return [signal.SIGTERM] if ignored else [signal.SIGTERM, signal.SIGHUP]


@contextmanager
def ending_by_signal() -> Iterator[None]:
    """Convert `ending_signals` to `SystemExit`, to stop robots and terminate nodes."""
    def leave(number: int, _: Any) -> None:
        sys.exit(128 + number)

    before = {number: signal.signal(number, leave) for number in ending_signals()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
