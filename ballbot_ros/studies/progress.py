# SPDX-License-Identifier: Apache-2.0
"""How much of a long computation is done, reported as a fraction from 0 to 1."""
from typing import Callable

Progress = Callable[[float], None]


def ignore(done: float) -> None:
    """Report to nobody."""


def part_of(progress: Progress, number: int, parts: int) -> Progress:
    """Return the progress of one of several equal parts, counted from 0."""
    return lambda done: progress((number + done) / parts)


def counted(progress: Progress, parts: int) -> Callable[[], None]:
    """Return a function that reports that one more of several equal parts is done."""
    done = 0

    def report() -> None:
        nonlocal done
        done += 1
        progress(done / parts)
    return report
