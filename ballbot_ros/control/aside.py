# SPDX-License-Identifier: Apache-2.0
"""
A calculation in a process of its own, so that a loop in this one is not disturbed.

Threads of one Python process wait for each other: beside a thread that computes, a controller
answers half of what comes at 500 Hz.  To ask for another process costs a loop a millisecond.
"""
from concurrent.futures import ThreadPoolExecutor
import os
import pickle
import subprocess
import sys
from typing import Any, Callable, Optional, TypeVar

from ballbot_ros.errors import BallbotError, RefusedError

R = TypeVar('R')

# What the other process runs; nothing of this one's main module.
ANSWER = 'from ballbot_ros.control.aside import answer; answer()'
# Longest time that a calculation may take [s].
PATIENCE = 120.0


def aside(function: Callable[..., R], *arguments: Any) -> R:
    """
    Return what a function of a module gives, calculated in another process.

    Raises
    ------
    BallbotError
        As the function does.
    RefusedError
        If the process ends without an answer, or takes longer than `PATIENCE`.

    """
    environment = {**os.environ, 'PYTHONPATH': os.pathsep.join(filter(None, sys.path))}

    # A session of its own, or Ctrl-C would be for it, too.
    def run() -> 'subprocess.CompletedProcess[bytes]':
        return subprocess.run(
            [sys.executable, '-c', ANSWER], input=pickle.dumps((function, arguments)),
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment, timeout=PATIENCE,
            start_new_session=True, check=False)
    try:
        # A process inherits the priority of the thread that starts it, and its first 0.4 s are
        # imports: a thread without real-time priority starts it.
        with ThreadPoolExecutor(1, initializer=_without_priority) as starter:
            done = starter.submit(run).result()
    except subprocess.TimeoutExpired:
        raise RefusedError(
            f'{function.__name__} was not done within {PATIENCE:g} s in a process of its own, so '
            'nothing has changed: is this machine busy? Try again, or give the value at the '
            'start of the node') from None
    try:
        value: R
        value, error = pickle.loads(done.stdout)
    except (EOFError, pickle.UnpicklingError):
        words = done.stderr.decode(errors='replace').strip().splitlines()
        raise RefusedError(
            f'{function.__name__} gave no answer in a process of its own: '
            + (words[-1] if words else f'exit code {done.returncode}')) from None
    if error is not None:
        raise error
    return value


def _without_priority() -> None:
    """Give the calling thread, and what it starts, no real-time priority."""
    try:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    except (AttributeError, OSError):
        pass


def answer() -> None:
    """Calculate what is asked for on the standard input; the other end of `aside`."""
    os.nice(5)
    function, arguments = pickle.load(sys.stdin.buffer)
    output, sys.stdout = sys.stdout.buffer, sys.stderr
    value: Any = None
    problem: Optional[BallbotError] = None
    try:
        value = function(*arguments)
    except BallbotError as error:
        problem = error
    output.write(pickle.dumps((value, problem)))
