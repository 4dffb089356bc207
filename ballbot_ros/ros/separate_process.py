# SPDX-License-Identifier: Apache-2.0
"""
Run a function in a separate process, so that it does not delay the loop of this one.

Threads of one Python process share the interpreter: beside a computing thread, a controller
answers half of the readings at 500 Hz.  Starting another process costs the loop a millisecond.
"""
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
import multiprocessing
import os
import signal
from typing import Any, Callable, Tuple, TypeVar

from ballbot_ros.errors import BallbotError, RefusedError

R = TypeVar('R')

TIME_LIMIT = 120.0  # of a calculation [s]


def run_in_process(function: Callable[..., R], *arguments: Any) -> R:
    """
    Return the result of a function of a module, calculated in another process.

    Raises
    ------
    BallbotError
        As the function does.
    RefusedError
        If the function raises anything else, or takes longer than `TIME_LIMIT`.

    """
    # A process inherits the priority of the thread that starts it: that one has no real-time
    # priority.
    with ThreadPoolExecutor(1, initializer=_leave_real_time) as starter:
        return starter.submit(_run, function, arguments).result()


def _run(function: Callable[..., R], arguments: Tuple[Any, ...]) -> R:
    pool = ProcessPoolExecutor(
        1, multiprocessing.get_context('spawn'), _prepare_worker, (TIME_LIMIT,))
    with pool:
        try:
            return pool.submit(function, *arguments).result()
        except BallbotError:
            raise
        except BrokenProcessPool:
            raise RefusedError(
                f'{function.__name__} did not finish within {TIME_LIMIT:g} s in a separate '
                'process, so nothing has changed: is this machine busy? Try again, or give the '
                'value at the start of the node', 'timeout', function.__name__) from None
        except Exception as error:
            raise RefusedError(
                f'{function.__name__} failed in a separate process: {type(error).__name__}: '
                f'{error}', 'failed', function.__name__) from error


def _leave_real_time() -> None:
    try:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    except (AttributeError, OSError):
        pass


def _prepare_worker(time_limit: float) -> None:
    """Ignore Ctrl-C, lower the priority, and end after the time limit."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.setitimer(signal.ITIMER_REAL, time_limit)  # SIGALRM ends the process
    os.nice(5)
