# SPDX-License-Identifier: Apache-2.0
"""Which model simulated which part of a run, and why it was entered."""
from typing import NamedTuple

from ballbot_ros.physics.reduced import stepping
from ballbot_ros.physics.terrain import Array

NAMES = {stepping.WHOLE: 'full', stepping.ROLLING: 'rolling', stepping.FLYING: 'flight'}
REASONS = {
    stepping.BEGUN: 'the run begins',
    stepping.SETTLED: 'one contact, quiet and not sliding',
    stepping.NEGLECT: 'what rolling neglects became more than the tolerance allows',
    stepping.GROUND: 'another part of the ground was met',
    stepping.PULLED: 'the contact would have had to pull',
    stepping.CONE: 'friction could not give what was asked for',
    stepping.LIMIT: 'the motor met its limit',
    stepping.LANDED: 'the ball touched the ground',
    stepping.LIFTED: 'the ball left the ground',
    stepping.COARSE: 'rolling would have needed too short steps',
}


class Span(NamedTuple):
    """A part of a run in one model."""

    begin: float  # [s]
    end: float
    model: str  # 'full', 'rolling' or 'flight'
    reason: str  # for which it was entered


def read_log(log: Array, end: float) -> tuple[Span, ...]:
    """
    Return the parts of a run, in order.

    Parameters
    ----------
    log : (n, 3) array
        See `stepping.note`; changes beyond its room are missing, so that the last part
        holds them all.
    end : float
        Of the run [s].

    """
    kept = log[1:min(int(log[0, 0]) + 1, len(log))]
    times = [*kept[:, 0].tolist(), end]
    return tuple(
        Span(begin, max(begin, until), NAMES[int(model)], REASONS[int(reason)])
        for begin, until, (_, model, reason) in zip(times, times[1:], kept.tolist()))
