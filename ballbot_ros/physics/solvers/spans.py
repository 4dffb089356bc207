# SPDX-License-Identifier: Apache-2.0
"""Which model simulated which part of a run, and why it was entered."""
from typing import NamedTuple

from ballbot_ros.jit import compiled
from ballbot_ros.physics.model.terrain import Array

# The models that a run can be in.
FULL, FLIGHT = range(2)
NAMES = {FULL: 'full', FLIGHT: 'flight'}


class Span(NamedTuple):
    """A part of a run in one model."""

    begin: float  # [s]
    end: float
    model: str  # 'full' or 'flight'
    reason: str  # for which it was entered


@compiled
def note(log: Array, time: float, model: int) -> None:
    """
    Note the model from a time on in a log, an (n, 2) array of time and model.

    Its first line holds the number of changes, of which so many are kept as there are lines, and
    the present model.
    """
    if log[0, 0] > 0.0 and log[0, 1] == model:
        return
    log[0, 0] += 1.0
    log[0, 1] = model
    line = int(log[0, 0])
    if line < len(log):
        log[line, 0], log[line, 1] = time, model


def read_log(log: Array, end: float) -> tuple[Span, ...]:
    """
    Return the parts of a run, in order.

    Parameters
    ----------
    log : (n, 2) array
        See `note`; changes beyond its end are missing, so that the last part holds them all.
    end : float
        Of the run [s].

    """
    kept = log[1:min(int(log[0, 0]) + 1, len(log))]
    times = [*kept[:, 0].tolist(), end]
    reasons = {FULL: 'the run begins', FLIGHT: 'the ground let go of the ball'}
    spans = []
    for begin, until, model in zip(times, times[1:], kept[:, 1].tolist()):
        spans.append(Span(begin, max(begin, until), NAMES[int(model)], reasons[int(model)]))
        reasons[FULL] = 'the ball touched the ground'
    return tuple(spans)
