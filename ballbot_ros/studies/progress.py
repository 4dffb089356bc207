# SPDX-License-Identifier: Apache-2.0
"""Progress of a long computation, as a fraction from 0 to 1."""
from itertools import count
from typing import Callable, Iterator, Sequence, TypeVar

T = TypeVar('T')
Progress = Callable[[float], None]


def ignore(done: float) -> None:
    """Ignore the progress."""


def part_of(progress: Progress, number: int, parts: int) -> Progress:
    """Return the progress of one of several equal parts, counted from 0."""
    return lambda done: progress((number + done) / parts)


def counted(progress: Progress, parts: int) -> Callable[[], None]:
    """Return a function that reports that one more of several equal parts is done."""
    done = count(1)
    return lambda: progress(next(done) / parts)


def tracked(items: Sequence[T], progress: Progress) -> Iterator[T]:
    """Yield equal parts of the work; each is done when the next is requested."""
    for number, item in enumerate(items, 1):
        yield item
        progress(number / len(items))
