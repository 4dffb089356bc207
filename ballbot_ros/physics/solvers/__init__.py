# SPDX-License-Identifier: Apache-2.0
"""
From one state to a later one: methods, step sizes, events.

**A solver is a file with one function**::

    advance(call) -> PackedStatus

``values.named(call)`` gives its status, end, state, system, options, output and workspace.  It
takes `state`, a (13,) array at ``status.time``, to the time `end` in place; fills those rows of
`output` whose time it passes, beginning with number ``status.filled``; and returns where it came,
with FINISHED or the reason why it cannot go on.  Where ``output.pause`` rows are filled, it
returns PAUSED between two steps; called again with that status, same arrays, it goes on as if it
had not: who looks on does not change the numbers.  It adds its steps and right-hand sides to
``workspace.statistics``, works in the other arrays of the workspace, and makes none.  The types
are those of `values`; right-hand sides are `mechanics.equations.derivative`, or `mode_derivative`
of a mode that is frozen.  To add one, copy ``rk4.py``, and add its line to `registry.METHODS`.

**A step of the adaptive method is a file with two functions** (`dormand_prince`, `rodas5p`)::

    step(time, state, size, system, workspace)  # from state and F0, the rates there, to END and
                                                # ERROR
    prepare_dense(size, workspace)              # to DENSE, for `dense.motion_at`

These are `rows` of `Workspace.work`, and hold the motion alone; the energy ledger is an integral
along it, for who asks for it (``Options.ledger``).

Which of them the next step is, and how long, says the `controller`: a value that each rule
returns anew.  Where within a step the contact law has a kink say the `events`.  `integrate` is
the loop over these three.
"""
