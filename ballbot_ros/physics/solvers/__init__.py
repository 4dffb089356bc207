# SPDX-License-Identifier: Apache-2.0
"""
Integration of the equations of motion: methods, step size control, events.

**A solver is a file with one function**::

    advance(call) -> status

``values.unpack_call(call)`` gives its status, end, state, system, options, output and workspace.
It advances `state`, a (13,) array at ``status.time``, to the time `end` in place; fills those rows
of `output` whose time it passes, starting with row ``status.filled``; and returns the reached
time, with FINISHED or the reason of a failure.  After ``output.pause`` filled rows it returns
PAUSED between two steps; called again with that status and the same arrays, it continues, and
pausing does not change the results.  It adds its steps and right-hand sides to
``workspace.statistics``, works in the other arrays of the workspace, and allocates none.  Its
types are those of `values`; right-hand sides are `mechanics.equations.derivative`, or
`mode_derivative` of a frozen mode.  To add a solver, add its file, and its line to
`simulation.solver.METHODS`.

**A step of a fixed-step method is a file with a function and a constant** (`rk4`,
`semi_implicit`), entered in `fixed_step.FIXED_STEP_METHODS`::

    step(time, state, size, system, workspace)
    EVALUATIONS

`step` advances `state` in place by `size` seconds with EVALUATIONS right-hand sides.

**A step of the adaptive method is a file with three functions and a constant**
(`dormand_prince`, `rodas5p`), entered in `controller.STEP_METHODS`::

    step(time, state, size, ready, system, workspace) -> stiffness, ready
    prepare_dense(size, workspace)
    end_step(workspace) -> ready
    DAMPS

`step` writes the motion after `size` seconds to END and its estimated error, proportional to the
fifth power of the size, to ERROR.  `ready` is the content of the workspace at the start state
(NOTHING, RATES: F0, JACOBIAN: both), before and after the step, which may be rejected and
repeated.  The *stiffness* is the ratio of the step to the longest stable explicit step.
`prepare_dense` writes the dense output of an accepted step to DENSE, see `dense.motion_at`.
`end_step` prepares the workspace for the next step, which starts at END.  DAMPS states whether the
step is L-stable and uses the Jacobian: then `controller` does not limit it by its stiffness, and
does not choose it in a mode with a CORNER.

END, ERROR, F0 and DENSE are rows of `Workspace.work`, see `values`, and hold only the motion; the
energy balance is an integral along it (``Options.ledger``).  The state between two calls of a
solver is in `Status`; its `has_mode` and `ready` state which arrays of the workspace are still
valid.

The `controller`, an immutable value, chooses length and kind of the next step.  `events` locates
the events of the contact law within a step.  `integrate` is the loop over these three.
"""
