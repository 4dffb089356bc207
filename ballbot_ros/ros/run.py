# SPDX-License-Identifier: Apache-2.0
"""Start a node, spin it, and shut it down completely."""
import ast
from contextlib import ExitStack
import faulthandler
import gc
import os
import signal
import sys
import time
from typing import Any, Callable, List, Optional, Sequence

import rclpy
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from ballbot_ros.compile_notice import COMPILING_NOTICE, on_first_call
from ballbot_ros.errors import BallbotError
from ballbot_ros.ros import discovery
from ballbot_ros.ros.endpoints import create_wall_timer
from ballbot_ros.ros.logs import forward_logs
from ballbot_ros.ros.rclpy_compat import new_executor, RCLError, reason_of
from ballbot_ros.ros.signals import ending_signals

# Longest time for which a thread keeps the interpreter lock [s]: Python's default of 5 ms would
# delay a motor loop or a callback too long while another thread computes.
SWITCH_INTERVAL = 5e-4
# Longest delay of the reaction to a stop signal, or to the failure of a node [s].
POLL_PERIOD = 0.1
# Timeout of the middleware shutdown, after the motor is safe [s]; then the process ends.
END_TIMEOUT = 20.0

# Wall time without /clock before a warning, and between two of them [s].
CLOCK_TIMEOUT, CLOCK_WARNING_PERIOD = 3.0, 10.0

EXIT_REFUSED = 2  # exit code when the node does not accept its configuration
STRAY_ARGUMENT = ('not an argument of a node; parameters are given as in --ros-args -p '
                  'robot:=gimball')
NO_VALUE = 'there is no value; an empty text is given as in -p "map_frame:=\'\'"'


class Stop:
    """
    Stops an executor, which uses it as a future, from a signal handler or a callback.

    A future of rclpy has a lock, on which a signal handler could block indefinitely.
    """

    def __init__(self) -> None:
        self.given = False
        self._wake: Optional[Callable[[Any], None]] = None

    def give(self) -> None:
        """Stop the executor; also works before it spins."""
        self.given = True
        if self._wake is not None:
            self._wake(self)

    def done(self) -> bool:
        return self.given

    def cancelled(self) -> bool:
        """Return False: it cannot be cancelled."""
        return False

    def add_done_callback(self, wake: Callable[[Any], None]) -> None:
        """Register the callback of the one executor."""
        self._wake = wake
        if self.given:
            wake(self)

    def remove_done_callback(self, wake: Callable[[Any], None]) -> None:
        self._wake = None


class _Stopped(BaseException):
    """
    A stop signal, while the node is created.

    It is not a KeyboardInterrupt: if one passes through exec(), which numba uses, Python ends the
    process by SIGINT although the exception was caught.
    """


def run(make_node: Callable[[], Node], args: Optional[List[str]] = None) -> int:
    """Run one node; see `run_together`."""
    return run_together([make_node], args)


