# SPDX-License-Identifier: Apache-2.0
"""The methods by name: to add one is to add its line here."""
from typing import Callable, NamedTuple

from ballbot_ros.physics.solvers import integrate, rk4, semi_implicit, trapezoidal
from ballbot_ros.physics.solvers.values import (
    AUTOMATIC, EXPLICIT, IMPLICIT, Packed)


class Method(NamedTuple):
    """A method, and what users choose it by."""

    advance: Callable[[Packed], Packed]  # see `solvers`
    order: int
    evaluations: int = 0  # of the right-hand side per step, for fixed-step methods
    steps: int = AUTOMATIC  # which steps `integrate` takes
    flies: bool = False  # whether it may take flight in closed form
    tolerance: bool = False  # whether steps are chosen by their error
    step: bool = False  # whether the length of a step, or of the longest, is given

    @property
    def fixed(self) -> bool:
        """Return whether it is a fixed-step method."""
        return not self.tolerance


METHODS: dict[str, Method] = {
    'semi_implicit': Method(semi_implicit.advance, semi_implicit.ORDER,
                            semi_implicit.EVALUATIONS, step=True),
    'rk4': Method(rk4.advance, rk4.ORDER, rk4.EVALUATIONS, step=True),
    'adaptive': Method(integrate.advance, 5, steps=AUTOMATIC, flies=True, tolerance=True),
    'explicit': Method(integrate.advance, 5, steps=EXPLICIT, flies=True, tolerance=True),
    'implicit': Method(integrate.advance, 5, steps=IMPLICIT, flies=True, tolerance=True),
    'trapezoidal': Method(trapezoidal.advance, 2, tolerance=True, step=True),
}
