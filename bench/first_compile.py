# SPDX-License-Identifier: Apache-2.0
"""
Time the first compilation of all kernels, in processor time: others may use the machine, too.

Each entry into compiled code is called once, in a process of its own with an empty cache.
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
from ballbot_ros.physics.solvers.registry import METHODS
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


def seconds():
    """Return the processor time of imports, and of all compilations [s]."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, '-c', PROGRAM], check=True, capture_output=True, text=True,
            env={**os.environ, 'XDG_CACHE_HOME': folder,
                 'PYTHONPATH': os.pathsep.join(path for path in sys.path if path)})
    return [float(value) for value in done.stdout.split()]


def measure():
    """Yield name, unit, values and target of each measurement."""
    yield 'first compilation of all kernels', 's', [seconds()[1]], None
