# SPDX-License-Identifier: Apache-2.0
"""The verb ``simulate``: run a scene, write and summarise the results."""
import argparse
from importlib.util import find_spec
from pathlib import Path
import re
import shutil
from time import perf_counter
from typing import Any, Iterator, Optional

from ballbot_ros.cli.options import (
    add_format, add_number, add_out, add_quiet, refuse_without, warn)
from ballbot_ros.cli.output import check_new_file, print_json, result_folder, save_figure, watched
from ballbot_ros.cli.verb import DONE, FAILED, INTERRUPTED, print_error
from ballbot_ros.config.fields import quantity
from ballbot_ros.errors import ConfigurationError

NUMBERS = ('summary.txt', 'summary.json', 'trajectory.csv', 'trajectory.npz',
           'trajectory.parquet')
PICTURES = ('strip', 'time_series')
# Per sample of a run: size of its files, and memory with figures, at most [bytes].
FILE_SIZE, MEMORY_SIZE = 1000, 1500
WARNED_SIZE = 1e9  # of the files [bytes]
ALL_FILES = (*NUMBERS, *(f'{name}.{ending}' for name in PICTURES for ending in ('png', 'svg')))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('scene', metavar='SCENE',
                        help='name of a scene ("ballbot scenes" lists them) or a YAML file')
    add_out(parser, 'SCENE')
    parser.add_argument('--duration', type=float, metavar='SECONDS',
                        help='time to simulate, instead of that of the scene')
    parser.add_argument('--output-step', type=float, metavar='SECONDS',
                        help='time between samples, instead of that of the scene')
    parser.add_argument('--step', type=float, metavar='SECONDS',
                        help='integration step of a fixed-step method (rk4 if none is given), '
                        'instead of an accuracy')
    parser.add_argument('--method', metavar='NAME',
                        help='integrator, instead of an accuracy: adaptive, explicit, implicit or '
                        'trapezoidal; rk4 or semi_implicit with fixed steps; or paper, for '
                        'that of the paper')
    parser.add_argument('--tolerance', type=float, metavar='METRES',
                        help='local error per step of an adaptive method, instead of '
                        'that of the scene')
    parser.add_argument('--accuracy', type=float, metavar='METRES',
                        help='largest position error, which determines the solver (default: '
                        '1e-5, if the scene names no solver)')
    parser.add_argument('--models', choices=('auto', 'full'),
                        help='auto: adaptive methods compute flights in closed '
                        'form; full: they do not (default: that of the scene)')
    pictures = parser.add_mutually_exclusive_group()
    pictures.add_argument('--no-figures', action='store_true', help='write numbers only')
    add_format(pictures)
    parser.add_argument('--animate', nargs='?', const=Path(), type=animation_file,
                        metavar='FILE.gif|FILE.mp4', help='write an animation as well (default '
                        'file: animation.gif in the folder)')
    add_number(parser, '--playback', 'FACTOR', quantity(
        '1', 'simulated seconds per second of the animation (default: 1)', minimum=0.01,
        maximum=1000.0, optional=True))
    parser.add_argument('--json', action='store_true',
                        help='print the summary as JSON only')
    add_quiet(parser)


def animation_file(text: str) -> Path:
    """Return the file of an animation, for argparse."""
    if Path(text).suffix.lower() not in ('.gif', '.mp4'):
        raise argparse.ArgumentTypeError(
            f'{text!r} must end in .gif or .mp4; the scene goes before --animate')
    return Path(text)


