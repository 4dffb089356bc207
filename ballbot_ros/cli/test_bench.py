# SPDX-License-Identifier: Apache-2.0
"""The verb ``test-bench``: the paper's tests, with a virtual robot."""
import argparse
import math
from pathlib import Path
from typing import Any, Iterator

from ballbot_ros.cli.options import (
    add_number, add_out, add_quiet, add_robot, add_seed, read_robot, refuse_without)
from ballbot_ros.cli.output import figure_files, result_folder, save_figure, watched
from ballbot_ros.cli.verb import DONE, INTERRUPTED, print_error
from ballbot_ros.config.fields import count, quantity


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_robot(parser)
    parser.add_argument('--driven', action='store_true',
                        help='accelerate the ball from rest with a constant voltage, instead of '
                        'on a ramp')
    add_number(parser, '--slope-deg', 'DEGREES', quantity(
        'degrees', 'slope of the ramp (default: 8)', above=0.0, maximum=45.0, optional=True))
    parser.add_argument('--run-up', type=float, metavar='METRES',
                        help='length of the run-up of the driven test (default: 1.2)')
    parser.add_argument('--sensor-distance', type=float, metavar='METRES',
                        help='distance from the second touch sensor to the step (default: 0.2)')
    add_number(parser, '--rolls', 'N', count(
        'number of rolls near the threshold of each step', default=12, minimum=1))
    add_seed(parser, 'the scatter')
    add_out(parser, 'bench_ROBOT')
    add_quiet(parser)


def run(arguments: argparse.Namespace) -> int:
    robot, bench = read_robot(arguments), make_bench(arguments)
    from ballbot_ros.paper.procedure import HEIGHTS, run_tests
    name = f'bench_{robot.name}{"_driven" if arguments.driven else ""}'
    folder = result_folder(arguments.out, name, (
        'tests.csv', 'truth.csv', *figure_files(['tests'])), arguments.overwrite)
    rolls: list[Any] = []
    interrupted = False
    with watched(len(HEIGHTS), arguments.quiet, 'testing', 'steps') as progress:
        try:
            for roll in run_tests(bench, robot, HEIGHTS, arguments.seed, arguments.rolls):
                rolls.append(roll)
                progress(HEIGHTS.index(roll.step_height))
        except KeyboardInterrupt:
            interrupted = True
    files = write_all(robot, bench, rolls, folder)
    if not arguments.quiet:
        print('\n'.join(report(robot, bench, rolls)))
        print(f'\nWritten to {folder}: {", ".join(files)}')
    if interrupted:
        print_error(f'interrupted after {len(rolls)} rolls; they were written to {folder}')
        return INTERRUPTED
    return DONE


def make_bench(arguments: argparse.Namespace) -> Any:
    """Return the test bench that the command line describes."""
    from ballbot_ros.paper.test_bench import Ramp, RunUp
    refuse_without(arguments, '--driven', arguments.driven, '--run-up')
    refuse_without(arguments, 'the free-rolling test, without --driven', not arguments.driven,
                   '--slope-deg')
    changes = {name: value for name, value in (
        ('slope', None if arguments.slope_deg is None else math.radians(arguments.slope_deg)),
        ('run_up', arguments.run_up), ('sensor_distance', arguments.sensor_distance))
        if value is not None}
    return RunUp(**changes) if arguments.driven else Ramp(**changes)


def write_all(robot: Any, bench: Any, rolls: list[Any], folder: Path) -> list[str]:
    """Write measurements, true states and figure, and return the names of the files."""
    from ballbot_ros.paper.heights import bench_figure
    from ballbot_ros.results import write_text
    write_text('\n'.join(measured_rows(bench, rolls)) + '\n', folder / 'tests.csv')
    write_text('\n'.join(true_rows(rolls)) + '\n', folder / 'truth.csv')
    figure = bench_figure(robot, bench, rolls,
                          f'{robot.name}, {bench.setting_name} varied: {len(rolls)} rolls')
    return ['tests.csv', 'truth.csv', *save_figure(figure, folder, 'tests')]


def measured_rows(bench: Any, rolls: list[Any]) -> Iterator[str]:
    """Yield the CSV rows of the measurements."""
    yield f'test,step height [mm],{bench.setting_name} [{bench.unit}],measured speed [m/s],passed'
    for number, roll in enumerate(rolls, 1):
        speed = f'{roll.measured_speed:.3f}' if math.isfinite(roll.measured_speed) else ''
        yield (f'{number},{1e3 * roll.step_height:g},{roll.setting:.4g},{speed},'
               f'{"yes" if roll.passed else "no"}')


def true_rows(rolls: list[Any]) -> Iterator[str]:
    """Yield the CSV rows of the true states at the touch."""
    yield 'test,collision speed [m/s],pendulum angle at the touch [rad]'
    for number, roll in enumerate(rolls, 1):
        touched = math.isfinite(roll.touch_speed)
        yield f'{number},' + (
            f'{roll.touch_speed:.6f},{roll.touch_angle:.6f}' if touched else ',')


def report(robot: Any, bench: Any, rolls: list[Any]) -> Iterator[str]:
    """Yield the measured and the true thresholds, step by step."""
    from ballbot_ros.paper.procedure import find_thresholds, true_thresholds
    from ballbot_ros.table import table
    yield f'{robot.name}, {bench.setting_name} varied: {len(rolls)} rolls'
    yield ''
    yield table([('step mm', 'rolls', 'highest no-pass m/s', 'lowest pass m/s',
                  'highest no-pass at touch m/s'), *(
        (f'{1e3 * item.step_height:.0f}', str(item.rolls), *(
            f'{speed:.3f}' if math.isfinite(speed) else '-'
            for speed in (item.highest_no_pass, item.lowest_pass, true.highest_no_pass)))
        for item, true in zip(find_thresholds(rolls), true_thresholds(rolls)))])
