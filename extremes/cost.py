# SPDX-License-Identifier: Apache-2.0
"""What the second looks cost: at runs to an accuracy, and at runs with steps of one length."""
import contextlib
from dataclasses import replace
import math
from statistics import median
import time
from unittest import mock

from ballbot_ros.config.files import shipped_files
from ballbot_ros.physics import load_scene, simulate, Solver
from ballbot_ros.physics.simulation import run

LEVELS = (1e-4, 1e-6)
REPEATS = 15


def to_accuracy(scene, level):
    """Return the evaluations of a run to an accuracy, without the second looks and with."""
    def work():
        return simulate(
            scene.model, scene.start, scene.actuation, scene.run.duration, scene.run.output_step,
            accuracy=level).effort.evaluations
    after = work()
    with contextlib.ExitStack() as without:
        for where, what, instead in (
                (run, 'AGREEMENT_FACTOR', 1.0), (run, 'RUNAWAY', math.inf),
                (run._Runs, 'confirmed', lambda _, fine, assured: assured)):
            without.enter_context(mock.patch.object(where, what, instead))
        return work(), after


def with_steps(scene, method):
    """Return the time of a run with steps of 0.1 ms, without the check and with it [s]."""
    model = replace(scene.model, solver=Solver(method, 1e-4))
    least = {run.run_once: float('inf'), simulate: float('inf')}
    for _ in range(REPEATS):
        for way in least:
            begin = time.process_time()
            way(model, scene.start, scene.actuation, scene.run.duration, scene.run.output_step)
            least[way] = min(least[way], time.process_time() - begin)
    return tuple(least.values())


def report():
    """Print the ratios of what it costs with the second look to what it cost without."""
    scenes = {path.stem: load_scene(path.stem)
              for path in shipped_files('scenes')}
    for what, kinds, of, unit in (
            ('accuracy', LEVELS, to_accuracy, 'function evaluations'),
            ('steps of 0.1 ms', ('rk4', 'semi_implicit'), with_steps, 'processor time')):
        for kind in kinds:
            ratios = {}
            for name, scene in scenes.items():
                before, after = of(scene, kind)
                ratios[name] = after / before
            worst = max(ratios, key=ratios.get)
            print(f'{what}, {kind}: {unit} x {median(ratios.values()):.3f} at the median of '
                  f'{len(ratios)} scenes, x {ratios[worst]:.3f} at most ({worst})', flush=True)