def run(arguments: argparse.Namespace) -> int:
    scene = read_scene(arguments)
    from ballbot_ros.errors import SimulationError
    from ballbot_ros.jit import compile_time
    folder = result_folder(arguments.out, scene.name, ALL_FILES, arguments.overwrite)
    animation = animation_asked(arguments, scene, folder)
    check_size(scene, folder)
    failure: Optional[SimulationError] = None
    start, compiled = perf_counter(), compile_time()
    try:
        load_machine_code(scene)
        start, compiled = perf_counter(), compile_time()
        with watched(scene.run.duration, arguments.quiet or arguments.json) as progress:
            trajectory = scene.simulate(progress=progress)
    except SimulationError as error:
        trajectory, failure = getattr(error, 'trajectory', None), error
        if trajectory is None:
            raise
    wall_time = perf_counter() - start - (compile_time() - compiled)
    from ballbot_ros.results import summarise
    summary = summarise(trajectory, wall_time)
    files: list[Path] = []
    interrupted = not summary.complete and failure is None
    try:
        for path in write_all(trajectory, summary, folder, arguments):
            files.append(path)
        if animation is not None and not interrupted:
            write_animation(trajectory, animation, summary.name, arguments)
            files.append(animation)
    except KeyboardInterrupt:
        interrupted = True
    for name in ALL_FILES:  # remove files of the replaced run
        if folder / name not in files:
            (folder / name).unlink(missing_ok=True)
    if arguments.json:
        print_json({**summary.to_dict(), 'files': [str(path) for path in files]})
    elif not arguments.quiet:
        from ballbot_ros.results import report
        print(f'{report(summary)}\n\nWritten to {folder}: '
              f'{", ".join(named(path, folder) for path in files)}')
    else:
        warn(summary.warnings)
    if failure is not None:
        print_error(f'{failure}; the preceding part was written to {folder}')
        return FAILED
    if interrupted:
        without = '' if animation is None or animation in files else f'; no {animation}'
        print_error(f'interrupted; {summary.duration:g} s of {scene.run.duration:g} s are in '
                    f'{folder}: {", ".join(path.name for path in files) or "no file"}{without}')
        return INTERRUPTED
    return DONE


def check_size(scene: Any, folder: Path) -> None:
    """Warn of a large run; refuse one that exceeds the free disk space or memory."""
    step, coarser = scene.run.output_step, 10.0 * scene.run.output_step
    while FILE_SIZE * scene.run.duration / coarser > 0.1 * WARNED_SIZE:
        coarser *= 10.0
    samples, fewer = (scene.run.duration / item for item in (step, coarser))
    words = (f'this run writes about {1e-9 * FILE_SIZE * samples:.2g} GB and takes up to '
             f'{1e-9 * MEMORY_SIZE * samples:.2g} GB of memory ({samples:.3g} samples, one every '
             f'{step:g} s); --output-step {coarser:g} makes it {1e-9 * FILE_SIZE * fewer:.2g} and '
             f'{1e-9 * MEMORY_SIZE * fewer:.2g} GB')
    place = next(path for path in (folder.absolute(), *folder.absolute().parents)
                 if path.exists())
    for size, free, where in (
            (FILE_SIZE * samples, shutil.disk_usage(place).free, f'in {place}'),
            (MEMORY_SIZE * samples, available_memory(), 'of memory')):
        if size > free:
            raise ConfigurationError(
                f'{words}; only {1e-9 * free:.2g} GB {where} are available', 'out_of_range',
                '--output-step')
    if FILE_SIZE * samples > WARNED_SIZE:
        warn([words])


def available_memory() -> int:
    """Return the memory that is available without swapping [bytes]."""
    found = re.search(r'MemAvailable: +(\d+) kB', Path('/proc/meminfo').read_text())
    assert found is not None
    return 1024 * int(found[1])


def animation_asked(arguments: argparse.Namespace, scene: Any, folder: Path) -> Optional[Path]:
    """Return the file of the animation or None; refuse a file that cannot be written."""
    refuse_without(arguments, '--animate', arguments.animate is not None, '--playback')
    if arguments.animate is None:
        return None
    from ballbot_ros.figures.run import check_animation
    path: Path = folder / 'animation.gif' if arguments.animate == Path() else arguments.animate
    check_new_file(path, arguments.overwrite, '--animate')
    check_animation(path, scene.run.duration, playback_of(arguments))
    return path


def playback_of(arguments: argparse.Namespace) -> float:
    """Return the simulated seconds per second of the animation."""
    return 1.0 if arguments.playback is None else float(arguments.playback)


def write_animation(trajectory: Any, path: Path, name: str, arguments: argparse.Namespace) -> None:
    """Write the animation and show the progress."""
    from ballbot_ros.figures.run import animate
    duration = float(trajectory['time'][-1])
    with watched(duration, arguments.quiet or arguments.json, 'animating',
                 keeps=False) as progress:
        animate(trajectory, path, name, playback_of(arguments),
                lambda done: progress(duration * done))


