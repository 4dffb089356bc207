# SPDX-License-Identifier: Apache-2.0
"""The verb ``on-timeout``: motion of the ball after a command timeout."""
import argparse
import math
from typing import Any, Iterable, Iterator

from ballbot_ros.cli.options import add_hardware, add_number, METAVAR, read_numbers, VALUES_HELP
from ballbot_ros.cli.verb import DONE
from ballbot_ros.config.fields import quantity
from ballbot_ros.errors import ConfigurationError

REPORT_TIMES = (1.0, 3.0, 10.0)  # times of the printed distances and speeds [s]
WIDTHS = (7, 6, 6, 18, 18, 19, 13, 16, 10)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_hardware(parser)
    add_number(parser, '--speed', 'M/S', quantity(
        'm/s', 'speed of the ball when commands stop', default=0.6, minimum=0.0, maximum=3.0))
    parser.add_argument('--slopes-deg', nargs='+', default=['0,1,2,5'], metavar=METAVAR,
                        help=f'slopes to try, downhill and uphill [degrees]: {VALUES_HELP} '
                        '(default: 0,1,2,5)')
    parser.add_argument('--policy', action='append', choices=('coast', 'brake', 'settle'),
                        help='policy to try, a value of on_timeout; may be repeated (default: '
                        'all)')
    parser.add_argument('--damping', type=float, metavar='N_M_S',
                        help='damping of the joint in brake and settle [N m s/rad], instead of '
                        'the one in the file')
    parser.add_argument('--damping-time', type=float, metavar='SECONDS',
                        help='duration of brake and settle, instead of the one in the file')


def run(arguments: argparse.Namespace) -> int:
    from dataclasses import replace

    from ballbot_ros.bridge.hardware_file import load_hardware, ON_TIMEOUT
    from ballbot_ros.studies.command_loss import lose_commands, scenarios, scene_of
    hardware = load_hardware(arguments.hardware)
    limits = replace(hardware.limits, **{
        name: getattr(arguments, name) for name in ('damping', 'damping_time')
        if getattr(arguments, name) is not None})
    hardware = replace(hardware, limits=limits)
    slopes = sorted({abs(slope) for slope in read_numbers(arguments.slopes_deg, '--slopes-deg')})
    planned = list(scenarios(
        arguments.speed, list(map(math.radians, slopes)), arguments.policy or ON_TIMEOUT))
    try:  # before anything is printed
        for scenario in planned:
            scene_of(hardware, scenario)
    except ConfigurationError as error:
        raise ConfigurationError(
            f'--slopes-deg: {error}', error.reason, '--slopes-deg') from error
    print(f'{hardware.name}: damping {limits.damping:g} N m s/rad for {limits.damping_time:g} s, '
          f'command timeout {limits.command_timeout:g} s\n')
    print('\n'.join(heading()), flush=True)
    for scenario in planned:
        print(row(lose_commands(hardware, scenario)), flush=True)
    return DONE


def heading() -> Iterator[str]:
    """Yield the first two lines of the table, which is also valid Markdown."""
    yield line(('start', 'slope', 'policy', *(f'after {time:g} s' for time in REPORT_TIMES),
                'largest angle', 'within 5 degrees', 'motor work'))
    yield f'|{"|".join("-" * (width + 2) for width in WIDTHS)}|'


def row(response: Any) -> str:
    """Return the table row of a response."""
    scenario = response.scenario
    degrees = f'{abs(math.degrees(scenario.slope)):g}'
    hangs = response.hangs_after
    return line((
        f'{scenario.speed:g} m/s' if scenario.speed else 'rest',
        'level' if scenario.slope == 0.0
        else f'{degrees} {"up" if scenario.slope > 0.0 else "down"}',
        scenario.policy,
        *('{:.2f} m, {:.2f} m/s'.format(*(round(value, 2) + 0.0 for value in response.after(time)))
          for time in REPORT_TIMES),
        f'{math.degrees(response.largest_angle):.0f} degrees',
        f'not in {response.time[-1]:.0f} s' if hangs is None else f'after {hangs:.1f} s',
        f'{response.energy_given:.2f} J'))


def line(cells: Iterable[str]) -> str:
    return f'| {" | ".join(f"{cell:<{width}}" for cell, width in zip(cells, WIDTHS))} |'
