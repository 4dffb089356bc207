# SPDX-License-Identifier: Apache-2.0
"""Signals other than Ctrl-C that end a command."""
from contextlib import contextmanager
import signal
import sys
from typing import Any, Iterator


@contextmanager
def ending_by_signal() -> Iterator[None]:
    """
    Convert SIGTERM and SIGHUP to `SystemExit`, so that robots are stopped and nodes terminated.

    An ignored SIGHUP, as under ``nohup``, stays ignored.
    """
    def leave(number: int, _: Any) -> None:
        sys.exit(128 + number)

    before = {number: signal.signal(number, leave)
              for number in (signal.SIGTERM, signal.SIGHUP)
              if signal.getsignal(number) is not signal.SIG_IGN}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
