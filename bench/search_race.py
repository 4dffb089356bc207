# SPDX-License-Identifier: Apache-2.0
"""Time the search for the highest step: ours against MuJoCo, at equal error of the height."""
import math
import time

import peers

from ballbot_ros.laboratory import twin
from ballbot_ros.laboratory.cases import Case
from ballbot_ros.physics import Solver
from ballbot_ros.physics.crossing import crosses

SPEED = 0.8
LOW, HIGH, WIDTH = 0.025, 0.04, 1e-6  # bracket of the height at the start, and its end [m]
STEPS = (1e-3, 5e-4, 2e-4, 1e-4, 5e-5)
FINEST = {'rk4': 5e-6, 'implicitfast': 5e-6, 'RK4': 2e-5}
REPEATS = 3
LEVELS = (1e-4, 1e-5)  # errors of the height [m]


def highest(passes):
    """Return the highest step by bisection [m]."""
    low, high = LOW, HIGH
    while high - low > WIDTH:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if passes(middle) else (low, middle)
    return 0.5 * (low + high)


def race(robot):
    """Yield name, unit, values and target of each measurement; set-up is timed, too."""
    def ours(step):
        return highest(lambda height: crosses(robot, SPEED, height, solver=Solver('rk4', step)))

    def theirs(step, integrator):
        return highest(lambda height: twin.Twin(
            Case(robot), SPEED, height, step, integrator, 'matched').passes())
    searches = {'rk4': ours}
    if not twin.installed():
        yield f'MuJoCo: not installed; {peers.HOW_TO_INSTALL}', '', [math.nan], None
    else:
        searches['implicitfast'] = lambda step: theirs(step, 'implicitfast')
        searches['RK4'] = lambda step: theirs(step, 'RK4')
    exact = {name: search(FINEST[name]) for name, search in searches.items()}
    curves = {name: {step: [] for step in STEPS} for name in searches}
    errors = {}
    for _ in range(REPEATS):
        for name, search in searches.items():
            for step in STEPS:
                begin = time.perf_counter()
                errors[name, step] = abs(search(step) - exact[name])
                curves[name][step].append(time.perf_counter() - begin)
    tests = 1 + math.ceil(math.log2((HIGH - LOW) / WIDTH))
    for name in searches:
        who = 'ours, rk4' if name == 'rk4' else f'MuJoCo {name}'
        yield f'highest step at {SPEED:g} m/s, {who}', 'mm', [1e3 * exact[name]], None
        for level in LEVELS:
            step = step_for(errors, name, level)
            if step is None:
                yield f'{who}: {level:g} m not reached', '', [math.nan], None
                continue
            yield f'{who}: search to {level:g} m, step {step:g} s', 'ms', [
                1e3 * value for value in curves[name][step]], None
            yield f'{who}: one crossing, {level:g} m', 'us', [
                1e6 * value / tests for value in curves[name][step]], None
            base = step_for(errors, 'rk4', level)
            if name != 'rk4' and base is not None:
                yield f'{who} / ours, search to {level:g} m', 'x', [
                    mine / own for mine, own in zip(curves[name][step], curves['rk4'][base])
                    ], -100.0


def step_for(errors, name, level):
    """Return the longest step below which all heights are within an error."""
    good = None
    for step in reversed(STEPS):
        if errors[name, step] > level:
            break
        good = step
    return good
