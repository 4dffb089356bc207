# SPDX-License-Identifier: Apache-2.0
"""The verb ``fit-curve``: the height curve of a robot for the node ``obstacle_decision``."""
import argparse
from pathlib import Path

from ballbot_ros.cli import options
from ballbot_ros.cli.options import read_values
from ballbot_ros.cli.output import check_new_file, watched, YAML
from ballbot_ros.cli.verb import DONE
from ballbot_ros.config.fields import check_value
from ballbot_ros.errors import ConfigurationError


def add_arguments(parser: argparse.ArgumentParser) -> None:
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
    parser.add_argument('--samples', type=int, metavar='N',
                        help='number of robots to draw from the ranges of uncertain parameters, '
                        'for the band; 0 for no band (default: 256, or 0 for a robot without '
                        'ranges)')
    options.add_seed(parser, 'the draw of robots')
    options.add_quiet(parser)


def run(arguments: argparse.Namespace) -> int:
    law = options.read_law(arguments)
    check_new_file(arguments.out, arguments.overwrite, endings=YAML)
    robot = options.read_robot(arguments)
    from ballbot_ros.decision.planning.curve import load_curve
    from ballbot_ros.physics.model.uncertainty import uncertain
    from ballbot_ros.results.files import write_text
    from ballbot_ros.studies.curve_fit import curve_text, fit_curve, heights_for, Request
    speeds = read_values(arguments.speed, '--speed')
    if ':' not in arguments.speed or isinstance(speeds, tuple):
        raise ConfigurationError(
            f'--speed must be FIRST:LAST:COUNT, as in 0.2:1.2:21; got {arguments.speed!r}',
            'wrong_type', '--speed')
    check_value('--speed: COUNT', len(speeds), Request.__dataclass_fields__['points'].metadata, '')
    options.warn_speeds('--speed', speeds)
    if arguments.samples and not uncertain(robot):
        raise ConfigurationError(
            f'--samples {arguments.samples}: no parameter of {robot.name} has a range, so '
            'there is no band; give a parameter of the robot file a range, or leave --samples out',
            'inconsistent', 'samples')
    request = Request(
        speeds[0], speeds[-1], len(speeds), arguments.accuracy, seed=arguments.seed,
        **({} if arguments.samples is None else {'samples': arguments.samples}))
    if arguments.out.exists():
        try:
            load_curve(str(arguments.out))
        except ConfigurationError:
            raise ConfigurationError(
                f'{arguments.out} exists and is not a height curve; move it away or choose '
                'another file with --out', 'inconsistent', '--out') from None
    wording = {'free': 'pendulum free, motor detached',
               'held': f'pendulum held at {arguments.angle_deg or 0.0:g} degrees by law (11)',
               'velocity': 'rolling at its speed by law (12)',
               'voltage': 'open-loop voltage on the motor'}[arguments.actuation]
    with watched(heights_for(robot, request), arguments.quiet, unit='heights',
                 keeps=False) as progress:
        curve = fit_curve(arguments.out.stem, robot, law, wording, request,
                          options.read_rules(arguments), progress)
    write_text(curve_text(curve, f'{robot.name}, {wording}', 'ballbot fit-curve'),
               arguments.out)
    if not arguments.quiet:
        print(f'{arguments.out}: largest residual {1e3 * curve.residual:.3f} mm, rms '
              f'{1e3 * curve.rms:.3f} mm')
    return DONE