def run_together(make_nodes: Sequence[Callable[[], Node]],
                 args: Optional[List[str]] = None) -> int:
    """
    Run nodes on one executor until a signal ends them, and return the exit code of the process.

    Messages between them then wake no other process.  The signals are SIGINT and `ending_signals`.
    The method ``make_safe`` of a node, if any, is called before the node is destroyed, on every
    exit path and while it can still publish: rclpy's own signal handlers, which are replaced,
    would shut the context down first.  An exception in the attribute ``failure`` of a node ends
    all nodes; the executor would also log an exception that a callback raises.

    Returns 0 after a signal, 2 if the configuration or an argument (by default of ``sys.argv``) is
    refused.
    """
    stopping, making = Stop(), False

    def stop(number: int, frame: Any) -> None:
        stopping.give()
        if making:  # compilation may take minutes, and there is nothing to make safe
            if _compiles(frame):
                os._exit(0)
            raise _Stopped

    signals = (signal.SIGINT, *ending_signals())
    for number in signals:
        signal.signal(number, stop)
    sys.setswitchinterval(SWITCH_INTERVAL)
    reach = discovery.apply(os.environ)
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except (RuntimeError, ValueError) as error:  # a malformed argument or parameter file
        reason = reason_of(error)
        if reason.startswith('['):  # rclpy only lists the unknown arguments
            reason = f'{", ".join(ast.literal_eval(reason))}: {STRAY_ARGUMENT}'
        reason = reason.replace('error not set', NO_VALUE)
        print(f'cannot start: {reason}', file=sys.stderr)
        return EXIT_REFUSED
    words = sys.argv[1:] if args is None else args
    first = words.index('--ros-args') if '--ros-args' in words else len(words)
    # ROS would ignore them, even a parameter: it reads NAME:=VALUE as a remapping.
    stray = [*words[:first], *remove_ros_args(words[first:])]
    if stray:
        print(f'cannot start: {", ".join(stray)}: {STRAY_ARGUMENT}', file=sys.stderr)
        rclpy.try_shutdown()
        return EXIT_REFUSED
    nodes: List[Node] = []
    executor = new_executor()
    log = get_logger('ballbot_ros')
    start = FirstStart(log.info, log.warning)
    try:
        making = True
        for make_node in make_nodes:
            nodes.append(make_node())
        making = False
        forward_logs(nodes[0])
        nodes[0].get_logger().info(reach)
        for node in nodes:
            executor.add_node(node)
        start.ready()
        # All present objects live as long as the node; their garbage collection would take
        # milliseconds within a control period.
        gc.collect()
        gc.freeze()
        for node in nodes:
            _watch(node, stopping)
            _watch_clock(node)
        while rclpy.ok() and not stopping.given:
            executor.spin_until_future_complete(stopping, timeout_sec=POLL_PERIOD)
        for node in nodes:
            failure = getattr(node, 'failure', None)
            if failure is not None:
                raise failure
    except _Stopped:
        pass
    except RCLError as error:
        if not making:
            raise
        log.fatal(f'cannot start: {reason_of(error)}')
        _end_in_time(nodes)
        return EXIT_REFUSED
    except BallbotError as error:
        to_all = len(make_nodes) > 1 and error.reason == 'unknown_name' and any(
            word.startswith(f'{error.field}:=') for word in words)
        log.fatal(reason_of(error) + (
            f'; -p NODE:{error.field}:=VALUE sets it for one of the nodes' if to_all else ''))
        _end_in_time(nodes)
        return EXIT_REFUSED
    finally:
        making = False
        with ExitStack() as ends:  # calls the last one first, and all if one raises an exception
            # The interpreter would end with the code of a signal that it receives in its shutdown.
            for number in signals:
                ends.callback(signal.signal, number, signal.SIG_IGN)
            ends.callback(faulthandler.cancel_dump_traceback_later)
            ends.callback(rclpy.try_shutdown)
            ends.callback(executor.shutdown)
            for node in reversed(nodes):
                ends.callback(node.destroy_node)
                ends.callback(executor.remove_node, node)
            ends.callback(_end_in_time, ())
            for node in reversed(nodes):
                ends.callback(getattr(node, 'make_safe', lambda: None))
    return 0


def _end_in_time(unsafe: Sequence[Node]) -> None:
    """
    End a process without `unsafe` nodes after `END_TIMEOUT`, even if the middleware blocks.

    A node that is destroyed during discovery may block in Fast DDS indefinitely, at full load and
    with the GIL held: only a native thread can end the process, with code 1.
    """
    if not unsafe:
        faulthandler.dump_traceback_later(END_TIMEOUT, exit=True, file=open(os.devnull, 'w'))


def _watch(node: Node, stopping: Stop) -> None:
    if hasattr(node, 'failure'):
        def poll() -> None:
            if node.failure is not None:
                stopping.give()
        create_wall_timer(node, POLL_PERIOD, poll)


def _watch_clock(node: Node) -> None:
    """Warn while a node with use_sim_time receives no /clock: its time is stopped."""
    def check() -> None:
        if node.get_clock().now().nanoseconds:
            timer.cancel()
        elif node.get_parameter('use_sim_time').value:
            node.get_logger().warning(
                f'use_sim_time is set and no /clock has arrived for {CLOCK_TIMEOUT:g} s: the time '
                'of this node remains 0 s; start a simulator, or set use_sim_time to false',
                throttle_duration_sec=CLOCK_WARNING_PERIOD)
    timer = create_wall_timer(node, CLOCK_TIMEOUT, check)


def _compiles(frame: Any) -> bool:
    """Return whether a frame is within the compiler: an exception there corrupts LLVM."""
    while frame is not None:
        if str(frame.f_globals.get('__name__')).split('.')[0] in ('numba', 'llvmlite'):
            return True
        frame = frame.f_back
    return False


# A period with such a call misses its deadline; a test searches every log for this message.
LATE_KERNEL = 'this node is delayed by the first call of a kernel: '


class FirstStart:
    """Logs compilation during the start of a node, and warns about later compilation."""

    def __init__(self, log: Callable[[str], None], warn: Callable[[str], None]):
        self._log, self._warn = log, warn
        self._start, self._compiled, self._ready = time.monotonic(), 0, False
        on_first_call(self._on_kernel)

    def ready(self) -> None:
        """Log the duration of the start."""
        self._ready = True
        self._log(f'ready after {time.monotonic() - self._start:.1f} s' + (
            f', in which {self._compiled} kernels were compiled' if self._compiled else ''))

    def _on_kernel(self, kernel: str, kept: bool) -> None:
        if self._ready:
            self._warn(f'{LATE_KERNEL}{kernel}, {"read from the disk" if kept else "compiled"}')
        elif not kept:
            if not self._compiled:
                self._log(COMPILING_NOTICE)
            self._compiled += 1
