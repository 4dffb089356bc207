# SPDX-License-Identifier: Apache-2.0
"""Run a model from a state for a while and keep what happens."""
from typing import Callable, Optional

import numpy as np

from ballbot_ros.errors import ConfigurationError, SimulationError
from ballbot_ros.physics import contact, dynamics, integrators
from ballbot_ros.physics.actuation import Actuation
from ballbot_ros.physics.model import failure, Model, State
from ballbot_ros.physics.trajectory import Trajectory

# Rows per call into compiled code: the progress is told, and Ctrl-C heard, in between.
CHUNK = 500


def steps_in(duration: float, step: float, what: str) -> int:
    """
    Return how many steps make up a duration.

    Raises
    ------
    ConfigurationError
        If it is not a whole number of them; the message names durations that are.

    """
    steps = round(duration / step)
    if steps < 1 or abs(steps * step - duration) > 1e-6 * duration:
        below = max(1, int(duration / step))
        raise ConfigurationError(
            f'{what} must be a whole number of steps of {step:g} s, got {duration:g} s; '
            f'{below * step:g} s and {(below + 1) * step:g} s are')
    return steps


def simulate(model: Model, start: State, actuation: Actuation, duration: float,
             output_step: float = 1e-3,
             progress: Optional[Callable[[float], None]] = None) -> Trajectory:
    """
    Simulate a model.

    Parameters
    ----------
    model : Model
    start : State
        Its time counts on.
    actuation : Actuation
        Held for the whole run.
    duration : float
        [s], rounded up to a whole number of output steps.
    output_step : float
        Time between samples [s], a whole number of solver steps.
    progress : callable, optional
        Called now and then with the simulated time since the start [s].  May raise
        KeyboardInterrupt to end the run early.

    Returns
    -------
    Trajectory
        The start is its first sample.  After a KeyboardInterrupt it ends early.

    Raises
    ------
    SimulationError
        If the run cannot go on; its attribute ``trajectory`` holds what there is.
    ConfigurationError
        If steps and durations do not fit together.

    """
    if not duration > 0.0 or not np.isfinite(duration):
        raise ConfigurationError(f'duration must be above 0 s and finite, got {duration!r}')
    step = model.solver.step
    every = steps_in(output_step, step, 'output_step')
    count = int(np.ceil(duration / (every * step) - 1e-9))
    drive = actuation.drive(model.robot, start.time, start.joint_angle)
    vector = np.array(start[1:])
    rows = np.empty((1 + count, 2 + dynamics.SIZE))
    rows[0] = [*start, dynamics.drive_torque(start.time, vector, drive)]
    table, work = contact.contact_table(len(model.profile)), integrators.workspace()
    done = 0
    try:
        while done < count:
            # Times are counted from the start, so that they carry no accumulated rounding.
            begin = start.time + done * every * step
            chunk = rows[1 + done:1 + min(done + CHUNK, count)]
            filled, ending = integrators.record_run(
                integrators.METHODS.index(model.solver.method), begin, vector, step, every,
                model.numbers, model.profile, drive, table, work, chunk)
            done += filled
            if ending != integrators.FINISHED:
                error = failure(ending, start.time + (done + 1) * every * step, vector, model)
                error.trajectory = Trajectory(model, rows[:1 + done])
                raise error
            if progress is not None:
                progress(done * every * step)
    except KeyboardInterrupt:
        if done == 0:
            raise
    return Trajectory(model, rows[:1 + done])


__all__ = ['CHUNK', 'simulate', 'SimulationError', 'steps_in']
