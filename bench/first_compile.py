# SPDX-License-Identifier: Apache-2.0
"""
Measure the processor time of the first compilation of kernels, which other load barely affects.

Each entry point is called once, in a separate process with an empty cache; then all kernels are.
"""
import os
import subprocess
import sys
import tempfile

PROGRAM = """
import time
from dataclasses import replace
before = time.process_time()
import numba
from ballbot_ros.crossing import max_step_height, try_step
from ballbot_ros.physics import Actuation, load_robot, load_scene, simulate, Solver
from ballbot_ros.physics.simulation.solver import METHODS
imported = time.process_time()
scene, robot = load_scene('fig7_top'), load_robot('gimball')
for method in METHODS:
    for models in ('auto', 'full'):
        model = replace(scene.model, solver=Solver(method, models=models))
        run = simulate(model, scene.start, scene.actuation, 0.01)
        run.columns
    model.advance(scene.start, scene.actuation.actuator(robot), 10)
model.touches(scene.start), model.energies(scene.start)
max_step_height(robot, 0.3, accuracy=1e-3, scan=2)
try_step(robot, 0.3, 0.01)
print(imported - before, time.process_time() - imported)
"""
ENTRY = """
import time
before = time.process_time()
{imports}
imported = time.process_time()
{call}
print(imported - before, time.process_time() - imported)
"""
SCENE = 'from ballbot_ros.physics import load_scene'
NODE = 'from ballbot_ros.demo.prepare import prepare'
# Imports and call of each entry point.
ENTRIES = {
    'simulate': (SCENE, "load_scene('fig7_top').simulate(duration=0.01)"),
    'simulate, rk4': (
        f'{SCENE}, Solver\nfrom dataclasses import replace',
        "scene = load_scene('fig7_top')\n"
        "model = replace(scene.model, solver=Solver('rk4'))\n"
        "replace(scene, model=model).simulate(duration=0.01)"),
    'max_step_height': (
        'from ballbot_ros import load_robot, max_step_height',
        "max_step_height(load_robot('gimball'), 0.3, accuracy=1e-3, scan=2)"),
    'node simulator': (NODE, "prepare(['simulator'])"),
    'node controller': (NODE, "prepare(['controller'])"),
    'node obstacle_decision': (NODE, "prepare(['decision'])"),
    'node bridge': (NODE, "prepare(['bridge'])"),
}


def seconds(program=PROGRAM):
    """Return the processor time of imports, and of the compilations of a program [s]."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, '-c', program], check=True, capture_output=True, text=True,
            env={**os.environ, 'XDG_CACHE_HOME': folder,
                 'PYTHONPATH': os.pathsep.join(path for path in sys.path if path)})
    return [float(value) for value in done.stdout.split()]


def measure():
    for name, (imports, call) in ENTRIES.items():
        yield (f'first compilation of {name}', 's',
               [seconds(ENTRY.format(imports=imports, call=call))[1]], None)
    yield 'first compilation of all kernels', 's', [seconds()[1]], None
