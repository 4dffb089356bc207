# SPDX-License-Identifier: Apache-2.0
"""The verb ``fit-curve``: the file from which the node ``obstacle_decision`` knows a robot."""
import argparse
from pathlib import Path

from ballbot_ros.cli import options
from ballbot_ros.cli.command import DONE
from ballbot_ros.cli.output import check_new_file
from ballbot_ros.cli.ranges import read_range
from ballbot_ros.errors import ConfigurationError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add robot, actuation, range and output."""
    options.add_robot(parser)
    parser.add_argument('--out', type=Path, required=True, metavar='FILE',
                        help='YAML file to write; its name without the ending becomes the name of '
                        'the curve')
    options.add_overwrite(parser, file=True)
    options.add_actuation(parser)
    options.add_rules(parser, over='clear')
    parser.add_argument('--speed', default='0.2:1.2:21', metavar='FIRST:LAST:COUNT',
                        help='collision speeds to fit, which are also the range of the curve '
                        '[m/s] (default: %(default)s)')
    options.add_accuracy(parser, 2e-6, 'a simulated height')
    parser.add_argument('--samples', type=int, default=256, metavar='N',
                        help='number of robots to draw from the ranges of derived numbers, for '
                        'the band; 0 for no band (default: %(default)s)')
    parser.add_argument('--seed', type=int, default=0, metavar='N',
                        help='seed of the draw of robots (default: %(default)s)')
    options.add_quiet(parser)


def run(arguments: argparse.Namespace) -> int:
    """Simulate, fit and write."""
    law = options.read_law(arguments)
    if arguments.out.suffix not in ('.yaml', '.yml'):
        raise ConfigurationError(f'--out must end in .yaml, got {str(arguments.out)!r}')
    robot = options.read_robot(arguments)
    from ballbot_ros.cli.progress import watched
    from ballbot_ros.decision.planning.curve_file import curve_text
    from ballbot_ros.results.files import write_text
    from ballbot_ros.studies.curve_fit import fit_curve, heights_for, Request
    speeds = read_range(arguments.speed, '--speed')
    options.warn_speeds(arguments, '--speed', speeds)
    request = Request(lowest_speed=speeds[0], highest_speed=speeds[-1], points=len(speeds), **{
        name: getattr(arguments, name) for name in ('accuracy', 'samples', 'seed')})
    refuse_foreign(arguments.out)
    check_new_file(arguments.out, arguments.overwrite)
    wording = {'free': 'pendulum free, motor detached',
               'held': f'pendulum held at {arguments.angle_deg or 0.0:g} degrees by law (11)',
               'velocity': 'rolling at its speed by law (12)',
               'voltage': 'open-loop voltage on the motor'}[arguments.actuation]
    with watched(heights_for(robot, request), arguments.quiet, unit='heights',
                 keeps=False) as progress:
        curve = fit_curve(arguments.out.stem, robot, law, wording, request,
                          options.read_rules(arguments), progress)
    write_text(curve_text(curve, f'{robot.name} crosses, {wording}', 'ballbot fit-curve'),
               arguments.out)
    if not arguments.quiet:
        print(f'{arguments.out}: largest residual {1e3 * curve.residual:.3f} mm, rms '
              f'{1e3 * curve.rms:.3f} mm')
    return DONE


def refuse_foreign(path: Path) -> None:
    """
    Refuse to take the place of a file that is no curve.

    Raises
    ------
    ConfigurationError
        Naming the file.

    """
    from ballbot_ros.decision.planning.curve import load_curve
    try:
        if path.exists():
            load_curve(str(path))
    except ConfigurationError:
        raise ConfigurationError(
            f'{path} is there and is not a height curve; move it away or choose another file to '
            'write to') from None
