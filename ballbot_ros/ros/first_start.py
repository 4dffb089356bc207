# SPDX-License-Identifier: Apache-2.0
"""A first start says why nothing moves yet: it compiles."""
from typing import Any, Callable

SENTENCE = ('compiling for this machine, which takes a minute or two and is kept: the next start '
            'begins at once')


def announce_compilation(tell: Callable[[str], None]) -> None:
    """
    Have it told once when a kernel is compiled, and never where machine code is kept.

    Parameters
    ----------
    tell : callable
        Takes a sentence.

    """
    try:
        from numba.core import event
    except ImportError:  # nothing is compiled then
        return

    class Listener(event.Listener):  # type: ignore[misc]
        """Hears of each compilation, after the machine code that is kept was looked through."""

        told = False

        def on_start(self, _event: Any) -> None:
            if not self.told:
                self.told = True
                tell(SENTENCE)

        def on_end(self, _event: Any) -> None:
            """Wait for nothing."""

    event.register('numba:compile', Listener())
