# SPDX-License-Identifier: Apache-2.0
"""
Values of a solver: options, output, controller, status, workspace, and the rows in it.

An adaptive step works in rows of numbers.  A row holds a motion (four coordinates, four
velocities) or its change, and space for the energy ledger behind it; all rows are in one array,
`Workspace.work`, each at its own offset: ``work[PROBE:]`` starts with the row PROBE.  Sums of rows
are half of the work of a step.
"""
from typing import Any, NamedTuple

import numpy as np

from ballbot_ros.jit import compiled, in_python, packer, row_sum, unpacker
from ballbot_ros.physics.mechanics.contact import ContactMode, ground_height, IntArray
from ballbot_ros.physics.mechanics.equations import is_finite, System
from ballbot_ros.physics.mechanics.modes import jacobian_table
from ballbot_ros.physics.model.state import SIZE, X, Y
from ballbot_ros.physics.model.terrain import Array

# The outcome of a run.
FINISHED, NOT_FINITE, PENETRATED, STEP_TOO_SMALL, BUDGET_EXCEEDED, PAUSED = range(6)


@compiled
def outcome_of(state: Array, ground: Array) -> int:
    """Return the outcome of a run in a state, FINISHED if it can continue."""
    if not is_finite(state):
        return NOT_FINITE
    return PENETRATED if state[Y] <= ground_height(ground, state[X]) else FINISHED


# Counters of `Workspace.statistics`: steps, rejected steps, events, right-hand sides, flights in
# closed form, and the cost of the search among many features of the ground in right-hand sides.
STEPS, REJECTED, EVENTS, EVALUATIONS, FLIGHTS, SEARCH = range(6)

AUTOMATIC = -1  # in place of the number of a step in `controller.STEP_METHODS`: choice by cost

SMALLEST_STEP = 1e-14  # [s], relative to times above 1 s
STABLE = 3.3  # step times rate of the fastest decay from which explicit steps diverge

# Content of the workspace at the start of a step: nothing, the rates F0, or F0 and the Jacobian.
NOTHING, RATES, JACOBIAN = range(3)

MOTION = 8  # numbers of a motion
ALONE = np.array([1.0])  # the factor of a single row
WIDTH = 16  # of a row

# Rows of `Workspace.work`, by their offsets.
(ZERO,   # nothing but zeros
 START,  # the motion at the start of the step
 END,    # and at its end
 RIGHT,  # the right-hand side of a stage
 ERROR,  # the estimated error of the motion at the end
 PROBE,  # a state within the step
 F0,     # the rates at the start; a stage of the explicit method
 STAGES,  # eight of them
 _, _, _, _, _, _, _,
 DENSE,  # five of them: coefficients of the dense output, see `dense.interpolate`
 _, _, _, _,
 COLUMNS,  # eight of them, of the matrix that solves a stage, see `rodas5p.invert`
 _, _, _, _, _, _, _,
 FACTORS,  # of a sum
 ROWS) = (WIDTH * row for row in range(30))

# See `jit.row_sum`.
sum_rows = row_sum(MOTION, WIDTH)


class Options(NamedTuple):
    """Options of a solver."""

    tolerance: float  # local error of a step, see `controller.error_length` [m]
    step: float  # of a fixed-step method; maximum step of `trapezoidal` [s]
    method: int = AUTOMATIC  # number of the step in the table of a fixed-step or adaptive method
    budget: int = 2**62  # of right-hand sides, counted in the statistics
    flight: bool = False  # whether to fly in closed form
    ledger: bool = True  # whether the adaptive method keeps the energy ledger


class Output(NamedTuple):
    """Output rows of time, state and torque: row i is for begin + (i + 1) interval."""

    rows: Array  # (n, 15)
    begin: float  # [s]
    interval: float  # [s]
    pause: int = 2**62  # number of filled rows after which the run returns PAUSED


class StepController(NamedTuple):
    """State of the step size control; see `controller`."""

    step: float = 0.0  # to try next [s]; 0 to choose
    implicit: bool = False  # whether steps are implicit
    on_trial: bool = False  # whether the next step is an implicit trial step
    explicit_step: float = 0.0  # step size to return to after a failed trial [s]
    stiff_steps: int = 0  # stiffness count since the last trial, see `controller`
    trial_after: int = 0  # stiffness count that triggers the next trial


class EventRate(NamedTuple):
    """Numbers of events in quick succession; see `events`."""

    chattering: int = 0  # within CHATTER
    crowded: int = 0  # within SOON of a step
    stuck: int = 0  # without time between them


class Status(NamedTuple):
    """State of a run, from which it continues with identical results."""

    outcome: int  # FINISHED, PAUSED, or the failure
    time: float  # reached [s]
    filled: int = 0  # rows of the output
    controller: StepController = StepController()
    rate: EventRate = EventRate()
    has_mode: bool = False  # whether the workspace holds the mode of the state
    ready: int = NOTHING  # valid data in the workspace for the next step
    may_fly: bool = True  # not just after a rejected flight
    before: float = 0.0  # the previous step, for a multistep method [s]

    @property
    def plain(self) -> 'Packed':
        """Return plain tuples, as arguments of a solver."""
        return _pack_status(self)


# Between Python and a solver all tuples are plain. numba takes half a microsecond to recognise
# each of the ten named tuples; and it creates one by calling its class, Python code in which a
# pending Ctrl-C raises an exception, so that numba crashes.  A slice of a named tuple,
# ``options[:]``, is plain, too.
Packed = tuple[Any, ...]
packed = packer(Status)
_pack_status = in_python(packed)
status_of = in_python(unpacker(Status))  # result of a solver in Python


@compiled
def status_at(time: float, outcome: int, filled: int) -> Status:
    """Return the status of a run at a time [s], with nothing to continue from but the state."""
    return Status(outcome, time, filled, StepController(0.0, False, False, 0.0, 0, 0),
                  EventRate(0, 0, 0), False, NOTHING, True, 0.0)


class Workspace(NamedTuple):
    """The work arrays of the solvers; one set for each thread."""

    mode: ContactMode
    work: Array  # all rows, see above
    jacobian: Array  # see `modes.write_jacobian`
    violated: IntArray  # kind and item of each violated guard
    statistics: IntArray  # (6,): counts since the creation of the workspace

    @classmethod
    def of(cls, vertices: int) -> 'Workspace':
        """Return the workspace for a terrain with a number of vertices."""
        return cls(ContactMode.of(vertices), np.zeros(ROWS), jacobian_table(),
                   np.zeros((4 * vertices + 8, 2), dtype=np.int64), np.zeros(6, dtype=np.int64))

    @property
    def plain(self) -> Packed:
        """Return plain tuples, as arguments of a solver."""
        return _pack_workspace(self)


_pack_workspace, unpack_workspace = in_python(packer(Workspace)), unpacker(Workspace)


class Call(NamedTuple):
    """Arguments of a solver from Python, as plain tuples; see `solvers`."""

    status: Status
    end: float  # [s]
    state: Array
    system: System
    options: Options
    output: Output
    workspace: Workspace


unpack_call = unpacker(Call)
NO_OUTPUT = Output(np.zeros((0, 2 + SIZE)), 0.0, 1.0)
