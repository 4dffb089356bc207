# SPDX-License-Identifier: Apache-2.0
"""
Processes as copies of this one, which has already imported their modules.

Importing a node takes a second of processor time.  A process that has initialised ROS cannot be
copied: the middleware has threads, and a copy has none of them.
"""
import gc
from importlib import import_module
import multiprocessing
from multiprocessing.process import BaseProcess
import os
from pathlib import Path
import signal
import subprocess
import sys
from typing import Any, Callable, Iterable, Mapping, Optional, Sequence

from ballbot_ros.compile_notice import on_compiling
from ballbot_ros.ros.signals import ending_signals


class Forked:
    """
    A process that runs a function; has methods of `subprocess.Popen`.

    By default it is a copy of this process.  With the `method` ``forkserver`` it is a copy of the
    server of `multiprocessing`, also if this process has initialised ROS.
    """

    def __init__(self, work: Callable[[], int], method: str = 'fork'):
        sys.stdout.flush()
        sys.stderr.flush()
        context: Any = multiprocessing.get_context(method)
        self._process: BaseProcess = context.Process(target=_run, args=(work,))
        self._process.start()
        assert self._process.pid is not None
        self.pid: int = self._process.pid

    def poll(self) -> Optional[int]:
        """Return the exit code, negative for a signal; None while the process runs."""
        return self._process.exitcode

    def wait(self, timeout: Optional[float] = None) -> int:
        """Return the exit code; raise `subprocess.TimeoutExpired` after the timeout [s]."""
        self._process.join(timeout)
        code = self._process.exitcode
        if code is None:
            raise subprocess.TimeoutExpired(self._process.name, timeout or 0.0)
        return code

    def send_signal(self, number: int) -> None:
        """Send a signal, unless the process has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        self._process.kill()


def run_detached(name: str, work: Callable[[], int], arguments: Sequence[str],
                 environment: Mapping[str, str], log: Path) -> int:
    """Run `work` in a separate session with a process name, an environment and a log."""
    os.setsid()
    Path('/proc/self/comm').write_text(name)  # ps and top show 15 characters of it
    with open(log, 'a', encoding='utf-8') as file:
        for stream in (1, 2):  # standard output and error, of C++ as well
            os.dup2(file.fileno(), stream)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    os.environ.clear()
    os.environ.update(environment)
    on_compiling(None)  # a node logs what it compiles
    sys.argv = [sys.argv[0], *arguments]
    return work()


def import_nodes(names: Iterable[str]) -> None:
    """Import nodes, so that copies of this process start without delay."""
    for name in names:
        import_module(f'ballbot_ros.nodes.{name}.node')
    # The garbage collection of a copy would visit all these objects, and so copy their memory.
    gc.collect()
    gc.freeze()


def _run(work: Callable[[], int]) -> None:
    for number in ending_signals():  # the copied process may have handlers
        signal.signal(number, signal.SIG_DFL)
    sys.exit(work())
