# SPDX-License-Identifier: Apache-2.0
"""The verb ``sweep``: crossings over any parameters, on all cores or a cluster."""
import argparse
from pathlib import Path
from time import perf_counter
from typing import Tuple

from ballbot_ros.cli import options
from ballbot_ros.cli.options import METAVAR, read_values, Values, VALUES_HELP
from ballbot_ros.cli.output import check_new_file, resumable, watched
from ballbot_ros.cli.verb import DONE
from ballbot_ros.errors import ConfigurationError

# Parameters that an option sets as well.
OPTIONS = {'set_angle_deg': '--angle-deg', **{
    name: f'--{name.replace("_", "-")}' for name in (
        'voltage', 'slope_before_deg', 'slope_behind_deg', 'friction_before', 'friction_edge',
        'friction_behind', 'clearance')}}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_robot(parser)
    parser.add_argument('--out', type=Path, required=True, metavar='FILE',
                        help='Parquet file to write; pandas.read_parquet(FILE).to_csv(...) '
                        'converts it')
    options.add_overwrite(parser, file=True)
    parser.add_argument('--vary', action='append', required=True, metavar=f'NAME={METAVAR}',
                        help=f'parameter to vary, in SI units except angles: {VALUES_HELP}; '
                        'LOW:HIGH for sobol and random.  NAME is speed, height, a field of the '
                        'robot, motor.*, slope_before_deg and other parameters of the ground, '
                        'set_angle_deg, voltage, ...; without height, the maximum step '
                        'height is searched')
    parser.add_argument('--fix', action='append', default=[], metavar='NAME=VALUE',
                        help='parameter with a constant value, named as in --vary; may be '
                        'repeated')
    parser.add_argument('--design', choices=('grid', 'sobol', 'random'), default='grid',
                        help='all combinations, or --cases points of a Sobol sequence or of '
                        'random draws (default: %(default)s)')
    parser.add_argument('--cases', type=int, metavar='N',
                        help='number of points of sobol and random')
    options.add_seed(parser, 'sobol and random')
    options.add_accuracy(parser, 5e-5, 'a height that is searched for')
    options.add_actuation(parser)
    options.add_site(parser)
    options.add_rules(parser)
    options.add_workers(parser)
    options.add_quiet(parser)


def run(arguments: argparse.Namespace) -> int:
    options.refuse_without(arguments, '--design sobol or random', arguments.design != 'grid',
                           '--cases')
    check_new_file(arguments.out, arguments.overwrite, endings=('.parquet',))
    robot = options.read_robot(arguments)
    from ballbot_ros.physics.model.robot import height_warnings
    from ballbot_ros.studies.parallel_map import worker_pool
    from ballbot_ros.studies.sweep import run_sweep
    from ballbot_ros.studies.sweep_plan import SweepPlan
    varied, fixed = {}, {}
    for option, word in [('--vary', word) for word in arguments.vary] + [
            ('--fix', word) for word in arguments.fix]:
        name, values = read_varied(word, option)
        if name in varied or name in fixed:
            raise ConfigurationError(
                f'{option} {name}: given more than once; give all values in one --vary, as in '
                f'{name}=0.2,0.5', 'ambiguous', name)
        own = OPTIONS.get(name, '')
        if own and getattr(arguments, own[2:].replace('-', '_')) is not None:
            raise ConfigurationError(
                f'{own} has no effect with {option} {name}; leave out one of them',
                'inconsistent', own)
        if option == '--vary':
            varied[name] = values
        elif isinstance(values, list) and len(values) == 1:
            fixed[name] = values[0]
        else:
            raise ConfigurationError(f'--fix {name}: give one value', 'wrong_type', name)
    plan = SweepPlan(
        robot, options.read_law(arguments), options.read_site(arguments),
        options.read_rules(arguments), arguments.design, arguments.cases or 0, arguments.seed,
        arguments.accuracy, fixed,
        {name: values for name, values in varied.items() if isinstance(values, list)},
        {name: values for name, values in varied.items() if isinstance(values, tuple)})
    used = {**{name: [value] for name, value in fixed.items()}, **varied}
    if 'speed' in used:
        options.warn_speeds('speed', used['speed'])
    if 'height' in used:
        options.warn(height_warnings(robot, max(used['height']), 'to be tried'))
    start = perf_counter()
    with resumable(Path(f'{arguments.out}.blocks')), \
            worker_pool(arguments.workers, arguments.dask) as (pool, number), \
            watched(plan.size, arguments.quiet, 'sweeping', 'cases') as progress:
        found = run_sweep(plan, arguments.out, pool, number, progress)
    if found.failed:
        options.warn([f'{found.failed} of {plan.size} cases failed, see the column failure of '
                      f'{arguments.out}; the first: {found.reason}'])
    if not arguments.quiet:
        spent = perf_counter() - start
        new = plan.size - found.resumed
        print(f'{arguments.out}: {plan.size} cases, {new} of them run now, in {spent:.1f} s '
              f'({1e3 * spent * number / max(new, 1):.1f} ms CPU per case)')
    return DONE


def read_varied(word: str, option: str) -> Tuple[str, Values]:
    """
    Return name and values of ``NAME=VALUES``; see `read_values`.

    Raises `ConfigurationError` for another form, and for the name of an angle in radians.
    """
    from ballbot_ros.studies.sweep_plan import IN_DEGREES, NUMBERS
    name, _, values = word.partition('=')
    if not (name and values):
        raise ConfigurationError(f'{option} must be NAME=VALUES, such as speed=0.2:1.2:21; got '
                                 f'{word!r}', 'wrong_type', option)
    if name not in IN_DEGREES and NUMBERS.get(name, {}).get('unit') == 'rad':
        in_degrees = next(key for key, owner in IN_DEGREES.items() if owner == name)
        raise ConfigurationError(
            f'{option} {name}: angles are given in degrees here; write {in_degrees}=...',
            'inconsistent', name)
    return name, read_values(values, f'{option} {name}')
