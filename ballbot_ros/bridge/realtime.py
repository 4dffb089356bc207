# SPDX-License-Identifier: Apache-2.0
"""
Real-time priority for the loop, where the system permits it: docs/realtime.md.

Python runs one thread of a process at a time.  A loop with priority would still wait for a thread
of its own process that holds the interpreter lock and is preempted by other programs.  So the
other threads also get a real-time priority, lower by one.
"""
import ctypes
import errno
import logging
import os
from pathlib import Path
import resource
from typing import NamedTuple

from ballbot_ros.errors import ConfigurationError

LOG = logging.getLogger(__name__)

NAME = 'motor loop'  # of the thread, for ps and top
PAGE = 'see docs/realtime.md'
# Below 50, the priority of the interrupt threads of a PREEMPT_RT kernel.
DEFAULT_PRIORITY = 20
PERMIT = ("to permit it: echo '@dialout - rtprio 50' | sudo tee "
          f'/etc/security/limits.d/ballbot.conf, then log in again; {PAGE}')

# <sys/mman.h>: present and future mappings stay in memory after the first access.
MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT = 1, 2, 4
PR_SET_NAME = 15  # <sys/prctl.h>
CAP_IPC_LOCK = 14  # <linux/capability.h>


class Scheduling(NamedTuple):
    """Scheduling of the loop by the operating system."""

    # SCHED_FIFO priority, 1 to 99; 0 for none, -1 for `DEFAULT_PRIORITY` if the system permits it.
    priority: int = 0
    cpu: int = -1  # processor of the loop; -1 for any
    lock_memory: bool = False  # lock all memory of the process, so that it is not swapped out

    def prepared(self) -> 'Scheduling':
        """
        Apply the scheduling to the existing threads, and return it with the actual priority.

        Call this before the loop starts; later threads inherit it.

        Raises `ConfigurationError` if the system does not permit it; the message names the remedy.
        """
        if self.priority < 0:
            permitted = permits(DEFAULT_PRIORITY)
            if not permitted:
                LOG.warning('the loop has no real-time priority, so a busy machine may delay it '
                            'and engage the e-stop; %s', PERMIT)
            return self._replace(priority=DEFAULT_PRIORITY if permitted else 0).prepared()
        allowed = sorted(os.sched_getaffinity(0))
        if self.cpu >= 0 and self.cpu not in allowed:
            raise ConfigurationError(
                f'cpu {self.cpu} is not available to this process, only '
                f'{", ".join(map(str, allowed))}; choose one of them, or -1 for any; {PAGE}',
                'unavailable', 'cpu')
        if self.lock_memory:
            _lock_memory()
        if self.priority:
            _set_priority(0, self.priority)  # check the priority of the loop; lowered below
            for thread in Path('/proc/self/task').iterdir():
                _set_priority(int(thread.name), max(1, self.priority - 1))
        if self != Scheduling():
            LOG.info('the loop runs %s', self.in_words)
        return self

    def enter(self) -> None:
        """Apply the scheduling and the name of the loop to the calling thread."""
        _libc().prctl(PR_SET_NAME, NAME.encode(), 0, 0, 0)
        if self.cpu >= 0:
            os.sched_setaffinity(0, {self.cpu})
        if self.priority:
            _set_priority(0, self.priority)

    @property
    def in_words(self) -> str:
        """Return the scheduling as text."""
        return ', '.join((
            f'with real-time priority {self.priority}' if self.priority else
            'without real-time priority',
            f'on processor {self.cpu}' if self.cpu >= 0 else 'on any processor',
            'its memory locked' if self.lock_memory else 'its memory not locked'))


def permits(priority: int) -> bool:
    """Return whether the system permits a real-time priority; tries it for the calling thread."""
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError:
        return False
    os.sched_setscheduler(0, policy, parameters)
    return True


def _set_priority(thread: int, priority: int) -> None:
    """Set the priority of a thread, 0 for the calling one."""
    try:
        os.sched_setscheduler(thread, os.SCHED_FIFO, os.sched_param(priority))
    except ProcessLookupError:  # the thread has ended
        pass
    except OSError as error:
        most, _ = resource.getrlimit(resource.RLIMIT_RTPRIO)
        raise ConfigurationError(
            f'the system does not allow realtime_priority {priority} ({error.strerror}; '
            f'RLIMIT_RTPRIO is {most}): raise rtprio in /etc/security/limits.d, or LimitRTPRIO '
            f'of the systemd unit, or set realtime_priority to 0; {PAGE}',
            'unavailable', 'realtime_priority') from error


def _lock_memory() -> None:
    most, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    # With a limit the call would succeed now, and allocations would fail at the limit later.
    number = errno.ENOMEM
    if most == resource.RLIM_INFINITY or _may_lock():
        libc = _libc()
        if libc.mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) == 0:
            return
        number = ctypes.get_errno()
    raise ConfigurationError(
        f'the system does not allow lock_memory ({os.strerror(number)}; RLIMIT_MEMLOCK is '
        f'{"unlimited" if most == resource.RLIM_INFINITY else f"{most} bytes"}): set memlock to '
        'unlimited in /etc/security/limits.d, or LimitMEMLOCK=infinity in the systemd unit, or '
        f'set lock_memory to false; {PAGE}', 'unavailable', 'lock_memory')


def _may_lock() -> bool:
    """Return whether this process may lock memory beyond its limit."""
    status = Path('/proc/self/status').read_text(encoding='utf-8')
    capabilities = next(line for line in status.splitlines() if line.startswith('CapEff:'))
    return bool(int(capabilities.split()[1], 16) >> CAP_IPC_LOCK & 1)


def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)
