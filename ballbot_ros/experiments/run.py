# SPDX-License-Identifier: Apache-2.0
"""Run an experiment into a folder with its bags, inputs, versions, results and digests."""
from functools import partial
import hashlib
from importlib.metadata import PackageNotFoundError, version
import json
from pathlib import Path
import platform
from shlex import quote
import shutil
from typing import Any, Dict, List, Optional, Tuple

import numpy as np

from ballbot_ros import __version__
from ballbot_ros.bags.metadata import bag_metadata, SIMULATOR
from ballbot_ros.bags.opener import open_bag
from ballbot_ros.bags.recorded_run import read_run, recorded_trajectory, stamp_of
from ballbot_ros.config.optional import load_optional
from ballbot_ros.errors import ConfigurationError, RefusedError
from ballbot_ros.experiments.file import Experiment, FILE, freeze, load_experiment, node_parameters
from ballbot_ros.physics import load_scene, Scene
from ballbot_ros.results.digests import digest, LENGTH
from ballbot_ros.results.faces import meet_faces
from ballbot_ros.results.files import (
    check_writable, write_columns, write_json, write_text)
from ballbot_ros.results.summary import plain as as_json_types
from ballbot_ros.ros.topics import plain

RESULT, TABLE, VERSIONS = 'numbers.json', 'results.csv', 'versions.json'


def run_experiment(target: str, out: Optional[Path], quiet: bool, timeout: float) -> bool:
    """
    Run an experiment file, or repeat the folder of a run; return False if repeated numbers differ.

    Completed seeds are kept; the folder of a seed is complete or absent.  A new experiment is
    written to `out`, ``ballbot_output/experiments/NAME`` by default; the timeout is wall time per
    seed [s].  Raises `ConfigurationError` if the file is invalid, or the folder contains another
    experiment.
    """
    say = (lambda *_: None) if quiet else partial(print, flush=True)
    path = Path(target)
    if path.is_dir():
        if out is not None:
            raise ConfigurationError(
                f'--out requires the file of an experiment; {path} is a folder, which is repeated '
                'in place', 'inconsistent', '--out')
        if not (path / FILE).is_file():
            raise ConfigurationError(
                f'{path}: contains no {FILE}: it is not a folder of an experiment',
                'wrong_kind', 'experiment')
        folder, plan = path, load_experiment(path / FILE)
        if all(_done(folder, seed) for seed in plan.seeds):
            return _repeat(folder, plan, timeout, say)
    else:
        folder = out or Path('ballbot_output') / 'experiments' / path.stem
        plan = _copy_inputs(load_experiment(path), folder)
    return _run_missing(folder, plan, timeout, say)


def _done(folder: Path, seed: int) -> bool:
    return (folder / f'seed_{seed}' / RESULT).is_file()


def _copy_inputs(plan: Experiment, folder: Path) -> Experiment:
    """Copy all inputs into a folder, and return the experiment read from it."""
    files = freeze(plan)
    check_writable(folder / FILE)
    for name, text in files.items():
        file = folder / name
        if (folder / FILE).is_file() and (
                not file.is_file() or file.read_text(encoding='utf-8') != text):
            raise ConfigurationError(
                f'{folder}: contains another experiment ({name} differs); choose another folder '
                'with --out, or remove this one', 'exists', '--out')
    for name, text in sorted(files.items(), key=lambda item: item[0] == FILE):
        write_text(text, folder / name)
    return load_experiment(folder / FILE)


def _run_missing(folder: Path, plan: Experiment, timeout: float, say: Any) -> bool:
    """Run the missing seeds, and write the table of all seeds."""
    left = [seed for seed in plan.seeds if not _done(folder, seed)]
    if len(left) < len(plan.seeds):
        say(f'{len(plan.seeds) - len(left)} of {len(plan.seeds)} seeds were already complete')
    if left:
        _prepare(plan)
        write_json(versions(), folder / VERSIONS)
    for seed in left:
        result = _run_seed(folder, plan, seed, timeout)
        say(f'seed {seed}: {words(result)}')
    results = [json.loads((folder / f'seed_{seed}' / RESULT).read_text(encoding='utf-8'))
               for seed in plan.seeds]
    write_table(results, folder / TABLE)
    say(f'Written to {folder}: {TABLE}, {VERSIONS}, a folder for each seed with its bag.  To '
        f'repeat and compare: ballbot run {quote(str(folder))}')
    return True


def _prepare(plan: Experiment) -> None:
    """Compile the kernels before timeouts start; raise `ConfigurationError` without ROS."""
    load_optional(
        'ballbot_ros.experiments.lockstep', 'ROS', 'source /opt/ros/jazzy/setup.bash, or use the '
        '.venv of a checkout (make setup)', 'an experiment')
    if 'obstacle_decision' in plan.nodes:  # the other nodes start quickly
        from ballbot_ros.demo.prepare import prepare
        prepare(('simulator', 'controller', 'decision'))


