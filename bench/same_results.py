# SPDX-License-Identifier: Apache-2.0
"""
Verify that a change of the code keeps all results bit-identical.

    .venv/bin/python bench/same_results.py --write before.json     # before the change
    .venv/bin/python bench/same_results.py --against before.json   # after it

Runs every scene with every method, random scenes, control periods and searches for the maximum
step height.  Prints the cases that differ in rows, statistics or errors, and then exits with 1.
"""
import argparse
from dataclasses import replace
import hashlib
import json
from pathlib import Path
import sys

import numpy as np
from random_scenes import DURATION, random_scene

from ballbot_ros.config.files import shipped_files
from ballbot_ros.crossing import cruising, held_at, max_step_height, rolling, Rules, Site, try_step
from ballbot_ros.errors import SimulationError
from ballbot_ros.physics import (
    Actuation, ContactOptions, load_robot, load_scene, Model, simulate, Solver, Terrain)
from ballbot_ros.physics.simulation.solver import METHODS

RANDOM_SCENES = 40


def digest(values):
    """Return a short digest of the bits of numbers."""
    return hashlib.sha256(np.ascontiguousarray(values, dtype=float).tobytes()).hexdigest()[:16]


def said(trajectory):
    """Return all values of a trajectory, bit-exact."""
    columns = np.array(list(trajectory.columns.values()))
    last = trajectory.state(len(trajectory) - 1)
    return [len(trajectory), digest(trajectory.rows), digest(columns),
            [value.hex() for value in trajectory.rows[-1].tolist()], list(trajectory.effort),
            list(trajectory.assurance or ()),
            [list(touch) for touch in trajectory.model.touches(last)],
            list(trajectory.model.energies(last))]


def outcome(run):
    """Return the values of a run, or its error."""
    try:
        return said(run())
    except SimulationError as error:
        trajectory = getattr(error, 'trajectory', None)
        return ['failed', type(error).__name__, error.time,
                said(trajectory) if trajectory is not None else None]


def variants():
    """Yield name and solver of each variant of a run."""
    for method, described in METHODS.items():
        yield method, Solver(method, models='full')
        if not described.fixed:
            yield f'{method} coarse', Solver(method, 1e-3, 1e-6, 'full')
        if described.flies:
            yield f'{method} auto', Solver(method, models='auto')
            yield f'{method} auto coarse', Solver(method, tolerance=1e-5, models='auto')


def scenes():
    """Yield name and outcome of each scene that comes with the package."""
    for path in shipped_files('scenes'):
        name, scene = path.stem, load_scene(path.stem)
        for way, solver in variants():
            for step in (1e-3, 1e-2):
                model = replace(scene.model, solver=solver)
                yield f'{name}, {way}, {step:g} s', outcome(lambda: simulate(
                    model, scene.start, scene.actuation, scene.run.duration, step))
        times = []
        model = replace(scene.model, solver=Solver('adaptive'))
        yield f'{name}, with progress', outcome(lambda: simulate(
            model, scene.start, scene.actuation, scene.run.duration, 1e-3, progress=times.append))
        yield f'{name}, progress', [value.hex() for value in times]
        for models in ('auto', 'full'):
            model = replace(scene.model, solver=Solver(models=models))
            yield f'{name}, to 1e-4 m, {models}', outcome(lambda: simulate(
                model, scene.start, scene.actuation, scene.run.duration, accuracy=1e-4))


def random_scenes():
    """Yield name and outcome of random scenes."""
    for seed in range(RANDOM_SCENES):
        model, start, actuation = random_scene(seed)
        for way, solver in variants():
            chosen = replace(model, solver=solver)
            yield f'random {seed}, {way}', outcome(lambda: simulate(
                chosen, start, actuation, DURATION))
        small = replace(model, solver=Solver('adaptive', work_budget=500))
        yield f'random {seed}, small budget', outcome(lambda: simulate(
            small, start, actuation, DURATION))


def periods():
    """Yield name and outcome of runs in control periods, each with its torque."""
    robot = load_robot('gimball')
    for method in METHODS:
        model = Model(robot, Terrain.step(0.021, at=0.6), solver=Solver(method))
        state = model.at_rest(0.0, 0.8)
        for period in range(200):
            law = Actuation('torque', torque=0.5 * np.sin(0.1 * period))
            state = model.advance(state, law.actuator(robot), 50)
        yield f'periods, {method}', [value.hex() for value in state]


def searches():
    """Yield name and outcome of searches for the maximum step height, and single attempts."""
    gimball, shellball = load_robot('gimball'), load_robot('shellball')
    table = [(shellball, 'free', Actuation()), (gimball, 'free', Actuation()),
             (gimball, 'held', held_at(np.pi / 2)), (gimball, 'rolling', rolling(gimball)),
             (gimball, 'voltage', cruising(gimball))]
    for robot, law, actuation in table:
        for speed in (0.3, 0.6, 0.9):
            chosen = actuation if isinstance(actuation, Actuation) else actuation(speed)
            for site, rules, scan in ((Site(), Rules(), 0),
                                      (Site(0.05, -0.05), Rules('any', 2.0, 0.01), 4)):
                found = max_step_height(
                    robot, speed, chosen, site=site, rules=rules, scan=scan)
                yield (f'{robot.name}, {law}, {speed:g} m/s, scan {scan}',
                       [found.height.hex(), found.error.hex(), *found[3:]])
            over, score = try_step(robot, speed, 0.02, chosen, options=ContactOptions(
                slip_lever='radius', friction_ramp='smooth'))
            yield f'{robot.name}, {law}, {speed:g} m/s, 20 mm', [over, score.hex()]


def differences(before, after):
    """Return the names of the differing cases with their differing parts."""
    return [f'{name}: {before.get(name)} -> {after.get(name)}'
            for name in sorted({*before, *after})
            # Compared as JSON, which has no tuples.
            if json.dumps(before.get(name)) != json.dumps(after.get(name))]


def main():
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    task = parser.add_mutually_exclusive_group(required=True)
    task.add_argument('--write', type=Path, metavar='FILE')
    task.add_argument('--against', type=Path, metavar='FILE')
    arguments = parser.parse_args()
    results = {}
    for part in (scenes, random_scenes, periods, searches):
        results.update(part())
    if arguments.write is not None:
        arguments.write.write_text(json.dumps(results, indent=0))
        print(f'{len(results)} cases written to {arguments.write}')
        return 0
    found = differences(json.loads(arguments.against.read_text()), results)
    print(*found, sep='\n')
    print(f'{len(results)} cases, {len(found)} differ')
    return 1 if found else 0


if __name__ == '__main__':
    sys.exit(main())
