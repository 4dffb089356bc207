# SPDX-License-Identifier: Apache-2.0
"""Run a model from a state for a while and keep what happens."""
from typing import Callable, Optional

import numpy as np

from ballbot_ros.errors import ConfigurationError, SimulationError
from ballbot_ros.physics.model.actuation import Actuation
from ballbot_ros.physics.model.state import SIZE, State
from ballbot_ros.physics.simulation.failures import (
    check_start, check_work, failure, Ledger, LEDGER_BOUND, out_of_balance)
from ballbot_ros.physics.simulation.integrator import Integrator
from ballbot_ros.physics.simulation.model import Model
from ballbot_ros.physics.simulation.trajectory import Effort, Trajectory
from ballbot_ros.physics.solvers.registry import METHODS
from ballbot_ros.physics.solvers.values import FINISHED, Output, PAUSED, Status

# Rows per call into compiled code: progress is reported, and Ctrl-C heard, in between. The run is
# the same whatever their number.
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


def output_steps(duration: float, output_step: float) -> int:
    """Return how many output steps a run takes; its duration is rounded up to them."""
    return int(np.ceil(duration / output_step - 1e-9))


def simulate_once(model: Model, start: State, actuation: Actuation, duration: float,
                  output_step: float = 1e-3,
                  progress: Optional[Callable[[float], None]] = None) -> Trajectory:
    """Simulate a model as `steps.simulate` does, looking at its energy ledger and no further."""
    if not duration > 0.0 or not np.isfinite(duration):
        raise ConfigurationError(f'duration must be above 0 s and finite, got {duration!r}')
    method, count = METHODS[model.solver.method], output_steps(duration, output_step)
    tick, every = output_step, 1
    if method.fixed:
        tick, every = model.solver.step, steps_in(output_step, model.solver.step, 'output_step')
        check_work(model.solver, count * every)
    actuator = actuation.actuator(model.robot, start.time, start.joint_angle)
    vector = np.array(start[1:])
    check_start(start.time, vector, model.robot.ball_radius, model.profile)
    rows = np.empty((1 + count, 2 + SIZE))
    rows[0] = [*start, model.torque(start, actuator)]
    end, status = start.time + count * every * tick, Status(FINISHED, start.time)
    integrator = Integrator(model.parameters, model.profile, model.solver,
                            flight=model.solver.models != 'full')
    ledger = Ledger(model.parameters, model.profile, vector)

    def so_far(samples: int) -> Trajectory:
        return Trajectory(
            model, rows[:samples], Effort(*integrator.workspace.statistics[:5].tolist()))
    try:
        while True:
            before = status.filled
            status = integrator.advance(
                actuator, vector, status, end,
                Output(rows[1:], start.time, output_step, before + CHUNK),
                model.solver.work_budget)
            done = status.filled
            if status.outcome not in (FINISHED, PAUSED):
                error = failure(status.outcome, start.time + (done + 1) * output_step, vector,
                                model.solver)
                error.trajectory = so_far(1 + done)
                raise error
            missing, where = ledger.missing(rows[1 + before:1 + done, 1:-1])
            if missing > LEDGER_BOUND:
                bad = 1 + before + where
                balance = out_of_balance(float(rows[bad, 0]), missing, model.solver)
                balance.trajectory = so_far(bad)
                raise balance
            if progress is not None:
                progress(done * output_step)
            if status.outcome == FINISHED:
                break
    except KeyboardInterrupt:
        if status.filled == 0:
            raise
    return so_far(1 + status.filled)


__all__ = ['CHUNK', 'output_steps', 'simulate_once', 'SimulationError', 'steps_in']
