# SPDX-License-Identifier: Apache-2.0
"""
A linear plant under an input that is held, and changes once within each period.

That is the modified z-transform: exact for a delay of any number of samples, whole or not.
"""
import math
from typing import NamedTuple, Tuple

import numpy as np

from ballbot_ros.control.matrix_exponential import expm
from ballbot_ros.control.rolling_model import Array


class HeldInput(NamedTuple):
    """
    One period of x' = A x + b u: ``x <- step x + before u_before + after u_after``.

    Attributes
    ----------
    step : (n, n) array
    before : (n,) array
        Of the input that is in force when the period begins; zero if it changes at once.
    after : (n,) array
        Of the one that takes its place.
    waiting : int
        Inputs that are stored, the one in force first: the delay, rounded up.

    """

    step: Array
    before: Array
    after: Array
    waiting: int

    @classmethod
    def of(cls, matrix: Array, column: Array, rate: float, delay: float) -> 'HeldInput':
        """
        Return it for a rate [Hz] and a delay in samples.

        Parameters
        ----------
        matrix : (n, n) array
        column : (n,) array
        rate : float
        delay : float
            From the sample that an input answers until it takes force; at least 0.

        """
        size, part = len(matrix), delay - math.floor(delay)
        flow = np.zeros((size + 1, size + 1))
        flow[:size, :size], flow[:size, size] = matrix, column

        def over(share: float) -> Tuple[Array, Array]:
            held = expm(flow * share / rate) if share != 1.0 else expm(flow / rate)
            return held[:size, :size], held[:size, size]

        if part == 0.0:
            step, after = over(1.0)
            return cls(step, np.zeros(size), after, int(delay))
        first, before = over(part)
        second, after = over(1.0 - part)
        return cls(second @ first, second @ before, after, math.ceil(delay))

    def closed(self, feedback: Array) -> Array:
        """Return the matrix of the loop under u = feedback . x, of x and the waiting inputs."""
        size, waiting = len(self.step), self.waiting
        loop = np.zeros((size + waiting, size + waiting))
        loop[:size, :size] = self.step
        # Which input acts before, which after the change: stored ones, or the newest.
        if self.before.any():
            loop[:size, size] = self.before
            acting = size + 1
        else:
            acting = size
        if acting < size + waiting:
            loop[:size, acting] = self.after
        else:
            loop[:size, :size] += np.outer(self.after, feedback)
        if waiting:
            loop[size:-1, size + 1:] = np.eye(waiting - 1)
            loop[-1, :size] = feedback
        return loop
