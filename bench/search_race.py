# SPDX-License-Identifier: Apache-2.0
"""
Time the search for the maximum step height in MuJoCo and here, at equal error of the height.

MuJoCo bisects a bracket to half of the error; its step is the longest whose error is at most the
other half.  The error of each engine is relative to its own converged result.
"""
import math
import time

import peers

from ballbot_ros.crossing import max_step_height
from ballbot_ros.paper import mujoco_check
from ballbot_ros.paper.cases import Case
from ballbot_ros.studies import free_ball

SPEED = 0.8
LOW, HIGH = 0.025, 0.04  # bracket of the height at the start [m]
STEPS = (1e-3, 5e-4, 2e-4, 1e-4, 5e-5)
FINEST = {'implicitfast': 5e-6, 'RK4': 2e-5}
REPEATS = 3
LEVELS = (1e-4, 5e-5, 1e-5)  # errors of the height [m]
CONVERGED = 1e-6  # bracket for the converged result [m]


def highest(robot, step, integrator, width):
    """Return MuJoCo's maximum step height by bisection [m]; builds a model per height."""
    low, high = LOW, HIGH
    while high - low > width:
        middle = 0.5 * (low + high)
        passes = mujoco_check.MujocoRun(
            Case(robot), SPEED, middle, step, integrator, 'matched').passes()
        low, high = (middle, high) if passes else (low, middle)
    return 0.5 * (low + high)


def spent(function):
    """Return the time of one call [s]."""
    begin = time.perf_counter()
    function()
    return time.perf_counter() - begin


def race(robot):
    """Yield name, unit, values and target of each measurement; times include set-up."""
    ours = max_step_height(robot, SPEED, accuracy=1e-8)
    yield f'maximum step height at {SPEED:g} m/s, ours', 'mm', [1e3 * ours.height], None
    if not free_ball.installed():
        yield f'MuJoCo: not installed; {peers.HOW_TO_INSTALL}', '', [math.nan], None
        return
    for integrator, finest in FINEST.items():
        who = f'MuJoCo {integrator}'
        exact = highest(robot, finest, integrator, CONVERGED)
        yield f'maximum step height at {SPEED:g} m/s, {who}', 'mm', [1e3 * exact], None
        errors = {step: abs(highest(robot, step, integrator, CONVERGED) - exact)
                  for step in STEPS}
        for level in LEVELS:
            step = step_for(errors, 0.5 * level)
            if step is None:
                yield f'{who}: {level:g} m not reached', '', [math.nan], None
                continue
            times = [(spent(lambda: highest(robot, step, integrator, 0.5 * level)),
                      spent(lambda: max_step_height(robot, SPEED, accuracy=level)))
                     for _ in range(REPEATS)]
            yield f'{who}: search to {level:g} m, step {step:g} s', 'ms', [
                1e3 * theirs for theirs, _ in times], None
            yield f'ours: search to {level:g} m', 'ms', [1e3 * own for _, own in times], None
            yield f'{who} / ours, search to {level:g} m', 'x', [
                theirs / own for theirs, own in times], -100.0


def step_for(errors, level):
    """Return the longest step below which all heights are within an error."""
    good = None
    for step in reversed(STEPS):
        if errors[step] > level:
            break
        good = step
    return good
