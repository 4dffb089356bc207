# SPDX-License-Identifier: Apache-2.0
"""Which integrator a run takes, and how finely."""
from dataclasses import dataclass

from ballbot_ros.config.fields import Checked, count, quantity, text
from ballbot_ros.physics.solvers.registry import METHODS

MODELS = ('auto', 'full')
# Largest error of position [m]: the default, and what can be asked for.
ACCURACY, SMALLEST, LARGEST = 1e-5, 1e-9, 0.1


@dataclass(frozen=True, repr=False)
class Solver(Checked):
    """
    Integrator and its step sizes or tolerance.

    ``semi_implicit`` and ``rk4`` are fixed-step methods.

    ``adaptive`` controls its steps by their estimated local error and locates every event of the
    contact law; it switches between explicit and L-stable implicit steps by cost, and
    ``explicit`` and ``implicit`` use one of the two alone; see `solvers.integrate`.

    ``trapezoidal`` is the rule of the paper, with a maximum step; see `solvers.trapezoidal`.
    """

    method: str = text('integrator', default='rk4', choices=METHODS)
    step: float = quantity(
        's', 'integration step of a method with steps of one length; the largest of trapezoidal',
        default=1e-4, above=0.0, maximum=0.1)
    tolerance: float = quantity(
        'm', 'local error per step of a method that chooses its steps', default=1e-9,
        minimum=1e-14, maximum=1e-3)
    models: str = text(
        'what a method that chooses its steps may simulate: full, always the full model; auto, '
        'flight in closed form where that is exact', default='auto', choices=MODELS)
    work_budget: int = count(
        'function evaluations that one run may take before it is given up; the default is some '
        'minutes of work', default=10_000_000_000, minimum=1, maximum=10**15)


# Solvers with a name; `paper` is table 1 of the paper.
PRESETS = {'paper': Solver('trapezoidal', step=1e-3, tolerance=1e-9)}
