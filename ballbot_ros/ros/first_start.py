# SPDX-License-Identifier: Apache-2.0
"""A first start says why nothing moves yet: it compiles; and none compiles later than that."""
import time
from typing import Callable

from ballbot_ros.jit import hear_of_first_calls

COMPILES = ('compiling for this machine, which takes a minute or two and is kept: the next start '
            'begins at once')
# A period in which this happens is late, and a test reads every log for it.
LATE = 'this node is late by a kernel that is called for the first time: '


class FirstStart:
    """
    Tells what a node compiles before it is ready, and warns of what is left for later.

    Parameters
    ----------
    tell, warn : callable
        Take a sentence.

    """

    def __init__(self, tell: Callable[[str], None], warn: Callable[[str], None]):
        """Listen from now on."""
        self._tell, self._warn = tell, warn
        self._begun, self._compiled, self._ready = time.monotonic(), 0, False
        hear_of_first_calls(self._hear)

    def ready(self) -> None:
        """Tell how long it took until the node could do its work."""
        self._ready = True
        self._tell(f'ready after {time.monotonic() - self._begun:.1f} s' + (
            f', in which {self._compiled} kernels were compiled' if self._compiled else ''))

    def _hear(self, kernel: str, kept: bool) -> None:
        if self._ready:
            self._warn(f'{LATE}{kernel}, {"read from the disk" if kept else "compiled"}')
        elif not kept:
            if not self._compiled:
                self._tell(COMPILES)
            self._compiled += 1