def _run_seed(folder: Path, plan: Experiment, seed: int, timeout: float) -> dict[str, Any]:
    """Run one seed into its folder, which appears when it is complete; return the result."""
    from ballbot_ros.experiments.lockstep import run_lockstep
    draft, failed = folder / f'.seed_{seed}.part', folder / f'seed_{seed}_failed'
    for old in (draft, failed):
        shutil.rmtree(old, ignore_errors=True)
    scene = load_scene(plan.scene, plan.robot or None)
    nodes = node_parameters(plan, seed)
    try:
        run_lockstep(draft, nodes, plan.periods,
                     bag_metadata(SIMULATOR, nodes['simulator'], scene,
                                  nodes.get('obstacle_decision')), timeout)
        found = sorted(read_digests(draft / 'bag', round(plan.duration * 1e9)).items())
        result: dict[str, Any] = as_json_types({
            'seed': seed, 'numbers': numbers_of(draft / 'bag', scene),
            'digests': {name: hashlib.sha256(''.join(
                f'{stamp}{text}' for stamp, text in sorted(messages.items())).encode()
                ).hexdigest()[:LENGTH] for name, messages in found},
            'messages': {name: len(messages) for name, messages in found}})
        write_json(result, draft / RESULT)
        draft.rename(folder / f'seed_{seed}')
    except RefusedError as error:
        draft.rename(failed)
        # The logs have been moved with the folder.
        raise RefusedError(
            str(error).replace(str(draft), str(failed)), error.reason, error.field) from error
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    return result


def _repeat(folder: Path, plan: Experiment, timeout: float, say: Any) -> bool:
    """Run all seeds again, in a subfolder; return whether the numbers are the same."""
    _prepare(plan)
    file = folder / VERSIONS
    before = json.loads(file.read_text(encoding='utf-8')) if file.is_file() else {}
    for name, now in versions().items():
        if before.get(name, now) != now:
            say(f'{name} was {before[name]}, is {now}')
    again, same = folder / 'again', True
    shutil.rmtree(again, ignore_errors=True)
    try:
        for seed in plan.seeds:
            old = json.loads((folder / f'seed_{seed}' / RESULT).read_text(encoding='utf-8'))
            new = _run_seed(again, plan, seed, timeout)
            if new == old:
                say(f'seed {seed}: the same in {sum(new["messages"].values())} messages')
                continue
            same, until = False, round(plan.duration * 1e9)
            first = first_difference(*(
                read_digests(where / f'seed_{seed}' / 'bag', until) for where in (folder, again)))
            say(f'seed {seed}: differs' + (
                f' from t = {1e-9 * first[0]:.3f} s on, first on {first[1]}' if first else
                f'; the bag is the same, but {RESULT} is not'))
    finally:
        if same:
            shutil.rmtree(again, ignore_errors=True)
    if same:
        say('same numbers: yes')
    else:
        print(f'same numbers: no; the second runs are in {again}')  # even with --quiet
    return same


def versions() -> dict[str, str]:
    """Return versions on which the numbers may depend."""
    found = {'ballbot_ros': __version__, 'python': platform.python_version(),
             'machine': platform.machine()}
    for name in ('numpy', 'numba', 'scipy'):
        try:
            found[name] = version(name)
        except PackageNotFoundError:  # the kernels also run without numba
            found[name] = 'unknown'
    return found


def words(result: dict[str, Any]) -> str:
    """Return a result as one line of text."""
    numbers = result['numbers']
    return (f'x = {numbers["x"]:.3f} m, {numbers["faces_passed"]} of '
            f'{len(numbers["touch_times"])} faces passed, {numbers["motor_work"]:.2f} J, '
            f'{sum(result["messages"].values())} messages')


def write_table(results: list[dict[str, Any]], path: Path) -> None:
    """Write the numbers of all seeds as CSV."""
    units = {'seed': '1', 'x': 'm', 'speed': 'm/s', 'highest_speed': 'm/s',
             'pendulum_angle': 'rad', 'pendulum_torque': 'N m', 'motor_work': 'J',
             'faces_passed': '1'}
    rows = [{'seed': item['seed'], **item['numbers']} for item in results]
    write_columns({name: np.array([row[name] for row in rows]) for name in units}, units, path)


Digests = Dict[str, Dict[int, str]]  # of messages, by topic and stamp [ns]


def read_digests(path: Path, until: int) -> Digests:
    """Return the digests of messages up to a stamp [ns]; repeated messages count once."""
    topics: Digests = {}
    with open_bag(path) as bag:
        for topic, message in bag.messages(list(bag.topics)):
            if hasattr(message, 'header') and stamp_of(message) <= until:
                topics.setdefault(topic, {}).setdefault(stamp_of(message), digest(plain(message)))
    return topics


def first_difference(one: Digests, other: Digests) -> Optional[Tuple[int, str]]:
    """Return the stamp [ns] and the topic of the first message that differs."""
    found: List[Tuple[int, str]] = []
    for name in {*one, *other}:
        here, there = one.get(name, {}), other.get(name, {})
        different = [stamp for stamp in {*here, *there} if here.get(stamp) != there.get(stamp)]
        found += [(min(different), name)] if different else []
    return min(found, default=None)


def numbers_of(path: Path, scene: Scene) -> Dict[str, Any]:
    """Return a summary of a run in SI units, with times and speeds of touch at each face."""
    trajectory = recorded_trajectory(scene.model, [
        (1e-9 * stamp, states[-1]) for stamp, states in sorted(read_run(path).balls.items())])
    speed = np.hypot(trajectory['velocity_x'], trajectory['velocity_y'])
    meetings = meet_faces(trajectory)
    return {
        'x': float(trajectory['x'][-1]), 'speed': float(speed[-1]),
        'highest_speed': float(speed.max()),
        'pendulum_angle': float(np.abs(trajectory['pendulum_angle']).max()),
        'pendulum_torque': float(np.abs(trajectory['pendulum_torque']).max()),
        'motor_work': float(trajectory['motor_work'][-1]),
        'faces_passed': sum(face.passed for face in meetings),
        'touch_times': [face.touch_time for face in meetings],
        'touch_speeds': [face.touch_speed for face in meetings]}
