# SPDX-License-Identifier: Apache-2.0
"""
From one state to a later one: methods, step sizes, events.

**A solver is a file with one function**::

    advance(call) -> status

``values.named(call)`` gives its status, end, state, system, options, output and workspace.  It
takes `state`, a (13,) array at ``status.time``, to the time `end` in place; fills those rows of
`output` whose time it passes, beginning with number ``status.filled``; and returns where it came,
with FINISHED or the reason why it cannot go on.  Where ``output.pause`` rows are filled, it
returns PAUSED between two steps; called again with that status, same arrays, it goes on as if it
had not: who looks on does not change the numbers.  It adds its steps and right-hand sides to
``workspace.statistics``, works in the other arrays of the workspace, and makes none.  The types
are those of `values`; right-hand sides are `mechanics.equations.derivative`, or `mode_derivative`
of a mode that is frozen.  To add one, copy ``rk4.py``, and add its line to `registry.METHODS`.

**A step of the adaptive method is a file with three functions** (`dormand_prince`, `rodas5p`),
entered in `step_methods`::

    step(time, state, size, ready, system, workspace) -> stiffness
    prepare_dense(size, workspace)
    end_step(workspace) -> ready

`step` writes the motion after `size` seconds to END and its estimated error to ERROR.  `ready` is
what the workspace holds of the state that it starts from (NOTHING, RATES: F0, JACOBIAN: both); all
of it is valid after a step, too, which may be rejected and repeated.  The *stiffness* is the step
over the longest stable one of an explicit method.  `prepare_dense` writes the dense output of an
accepted step to DENSE, see `dense.motion_at`.  `end_step` makes ready what the next step needs,
where it starts at END.

END, ERROR, F0 and DENSE are `rows` of `Workspace.work` and hold the motion alone; the energy
balance is an integral along it (``Options.ledger``).  What survives between two calls of a solver
is in `Status`; its `begun` and `ready` state which arrays of the workspace are still valid.

The `controller`, a value that each rule returns anew, chooses length and method of the next step.
`events` locates the kinks of the contact law within a step.  `integrate` is the loop over these
three.
"""
