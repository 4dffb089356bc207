# SPDX-License-Identifier: Apache-2.0
"""Which model simulated which part of a run, and why it was entered."""
from typing import NamedTuple

from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.solvers.switching import BEGUN, FLYING, LANDED, LIFTED, WHOLE

NAMES = {WHOLE: 'full', FLYING: 'flight'}
REASONS = {BEGUN: 'the run begins', LANDED: 'the ball touched the ground',
           LIFTED: 'the ball left the ground'}


class Span(NamedTuple):
    """A part of a run in one model."""

    begin: float  # [s]
    end: float
    model: str  # 'full' or 'flight'
    reason: str  # for which it was entered


def read_log(log: Array, end: float) -> tuple[Span, ...]:
    """
    Return the parts of a run, in order.

    Parameters
    ----------
    log : (n, 3) array
        See `switching.note`; changes beyond its room are missing, so that the last part
        holds them all.
    end : float
        Of the run [s].

    """
    kept = log[1:min(int(log[0, 0]) + 1, len(log))]
    times = [*kept[:, 0].tolist(), end]
    return tuple(
        Span(begin, max(begin, until), NAMES[int(model)], REASONS[int(reason)])
        for begin, until, (_, model, reason) in zip(times, times[1:], kept.tolist()))
