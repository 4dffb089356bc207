# SPDX-License-Identifier: Apache-2.0
"""
Messages of a program while its kernels are compiled.

Separate from `ballbot_ros.jit`, which imports numba: a program without kernels starts sooner.
"""
import logging
from time import monotonic
from typing import Callable, List, Optional

# Longer compile times are reported [s].
REPORT_AFTER = 2.0
COMPILING_NOTICE = ('compiling for this machine; this takes about a minute the first time, and '
                    'the result is cached')

# Receives the name of a kernel, and whether its machine code was cached.
OnFirstCall = Callable[[str, bool], None]
_callbacks: List[OnFirstCall] = []
# Receives the number of kernels compiled so far, and whether more are being compiled.
OnCompiling = Callable[[int, bool], None]
_report: Optional[OnCompiling] = None
_unfinished = 0  # kernels that are being compiled


def compiling() -> bool:
    """Return whether a kernel is being compiled, in any thread of this process."""
    return _unfinished > 0


def on_compiling(callback: Optional[OnCompiling]) -> None:
    """Register a function to call, instead of the warning, when a compilation starts or ends."""
    global _report
    _report = callback


def on_first_call(callback: OnFirstCall) -> None:
    """
    Register a function to call when a kernel is first called, or first with certain types.

    It is called before the compilation, or after loading cached machine code.
    """
    _callbacks.append(callback)


class CompileNotice:
    """
    Reports compilations: to the `on_compiling` callback, else once in the log.

    It logs nothing in a program with an `OnFirstCall`.

    Attributes
    ----------
    spent : float
        Time spent compiling [s].

    """

    def __init__(self) -> None:
        self.spent = 0.0
        self._done, self._since, self._warned = 0, 0.0, False

    def first_call(self, kernel: str, kept: bool) -> None:
        """
        Call each `OnFirstCall`; without cached code, record the start of a compilation.

        Compilations may be nested.
        """
        global _unfinished
        for callback in _callbacks:
            callback(kernel, kept)
        if kept:
            return
        self._count()
        _unfinished += 1
        if _report is not None:
            _report(self._done, True)
        elif self.spent > REPORT_AFTER and not (_callbacks or self._warned):
            self._warned = True
            logging.getLogger('ballbot_ros').warning(COMPILING_NOTICE)

    def ends(self) -> None:
        """Record the end of a compilation."""
        global _unfinished
        self._count()
        _unfinished, self._done = max(_unfinished - 1, 0), self._done + 1
        if _report is not None:
            _report(self._done, _unfinished > 0)

    def _count(self) -> None:
        now = monotonic()
        if _unfinished:
            self.spent += now - self._since
        self._since = now