def named(path: Path, folder: Path) -> str:
    """Return the name of a file in the folder, else its full path."""
    return path.name if path.parent == folder else str(path.absolute())


def load_machine_code(scene: Any) -> None:
    """Simulate one sample, so that the run time excludes the loading of machine code."""
    from dataclasses import replace
    replace(scene, run=replace(scene.run, duration=scene.run.output_step)).simulate()


def read_scene(arguments: argparse.Namespace) -> Any:
    """
    Return the scene with the changes of the command line.

    Raises `ConfigurationError` with the option or the position in the file, the value and the
    allowed range.
    """
    from dataclasses import replace

    from ballbot_ros.config.fields import check_choice
    from ballbot_ros.physics.simulation.run import output_steps
    from ballbot_ros.physics.simulation.scene import load_scene
    from ballbot_ros.physics.simulation.solver import ACCURACY, METHODS, PRESETS, Solver
    scene = load_scene(arguments.scene)

    def change(part: Any, *names: str) -> Any:
        return replace(part, **{name: getattr(arguments, name) for name in names
                                if getattr(arguments, name) is not None})

    if arguments.method is not None:
        check_choice('--method', arguments.method, (*METHODS, *PRESETS))
    names = ('step', 'tolerance', 'models')
    named = any(getattr(arguments, name) is not None for name in ('method', 'step', 'tolerance'))
    solver, run = scene.model.solver, change(scene.run, 'duration', 'accuracy', 'output_step')
    if arguments.method in PRESETS:
        solver = change(PRESETS[arguments.method], *names)
    elif named or solver is not None:
        solver = change(scene.model.solver_in_use, 'method', *names)
    elif arguments.models is not None:
        solver, run = change(Solver('adaptive'), 'models'), replace(
            run, accuracy=run.accuracy or ACCURACY)
    scene = replace(scene, model=replace(scene.model, solver=solver), run=run)
    refuse_idle(arguments, scene)
    rounded = output_steps(run.duration, run.output_step) * run.output_step
    if rounded > run.duration * (1.0 + 1e-6):
        warn([f'the duration of {run.duration:g} s is rounded up to {rounded:g} s, a multiple of '
              f'the output step of {run.output_step:g} s'])
    return scene


def refuse_idle(arguments: argparse.Namespace, scene: Any) -> None:
    """Refuse an option without effect."""
    from ballbot_ros.physics.simulation.solver import METHODS
    if scene.run.accuracy is not None:
        for name in ('step', 'method', 'tolerance'):
            if getattr(arguments, name) is not None:
                raise ConfigurationError(
                    f'--{name} has no effect with an accuracy '
                    f'({scene.run.accuracy:g} m), which selects the solver; leave out one of them',
                    'inconsistent', f'--{name}')
        return
    if scene.model.solver is None:
        return
    method = scene.model.solver.method
    for name, use in (('step', 'step'), ('tolerance', 'tolerance'), ('models', 'flies')):
        methods = [item for item, described in METHODS.items() if getattr(described, use)]
        if getattr(arguments, name) is not None and method not in methods:
            raise ConfigurationError(f'--{name} requires --method {", ".join(methods)}, '
                                     f'not {method}', 'inconsistent', f'--{name}')


def write_all(trajectory: Any, summary: Any, folder: Path,
              arguments: argparse.Namespace) -> Iterator[Path]:
    """Write the files of a run, and yield the path of each complete one."""
    from ballbot_ros.results import report, write_text, write_trajectory
    from ballbot_ros.results.files import write_json
    write_text(f'{report(summary)}\n', folder / 'summary.txt')
    yield folder / 'summary.txt'
    write_json(summary.to_dict(), folder / 'summary.json')
    yield folder / 'summary.json'
    endings = ('csv', 'npz') if find_spec('pyarrow') is None else ('csv', 'npz', 'parquet')
    for ending in endings:
        write_trajectory(trajectory, folder / f'trajectory.{ending}')
        yield folder / f'trajectory.{ending}'
    if arguments.no_figures:
        return
    from ballbot_ros.figures.run import strip, time_series
    for name, draw in (('strip', strip), ('time_series', time_series)):
        figure = draw(trajectory, summary.name)
        for file in save_figure(figure, folder, name, arguments.format):
            yield folder / file
