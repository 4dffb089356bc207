# SPDX-License-Identifier: Apache-2.0
"""
Verify that the true error is below the requested `accuracy`.

Random scenes are run at four accuracies and compared with a reference at 1e-9 m. A scene whose
reference has a horizon below half its duration is chaotic and excluded; a run with a limited
horizon is compared up to that time.
"""
import time

import numpy as np
from random_scenes import DURATION, random_scene

from ballbot_ros.physics.simulation.run import simulate

LEVELS = (1e-3, 1e-4, 1e-5, 1e-6)
SCENES = 1000


def measure():
    ratios, spent = {level: [] for level in LEVELS}, {level: [] for level in LEVELS}
    chaotic = 0
    for seed in range(SCENES):
        model, start, actuation = random_scene(seed)
        exact = simulate(model, start, actuation, DURATION, accuracy=1e-9)
        if exact.assurance.horizon < 0.5 * DURATION:
            chaotic += 1
            continue
        for level in LEVELS:
            begin = time.perf_counter()
            found = simulate(model, start, actuation, DURATION, accuracy=level)
            spent[level].append(1e3 * (time.perf_counter() - begin))
            until = min(found.assurance.horizon, exact.assurance.horizon) + 1e-9
            held = found['time'] <= until
            gap = np.hypot(found['x'] - exact['x'], found['y'] - exact['y'])[held]
            ratios[level].append(float(np.max(gap)) / level)
    for level in LEVELS:
        kept = 100.0 * np.mean(np.array(ratios[level]) <= 1.0)
        yield f'accuracy {level:g} m: kept in random scenes', '%', [kept], -99.0
        yield f'accuracy {level:g} m: worst error over accuracy', '1', [max(ratios[level])], 10.0
        yield f'accuracy {level:g} m: wall time of {DURATION:g} s', 'ms', spent[level], None
    yield f'scenes of {SCENES} without a reference, chaotic', '', [chaotic], None
