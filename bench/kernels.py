# SPDX-License-Identifier: Apache-2.0
"""Time the numerical core: right-hand side, integration step, one second of a crossing."""
import time

import numpy as np

from ballbot_ros.crossing import held_at
from ballbot_ros.jit import COMPILED, compiled
from ballbot_ros.physics import Actuation, load_robot, Model, Solver, Terrain
from ballbot_ros.physics.mechanics import contact, equations
from ballbot_ros.physics.mechanics.equations import System
from ballbot_ros.physics.mechanics.modes import find_mode
from ballbot_ros.physics.model.state import SIZE, X, Y
from ballbot_ros.physics.simulation.solver import Integrator
from ballbot_ros.physics.solvers.controller import step, STEP_METHODS
from ballbot_ros.physics.solvers.values import (
    EVALUATIONS, FINISHED, NOTHING, Output, Status, Workspace)

REPEATS = 15
CALLS = 100_000 if COMPILED else 300
STEP = 1e-3  # [s]


@compiled
def call_often(calls, state, system, mode, rates):
    """Call the right-hand side; each call depends on the last, so none is optimized away."""
    for _ in range(calls):
        equations.derivative(0.0, state, system, mode, rates)
        state[X] += 1e-15 * rates[Y]


@compiled
def step_often(calls, number, state, system, workspace):
    """Repeat an integration step from the same state, up to rounding."""
    find_mode(0.0, state, system, workspace.mode)
    workspace.statistics[EVALUATIONS] = 0
    for _ in range(calls):
        stiffness, _ = step(number, 0.0, state, STEP, NOTHING, system, workspace)
        state[X] += 1e-15 * stiffness


def times(function):
    """Return the wall times of REPEATS calls, after one to warm up [s]."""
    function()
    found = []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        function()
        found.append(time.perf_counter() - begin)
    return found


def crossing():
    """Return a model with a 31 mm step, and a start half a second before it at 0.8 m/s."""
    model = Model(load_robot('gimball'), Terrain.step(0.031, at=0.5), solver=Solver('rk4', 1e-4))
    return model, model.at_rest(0.0, speed=0.8)


def right_hand_side(actuation):
    """Return repeated measurements of the time of one right-hand side [s]."""
    model, start = crossing()
    vector, rates = np.array(start[1:]), np.zeros(SIZE)
    system = System(model.parameters, model.profile, actuation.actuator(model.robot))
    mode = contact.ContactMode.of(len(model.profile))
    return [spent / CALLS for spent in times(lambda: call_often(
        CALLS, vector, system, mode, rates))]


def step_times():
    """Return the times of an integration step of each method per right-hand side [s]."""
    model, start = crossing()
    vector, workspace = np.array(start[1:]), Workspace.of(len(model.profile))
    system = System(model.parameters, model.profile, Actuation().actuator(model.robot))
    found = {}
    for number, name in enumerate(STEP_METHODS):
        spent = times(lambda: step_often(
            CALLS // 10, number, vector, system, workspace))
        calls = int(workspace.statistics[EVALUATIONS])
        found[name] = [item / calls for item in spent]
    return found


def one_second():
    """Return repeated times of one simulated second with RK4 at 1e-4 s [s]."""
    model, start = crossing()
    integrator = Integrator(model.parameters, model.profile, model.solver_in_use)
    actuator = Actuation().actuator(model.robot)
    output = Output(np.empty((1000, 2 + SIZE)), 0.0, 1e-3)

    def run():
        integrator.advance(
            actuator, np.array(start[1:]), Status(FINISHED, 0.0), 1.0, output)
    return times(run)


def measure():
    yield 'right-hand side, pendulum free', 'ns', [
        1e9 * value for value in right_hand_side(Actuation())], 100.0
    yield 'right-hand side, pendulum held by (11)', 'ns', [
        1e9 * value for value in right_hand_side(held_at(0.0))], 100.0
    for name, values in step_times().items():
        yield f'step, {name}, for each right-hand side', 'ns', [
            1e9 * value for value in values], None
    yield 'one second of crossing, RK4 at 1e-4 s', 'ms', [
        1e3 * value for value in one_second()], 6.0
