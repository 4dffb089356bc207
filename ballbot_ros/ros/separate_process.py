# SPDX-License-Identifier: Apache-2.0
"""
Run a function in a separate process, so that it does not delay the loop of this one.

Threads of one Python process share the interpreter: next to a computing thread, a controller
answers half of the readings at 500 Hz.  Starting another process delays the loop by 1 ms.
"""
from concurrent.futures import ThreadPoolExecutor
import os
import pickle
import subprocess
import sys
from typing import Any, Callable, Tuple, TypeVar

from ballbot_ros.errors import BallbotError, RefusedError

R = TypeVar('R')

CALCULATION_TIMEOUT = 120.0  # [s]
# The program of the process.  It does not import the main module, as multiprocessing would, since
# that may be a script that starts a node.  Its standard output contains only the result.
WORKER = """
import os, pickle, sys
os.nice(5)
output = os.fdopen(os.dup(1), 'wb')
os.dup2(2, 1)
try:
    sys.path[:] = pickle.load(sys.stdin.buffer)
    function, arguments = pickle.load(sys.stdin.buffer)
    result = function(*arguments), None
except Exception as error:
    result = None, error
pickle.dump(result, output)
"""


def run_in_process(function: Callable[..., R], *arguments: Any) -> R:
    """
    Return the result of a function of a module, calculated in another process.

    Raises `BallbotError` as the function does, and `RefusedError` if the function raises anything
    else, or takes longer than `CALCULATION_TIMEOUT`.
    """
    # A process inherits the priority of the thread that starts it; this thread has no real-time
    # priority.
    with ThreadPoolExecutor(1, initializer=_leave_real_time) as starter:
        return starter.submit(_run, function, arguments).result()


def _run(function: Callable[..., R], arguments: Tuple[Any, ...]) -> R:
    try:
        output = subprocess.run(  # in its own session, so that Ctrl-C does not reach it
            [sys.executable, '-c', WORKER], check=True, stdout=subprocess.PIPE,
            input=pickle.dumps(sys.path) + pickle.dumps((function, arguments)),
            timeout=CALCULATION_TIMEOUT, start_new_session=True).stdout
        result, error = pickle.loads(output)
    except subprocess.TimeoutExpired:
        raise RefusedError(
            f'{function.__name__} did not finish within {CALCULATION_TIMEOUT:g} s in a separate '
            'process, so nothing has changed: is this machine busy? Try again, or set the '
            'value at the start of the node', 'timeout', function.__name__) from None
    except (subprocess.CalledProcessError, OSError, EOFError) as failure:
        result, error = None, failure
    if error is None:
        return result
    if isinstance(error, BallbotError):
        raise error
    raise RefusedError(
        f'{function.__name__} failed in a separate process: {type(error).__name__}: '
        f'{error}', 'failed', function.__name__) from error


def _leave_real_time() -> None:
    try:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    except (AttributeError, OSError):
        pass
